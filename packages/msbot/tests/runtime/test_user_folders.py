"""The folders of this user, and who may write there."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from msbot_agent.agent.status_files import find_status_files, status_folder, write_status_file
from msbot_agent.process.user_folders import (
    check_owner,
    is_running,
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
