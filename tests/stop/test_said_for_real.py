"""STOP by every way that it comes in, at a real master: nothing is heard after all have confirmed.

Master and parts are processes. One part speaks 100 times a second; another one writes an octet into a file for each
sample that its function gets. After all have confirmed the file may not grow, until GO.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from msbot.stop.asking import ask_masters
from tests.e2e.processes import run
from tests.hostile.robot import PATIENCE_S, Robot, until

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="`msbot stop` has its socket on Linux")

SPEAKS = """
from msbot import HelloWorld, Part

part = Part("ABCD", robot="MSBOT_MASTER", local_name="AA")

@part.every(0.01)
def speak():
    part.publish("out", HelloWorld(index=1, message="on"))

part.run()
"""
HEARS = """
import sys
from msbot import HelloWorld, Part

heard = open("heard", "ab", buffering=0)
part = Part("EFGH", robot="MSBOT_MASTER", local_name="BB")

@part.on("in", HelloWorld)
def hear(message):
    heard.write(b".")

part.run()
"""
LOOKS = 30
"""How often the robot is asked for its state before nothing was heard: each takes some milliseconds."""


class Bench(Robot):
    """A robot with a part that speaks and one that hears."""

    def begin(self) -> None:
        """Until samples arrive."""
        self.master(page=True)
        for name, text in (("speaks", SPEAKS), ("hears", HEARS)):
            (self.folder / f"{name}.py").write_text(text)
            program = self.stack.enter_context(
                subprocess.Popen(
                    [sys.executable, f"{name}.py"],
                    cwd=self.folder,
                    stdout=subprocess.DEVNULL,
                    env={**os.environ, **self.env, "MSBOT_LINK": self.link},
                )
            )
            self.stack.callback(program.kill)
        until(lambda: self.heard() > 0)

    def heard(self) -> int:
        """Samples that the function has got."""
        file = self.folder / "heard"
        return file.stat().st_size if file.exists() else 0


def by_command(robot: Bench, do: str) -> None:
    done = run(do, "--robot", "MSBOT_MASTER", cwd=robot.folder, env=robot.env)
    assert done.returncode == 0, done.stdout + done.stderr


def by_class_command(robot: Bench, do: str) -> None:
    if do == "go":  # a class has a STOP for all; each robot has its own GO
        by_command(robot, do)
        return
    done = run("class", do, "--json", cwd=robot.folder, env=robot.env)
    assert done.returncode == 0, done.stdout + done.stderr
    assert json.loads(done.stdout)


def by_socket(_robot: Bench, do: str) -> None:
    answers, silent = ask_masters({"do": do, "who": "ann"}, PATIENCE_S)
    assert answers
    assert not silent


def by_call(robot: Bench, do: str) -> None:
    status, answer = robot.call("POST", f"/{do}", {})
    assert status == 200, answer


def by_open_page(robot: Bench, do: str) -> None:
    assert robot.open_page().post(f"/{do}", json={}).status_code == 200


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[Bench]:
    with ExitStack() as stack:
        yield Bench(tmp_path, stack)


@pytest.mark.promise(
    "After all parts have confirmed STOP, nothing reaches a part's function, by whatever way it was said"
)
def test_nothing_is_heard_after_all_have_confirmed(
    robot: Bench, monkeypatch: pytest.MonkeyPatch, record_property: Callable[[str, object], None]
) -> None:
    for name, value in robot.env.items():
        monkeypatch.setenv(name, value)
    robot.begin()
    ways = (by_command, by_class_command, by_socket, by_call, by_open_page)
    for say in ways:
        say(robot, "stop")
        until(lambda: not robot.tell("status")["silent"])
        before = robot.heard()
        for _ in range(LOOKS):
            assert robot.tell("status")["stopped"]
        assert robot.heard() == before, say.__name__
        say(robot, "go")
        until(lambda before=before: robot.heard() > before)  # type: ignore[misc]
    record_property("tried", len(ways))
    record_property("held", len(ways))
