"""STOP by every way that it comes in, at a real master: nothing is heard after all have confirmed."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from msbot.stop.stop_request import ask_masters
from tests.e2e.processes import run
from tests.hostile.robot import PATIENCE_S
from tests.stop.real_robots import RealRobot, Trial

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="`msbot stop` has its socket on Linux")


def by_command(robot: RealRobot, do: str) -> None:
    done = run(do, "--robot", "MSBOT_MASTER", cwd=robot.folder, env=robot.env)
    assert done.returncode == 0, done.stdout + done.stderr


def by_class_command(robot: RealRobot, do: str) -> None:
    if do == "go":  # a class has a STOP for all; each robot has its own GO
        by_command(robot, do)
        return
    done = run("class", do, "--json", cwd=robot.folder, env=robot.env)
    assert done.returncode == 0, done.stdout + done.stderr
    assert json.loads(done.stdout)


def by_socket(_robot: RealRobot, do: str) -> None:
    answers, silent = ask_masters({"do": do, "who": "ann"}, PATIENCE_S)
    assert answers
    assert not silent


def by_call(robot: RealRobot, do: str) -> None:
    status, answer = robot.call("POST", f"/{do}", {})
    assert status == 200, answer


def by_open_page(robot: RealRobot, do: str) -> None:
    assert robot.open_page().post(f"/{do}", json={}).status_code == 200


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[RealRobot]:
    with ExitStack() as stack:
        yield RealRobot(tmp_path, stack)


@pytest.mark.promise(
    "After all parts have confirmed STOP, nothing reaches a part's function, by whatever way it was said"
)
def test_nothing_is_heard_after_all_have_confirmed(
    robot: RealRobot, monkeypatch: pytest.MonkeyPatch, record_property: Callable[[str, object], None]
) -> None:
    for name, value in robot.env.items():
        monkeypatch.setenv(name, value)
    robot.begin()
    ways = (by_command, by_class_command, by_socket, by_call, by_open_page)
    for say in ways:
        trial = Trial(robot)
        say(robot, "stop")
        trial.all_confirm()
        verdict = trial.go(lambda say=say: say(robot, "go"))  # type: ignore[misc]
        assert verdict.is_right, (say.__name__, verdict)
    record_property("tried", len(ways))
    record_property("held", len(ways))
