"""The lines that the docs put beside those of ros2 and yakut, each run at a robot with a part that speaks."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

from tests import ROOT
from tests.e2e.processes import run, running

PAGE = ROOT / "docs" / "howto" / "topics_and_logs.md"


def lines() -> list[list[str]]:
    table = PAGE.read_text("utf-8").partition("## What ros2 and yakut call it")[2].partition("\n## ")[0]
    return [shlex.split(line) for line in re.findall(r"\| `msbot ([^`]+)` \|", table)]


def test_each_line_of_the_table_works(tmp_path: Path) -> None:
    env = {"XDG_RUNTIME_DIR": str(tmp_path), "XDG_STATE_HOME": str(tmp_path / "state")}
    assert run("init", cwd=tmp_path, env=env).returncode == 0
    calls = [line for line in lines() if line[0] != "call"]  # `test_services` has a robot with a service
    assert len(calls) == 11
    with running(
        "master", "robot.toml", "--link", "tcp:127.0.0.1:0", "--no-page", "--rec", "10min", cwd=tmp_path, env=env
    ) as master:
        address = re.search(r"tcp:127.0.0.1:\d+", master.wait_for("tcp:127.0.0.1:"))
        assert address is not None
        with running("part", "AA", "--link", address[0], cwd=tmp_path, env=env) as part:
            part.wait_for("active")
            for call in calls:
                done = run(*call, cwd=tmp_path, env=env)
                # A doctor finds what is to repair in a robot with one part of three: that is an answer.
                assert done.returncode in ((0, 1) if call == ["doctor"] else (0,)), (call, done.stderr)
                assert done.stdout.strip(), call
            part.end()
    assert (tmp_path / "tour.mcap").exists()
