"""Two masters of one robot: the one that waits takes over whatever happens, and no part is told by two."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tests.e2e.processes import run
from tests.e2e.two_masters import NotPermitted, two_masters
from tests.registry.postgres import MISSING, NEEDED, find_server

SOON_S = 15.0
"""On a machine that does many other things; `bench/takeover.py` measures the 5 s on a quiet one."""


def test_the_master_that_waits_takes_over_when_the_other_is_killed_frozen_or_cut_off(tmp_path: Path) -> None:
    programs = find_server()
    if programs is None:
        assert NEEDED not in os.environ, MISSING
        pytest.skip(MISSING)
    try:
        with two_masters(tmp_path, programs, first=True) as robot:
            robot.start()
            assert robot.say("stop").startswith("STOP")
            for lose in (robot.freeze, robot.kill, robot.cut):
                taken = lose()
                assert taken.stale == 0
                assert taken.serving_s < SOON_S
                master = robot.masters[robot.active]
                assert any("STOP holds since before" in line for line in master.lines)
            assert "STOP is over" in robot.say("go")
    except NotPermitted as error:
        pytest.skip(f"networks of its own need root: {error}")


def test_a_file_cannot_be_shared(tmp_path: Path) -> None:
    assert run("init", cwd=tmp_path).returncode == 0
    ended = run("master", "--standby", "--no-page", cwd=tmp_path)
    assert ended.returncode == 2
    assert "--standby needs a database that both masters reach, and robot.db is a file" in ended.stderr
