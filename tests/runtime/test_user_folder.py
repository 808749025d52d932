"""The folder of this user, and who may write there."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from msbot.errors import ConfigError
from msbot.runtime.user_folder import check_owner, is_running, user_folder


def test_the_folder_is_the_runtime_folder_or_a_temporary_one_of_the_user(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert user_folder() == tmp_path / "msbot"
    monkeypatch.delenv("XDG_RUNTIME_DIR")
    assert user_folder() == Path(tempfile.gettempdir()) / f"msbot-{os.getuid()}"


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
