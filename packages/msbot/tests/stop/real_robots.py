"""Robots whose masters and parts are processes: one part speaks 100 times a second, another one notes what it hears.

The one that hears writes an octet into a file for each sample that its function gets. After all have confirmed STOP the
file may not grow, until GO; the one that speaks writes one for each sample that it has sent.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Protocol
from unittest import mock

from tests.hostile.robot import Robot, until
from tests.stop.oracle import Verdict

SPEAKS = """
from pathlib import Path
from msbot import HelloWorld, Part

said = open("said", "ab", buffering=0)
button = Path("button")
part = Part("ABCD", robot="MSBOT_MASTER", local_name="AA")

@part.every(0.01)
def speak():
    part.publish("out", HelloWorld(index=1, message="on"))
    said.write(b".")
    if button.exists():
        button.unlink()
        part.say_stop()

part.run()
"""
HEARS = """
from msbot import HelloWorld, Part

heard = open("heard", "ab", buffering=0)
part = Part("EFGH", robot="MSBOT_MASTER", local_name="BB")

@part.on("in", HelloWorld)
def hear(message):
    heard.write(b".")

part.run()
"""
PARTS = 2
LOOKS = 30
"""How often the robot is asked for its state before nothing was heard: each takes some milliseconds."""


class Watched(Protocol):
    """A robot, however many masters it has."""

    def heard(self) -> int:
        """Samples that the function has got."""

    def said(self) -> int:
        """Samples that were sent."""

    def tell(self, do: str) -> dict[str, object]:
        """Tell whoever serves it."""


class RealRobot(Robot):
    """A robot with a part that speaks and one that hears."""

    def begin(self, *, password_hash: str = "") -> None:
        """Until samples arrive; it has a page."""
        self.master(page=True, password_hash=password_hash)
        self.begin_parts(self.link)

    def begin_parts(self, link: str) -> None:
        """Start the two parts, until samples arrive."""
        for name, text in (("speaks", SPEAKS), ("hears", HEARS)):
            (self.folder / f"{name}.py").write_text(text)
            errors = self.stack.enter_context((self.folder / f"{name}.log").open("w"))
            program = self.stack.enter_context(
                subprocess.Popen(
                    [sys.executable, f"{name}.py"],
                    cwd=self.folder,
                    stdout=subprocess.DEVNULL,
                    stderr=errors,
                    env={**os.environ, **self.env, "MSBOT_LINK": link},
                )
            )
            self.stack.callback(program.kill)
        until(lambda: self.heard() > 0)

    def heard(self) -> int:
        """See `Watched`."""
        return _size(self.folder / "heard")

    def said(self) -> int:
        """See `Watched`."""
        return _size(self.folder / "said")

    def tell(self, do: str) -> dict[str, object]:
        """See `Robot`; from wherever this robot is."""
        with mock.patch.dict(os.environ, self.env):
            return super().tell(do)


class Trial:
    """One STOP of some robots, from before it until GO."""

    def __init__(self, *robots: Watched) -> None:
        self._robots = robots
        at = self._heard()
        until(lambda: all(self._since(at).values()))
        self.verdict = Verdict(None, before=self._since(at))
        self._at, self._sent = self._heard(), self._said()

    def all_confirm(self) -> None:
        """Wait until all parts have confirmed: from now on nothing may be heard."""
        self.until_confirmed()
        self._at, self._sent = self._heard(), self._said()

    def until_confirmed(self) -> None:
        """Wait until all parts have confirmed, once more perhaps: those that came back to another master."""
        until(lambda: all(_is_confirmed(robot.tell("status")) for robot in self._robots))

    def go(self, say_go: Callable[[], object] | None = None) -> Verdict:
        """A while; then GO, said like that if wished. What came of it."""
        for _ in range(LOOKS):
            assert all(robot.tell("status")["stopped"] for robot in self._robots)
        self.verdict.after = self._since(self._at)
        self.verdict.on_the_way = min(said - at for said, at in zip(self._said(), self._sent, strict=True))
        at = self._heard()
        if say_go is not None:
            say_go()
        else:
            for robot in self._robots:
                robot.tell("go")
        until(lambda: all(self._since(at).values()))
        self.verdict.again = self._since(at)
        return self.verdict

    def _heard(self) -> dict[str, int]:
        return {f"robot {number}": robot.heard() for number, robot in enumerate(self._robots, 1)}

    def _said(self) -> list[int]:
        return [robot.said() for robot in self._robots]

    def _since(self, at: dict[str, int]) -> dict[str, int]:
        return {name: count - at[name] for name, count in self._heard().items()}


def _is_confirmed(status: dict[str, object]) -> bool:
    return bool(status["stopped"]) and not status["silent"] and status["told"] == PARTS


def _size(file: Path) -> int:
    return file.stat().st_size if file.exists() else 0
