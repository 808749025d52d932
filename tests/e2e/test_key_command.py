"""Keys as a user has them: a robot with authentication, `msbot key`, and parts in processes of their own."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

from msbot.config import SAMPLE_ROBOT_TOML
from tests.e2e.processes import run, running
from tests.e2e.test_processes import free_port


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    text = SAMPLE_ROBOT_TOML.replace('authentication = "open"', 'authentication = "key"')
    assert text != SAMPLE_ROBOT_TOML
    (tmp_path / "robot.toml").write_text(text)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "run"))
    (tmp_path / "run").mkdir(mode=0o700)
    monkeypatch.delenv("MSBOT_KEY", raising=False)
    return tmp_path


def test_a_part_joins_a_robot_with_keys_only_with_its_key(folder: Path) -> None:
    link = f"udp:127.0.0.1:{free_port()}"
    assert run("apply", "--yes", cwd=folder).returncode == 0
    made = run("key", "new", "ABCD", "--name", "ABCD-local", "--here", "--no-qr", cwd=folder)
    assert made.returncode == 0, made.stderr
    other = run("key", "new", "EFGH", "--no-qr", cwd=folder)
    uid, key = (re.search(rf"{word} +([0-9a-f-]+)", other.stdout) for word in ("UID", "key"))
    assert uid is not None
    assert key is not None
    (folder / "bb.key").write_text(key[1])
    with running("master", "--no-page", "--link", link, cwd=folder) as master:
        master.wait_for("is up")
        with running("part", "AA", "--link", link, cwd=folder) as part:
            master.wait_for("ABCD-local", "checking -> active")
            part.wait_for("is active")
        with running("part", "BB", "--link", link, "--uid", uid[1], "--key", "bb.key", cwd=folder):
            master.wait_for("EFGH-local", "checking -> active")
        with running("part", "CC", "--link", link, cwd=folder):
            line = master.wait_for("WXYZ-local", "refused")
            assert "this robot asks for keys, and has none for this part" in line
            why = run("why", "WXYZ-local", "--last", "2", cwd=folder)
    assert "this robot asks for keys, and has none for this part" in why.stdout


def test_a_key_that_is_no_key_is_one_sentence_and_status_2(folder: Path) -> None:
    done = run("part", "AA", "--key", "secret", cwd=folder)
    assert done.returncode == 2
    assert done.stderr == "msbot: that is not a key: write 32 hexadecimal digits, as `msbot key new` shows them\n"
    assert sys.executable not in done.stderr
