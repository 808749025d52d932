"""The files by which running agents are found: private, and never stale for long."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from msbot_agent.agent.status_files import find_status_files, restore_status_file, status_folder, write_status_file
from msbot_xrce.errors import ConfigError


def test_the_folder_is_the_runtime_folder_or_a_private_temporary_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert status_folder() == tmp_path / "msbot"
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "missing"))
    assert status_folder() == Path(tempfile.gettempdir()) / f"msbot-{os.getuid()}"
    monkeypatch.delenv("XDG_RUNTIME_DIR")
    assert status_folder().name == f"msbot-{os.getuid()}"


def test_only_the_user_can_read_a_file(tmp_path: Path) -> None:
    folder = tmp_path / "msbot"
    file = write_status_file(folder, 4711)
    assert folder.stat().st_mode & 0o777 == 0o700
    assert file.path.stat().st_mode & 0o777 == 0o600
    assert (file.port, file.pid, len(file.token)) == (4711, os.getpid(), 32)
    assert list(find_status_files(folder)) == [file]


def test_several_processes_are_found_in_the_order_of_their_start(tmp_path: Path) -> None:
    folder = tmp_path / "msbot"
    files = [write_status_file(folder, port) for port in (3, 1, 2)]
    for number, file in enumerate(files):
        os.utime(file.path, ns=(number, number))
    assert [file.port for file in find_status_files(folder)] == [3, 1, 2]


def test_the_file_of_a_dead_process_is_removed(tmp_path: Path) -> None:
    folder = tmp_path / "msbot"
    file = write_status_file(folder, 1)
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    file.path.write_text(json.dumps({"port": 1, "token": "t", "pid": ended.pid}))
    again = write_status_file(folder, 2)
    assert not file.path.exists()
    file.path.write_text(json.dumps({"port": 1, "token": "t", "pid": ended.pid}))
    assert list(find_status_files(folder)) == [again]
    assert not file.path.exists()


@pytest.mark.parametrize("text", ["", "{", "[]", "{}", '{"port": "x", "token": "t", "pid": 1}'])
def test_what_is_no_such_file_is_left_alone(tmp_path: Path, text: str) -> None:
    folder = tmp_path / "msbot"
    folder.mkdir(mode=0o700)
    (folder / "status-1-a.json").write_text(text)
    (folder / "notes.txt").write_text("mine")
    assert list(find_status_files(folder)) == []
    assert len(list(folder.iterdir())) == 2


def test_a_file_may_vanish_while_others_are_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = write_status_file(tmp_path / "msbot", 1)
    ghost = tmp_path / "msbot" / "status-0-gone.json"
    monkeypatch.setattr(Path, "glob", lambda self, pattern: iter([file.path, ghost]))
    assert list(find_status_files(tmp_path / "msbot")) == [file]


def test_a_process_of_somebody_else_counts_as_running(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = write_status_file(tmp_path / "msbot", 1)
    for error in (PermissionError, OverflowError):
        with monkeypatch.context() as patch:
            patch.setattr(os, "kill", lambda pid, number, error=error: (_ for _ in ()).throw(error))
            assert list(find_status_files(tmp_path / "msbot")) == [file]


def test_without_a_folder_nobody_runs(tmp_path: Path) -> None:
    assert list(find_status_files(tmp_path / "nothing")) == []


def test_a_folder_that_others_can_use_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "msbot"
    folder.mkdir(mode=0o700)
    folder.chmod(0o777)
    for use in (lambda: write_status_file(folder, 1), lambda: list(find_status_files(folder))):
        with pytest.raises(ConfigError, match="is not a folder that belongs to you alone: remove it"):
            use()
    link = tmp_path / "link"
    (tmp_path / "real").mkdir(mode=0o700)
    link.symlink_to(tmp_path / "real")
    with pytest.raises(ConfigError, match="belongs to you alone"):
        write_status_file(link, 1)


def test_a_place_that_cannot_be_written_is_explained(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigError, match=r"cannot write .*/status-.*\.json \(Not a directory\)"):
        write_status_file(tmp_path / "file" / "msbot", 1)


def test_a_file_is_not_put_back_into_a_folder_of_others(tmp_path: Path) -> None:
    file = write_status_file(tmp_path / "msbot", 1)
    file.path.unlink()
    file.path.parent.chmod(0o777)
    restore_status_file(file)
    assert not file.path.exists()
