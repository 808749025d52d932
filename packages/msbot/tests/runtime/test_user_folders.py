"""The folders of this user, and who may write there."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from msbot.master.stop_persistence import StopFile
from msbot.part.join.uid import write_for_user_alone
from msbot.pnp import StopRecord
from msbot_agent.agent.status_files import find_status_files, status_folder, write_status_file
from msbot_agent.process.user_folders import (
    check_owner,
    is_running,
    make_own_folder,
    replace_file,
    running_folder,
    settings_folder,
    state_folder,
)
from msbot_xrce.errors import ConfigError


def test_the_folder_is_the_runtime_folder_or_a_temporary_one_of_the_user(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert running_folder() == tmp_path / "msbot"
    monkeypatch.delenv("XDG_RUNTIME_DIR")
    assert running_folder() == Path(tempfile.gettempdir()) / f"msbot-{os.getuid()}"


def test_a_squatted_folder_blinds_nobody(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Anybody can make `/tmp/msbot-UID` before the user does: programs meet in the home, and go on meeting there."""
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    squatted = tmp_path / f"msbot-{os.getuid()}"
    for kind in ("a folder", "a file", "a link"):
        if kind == "a folder":
            squatted.mkdir()
            squatted.chmod(0o777)
        elif kind == "a file":
            squatted.touch()
        else:
            squatted.symlink_to(tmp_path)
        place = running_folder()
        assert place.parent == tmp_path / "home/.local/state/msbot"
        file = write_status_file(status_folder(), 4711)
        assert [one.path for one in find_status_files(status_folder())] == [file.path]
        if kind == "a folder":
            squatted.rmdir()
        else:
            squatted.unlink()
        assert running_folder() == place, "who starts when the squatter is gone finds who runs"
        file.path.unlink()
    assert [one.getMessage() for one in caplog.records] == [
        f"{squatted} is not yours alone: {place} is used in its place"
    ]


def test_what_survives_a_restart_follows_the_desktop_rules(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    for variable in ("XDG_STATE_HOME", "XDG_CONFIG_HOME"):
        monkeypatch.delenv(variable, raising=False)
    assert state_folder() == tmp_path / ".local/state/msbot"
    assert settings_folder("systemd") == tmp_path / ".config/systemd"
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    assert state_folder() == tmp_path / "state/msbot"
    assert settings_folder("systemd") == tmp_path / "config/systemd"


def test_a_folder_that_others_can_read_is_refused(tmp_path: Path) -> None:
    tmp_path.chmod(0o700)
    check_owner(tmp_path)
    tmp_path.chmod(0o755)
    with pytest.raises(ConfigError, match="belongs to you alone"):
        check_owner(tmp_path)


def test_a_file_in_the_place_of_the_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "msbot").write_text("")
    with pytest.raises(ConfigError, match="remove it"):
        check_owner(tmp_path / "msbot")


def test_a_process_runs_until_it_has_ended() -> None:
    assert is_running(os.getpid())
    assert is_running(1), "of another user"
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    assert not is_running(ended.pid)
    assert is_running(1 << 80), "no number of a process, so nothing is known"


@pytest.mark.promise("Other users of the computer change nothing that a program of MsBOT runs")
def test_folders_of_state_are_the_users_alone_whatever_the_umask_is(tmp_path: Path) -> None:
    """Who may write to a folder above could put another STOP file, key or list of sessions in the place of the own."""
    (tmp_path / "home").mkdir(mode=0o700)
    state = tmp_path / "home/.local/state/msbot"
    before = os.umask(0)
    try:
        StopFile(state / "stop/robot.json").write(StopRecord(3, True, "ann", "fire", 5, 4))
        write_for_user_alone(state / "key/ABCD", "00")
        make_own_folder(tmp_path / "home/.cache/msbot/cyphal")
        make_own_folder(tmp_path / "home")
        (tmp_path / "file").touch()
        with pytest.raises(FileExistsError):
            make_own_folder(tmp_path / "file")
    finally:
        os.umask(before)
    made = list((tmp_path / "home").rglob("*"))
    assert len(made) == 10
    assert [str(path) for path in made if path.stat().st_mode & 0o077] == []


@pytest.mark.promise("Other users of the computer change nothing that a program of MsBOT runs")
def test_a_file_is_not_written_through_what_others_put_beside_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, mine = tmp_path / "robot.toml", tmp_path / "mine"
    mine.write_text("mine")
    path.write_text("old")
    path.chmod(0o640)
    replace_file(path, b"new")
    assert (path.read_text(), path.stat().st_mode & 0o777) == ("new", 0o640)
    monkeypatch.setattr("secrets.token_hex", lambda _: "guessed")
    link = tmp_path / ".robot.toml.guessed"
    link.symlink_to(mine)
    with pytest.raises(FileExistsError):
        replace_file(path, b"newer")
    assert (path.read_text(), mine.read_text(), link.is_symlink()) == ("new", "mine", True)
    link.unlink()
    replace_file(tmp_path / "other", b"first")
    assert sorted(one.name for one in tmp_path.iterdir()) == ["mine", "other", "robot.toml"]
