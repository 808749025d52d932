"""A STOP that reaches nobody tells of masters that other users run here."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from msbot.stop import masters_of_others as others
from tests.cli.change.test_robot_access import command

WORDS = {
    101: b"/opt/msbot/bin/python\0/usr/local/bin/msbot\0master\0robot.toml\0",
    102: b"python3\0-m\0msbot\0demo\0",
    103: b"/usr/bin/msbot\0master\0",
    104: b"python3\0/usr/bin/msbot\0stop\0--reason\0msbot\0master\0",
    105: b"vi\0master\0",
    106: b"",
}


@pytest.fixture
def processes(tmp_path: Path) -> Path:
    """Processes of this user, as the system lists them; one has just ended."""
    for pid, words in WORDS.items():
        (tmp_path / str(pid)).mkdir()
        (tmp_path / str(pid) / "cmdline").write_bytes(words)
    (tmp_path / "107").mkdir()
    (tmp_path / "meminfo").write_text("")
    return tmp_path


def test_they_are_found_by_the_words_of_their_processes(processes: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(others, "own_user", lambda: 4242)
    found = others.masters_of_others(processes)
    assert {user: sorted(pids) for user, pids in found.items()} == {os.getuid(): [101, 102, 103]}


@pytest.mark.parametrize("user", [0, os.getuid()])
def test_root_and_their_own_user_reach_them_anyway(user: int, processes: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(others, "own_user", lambda: user)
    assert not others.masters_of_others(processes)


def test_who_says_stop_is_told_whose_they_are(processes: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "folder").mkdir()
    monkeypatch.chdir(tmp_path / "folder")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setattr("msbot.cli.change.stop_commands.masters_of_others", lambda: {4_000_000_001: [7, 9]})
    told = command("stop", "--robot", "NOBODY-HAS-THIS-NAME")
    assert "NOT delivered: no master of this robot runs here" in told
    assert "masters of user 4000000001 (process 7, 9) run here: `sudo msbot stop` reaches them" in told
    assert "`sudo msbot go` reaches them" in command("go", "--robot", "NOBODY-HAS-THIS-NAME")


def test_many_are_counted() -> None:
    told = others.others_words({user: list(range(1, 9)) for user in range(4_000_000_000, 4_000_000_009)}, "msbot stop")
    assert "process 1, 2, 3, 4 ..." in told
    assert told.count("process") == 4
    assert "and others run here" in told
    assert others.others_words({}, "msbot stop") == ""
