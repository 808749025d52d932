"""What `msbot demo --script` does to parts, and when."""

from __future__ import annotations

import asyncio
import contextlib
import os
import re
import sys
from collections.abc import Awaitable, Callable, Iterable
from types import TracebackType
from typing import TYPE_CHECKING

import click

from msbot_xrce.errors import MsbotError
from msbot_xrce.lazy import dataclass

if TYPE_CHECKING:
    from msbot_school.demo import DemoRobot


JOIN_S = 10.0
"""So long a step waits for its part to be in; a part that is not by then is pulled out all the same."""
_IN = ("active", "late", "standby", "refused")


@dataclass(frozen=True, slots=True)
class ScriptStep:
    """One thing to do at a given time."""

    at_s: float
    verb: str
    """`plug`, `unplug` or `undo`."""
    part: str
    """Empty for `undo`."""


class ScriptType(click.ParamType[list[ScriptStep]]):
    """`3:unplug AA;12:plug AA`."""

    name = "script"

    def convert(
        self, value: str | list[ScriptStep], param: click.Parameter | None, ctx: click.Context | None
    ) -> list[ScriptStep]:
        """The steps, in order of time."""
        if isinstance(value, list):
            return value
        steps = []
        for text in filter(None, (piece.strip() for piece in value.split(";"))):
            match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*:\s*(?:(plug|unplug)\s+(\S+)|(undo))", text)
            if match is None:
                self.fail(
                    f"{text!r} is not a step; write SECONDS:plug PART, SECONDS:unplug PART or SECONDS:undo, "
                    "for example 3:unplug AA",
                    param,
                    ctx,
                )
            steps.append(ScriptStep(float(match[1]), match[2] or match[4], match[3] or ""))
        return sorted(steps, key=lambda step: step.at_s)


class ScriptRun:
    """Does the steps of a script to a robot.

    Args:
        steps: in order of time.
        robot: whose parts are meant.
        undo: takes the last change back, and says which that was.
        say: takes what a person should know.
    """

    def __init__(
        self,
        steps: Iterable[ScriptStep],
        robot: DemoRobot,
        undo: Callable[[], Awaitable[str]],
        say: Callable[[str], None],
    ) -> None:
        self._left = list(steps)
        self._robot = robot
        self._undo = undo
        self._say = say
        self._changed = asyncio.Event()
        robot.on_event(lambda _: self._changed.set())

    async def run(self) -> None:
        """Do each step at its time; one whose time comes before the parts are plugged in waits for that, and a part is
        not pulled out before it is in."""
        loop = asyncio.get_running_loop()
        begin = loop.time()
        await self._robot.begun.wait()
        while self._left:
            step = self._left[0]
            await asyncio.sleep(max(0.0, begin + step.at_s - loop.time()))
            self._left.pop(0)
            if step.verb == "unplug":
                await self._until_in(step.part)
            await self._do(step)

    async def _until_in(self, part: str) -> None:
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(JOIN_S):
                while self._robot.is_plugged(part) and self._state_of(part) not in _IN:
                    self._changed.clear()
                    await self._changed.wait()

    def _state_of(self, part: str) -> str:
        return next((one.state for one in self._robot.snapshot().parts if one.name == part), "")

    def end(self) -> None:
        """Say which steps were never done."""
        if self._left:
            steps = "; ".join(map(_words, self._left))
            self._say(f"--script: the demo has ended before {steps}")

    async def _do(self, step: ScriptStep) -> None:
        match step.verb:
            case "plug" if not self._robot.plug(step.part):
                self._say(f"--script: {_words(step)} does nothing: {step.part} is plugged in already")
            case "unplug" if not self._robot.unplug(step.part):
                self._say(f"--script: {_words(step)} does nothing: {step.part} is not plugged in")
            case "undo":
                try:
                    self._say(await self._undo())
                except MsbotError as error:
                    self._say(f"undo: {error}")


def _words(step: ScriptStep) -> str:
    return f"{step.at_s:g}:{step.verb} {step.part}".rstrip()


# Single key presses from the terminal, without waiting for Enter.


if sys.platform != "win32":
    import termios
    import tty


class KeyPresses:
    """While open, calls `pressed` in the event loop with every key; does nothing if stdin is not a terminal."""

    def __init__(self, pressed: Callable[[str], None]) -> None:
        self._pressed = pressed
        self._saved: list[int | list[bytes | int]] | None = None

    def __enter__(self) -> KeyPresses:
        if sys.platform == "win32" or not sys.stdin.isatty():
            return self
        descriptor = sys.stdin.fileno()
        self._saved = termios.tcgetattr(descriptor)
        tty.setcbreak(descriptor)
        asyncio.get_running_loop().add_reader(descriptor, self._read)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._saved is not None and sys.platform != "win32":
            descriptor = sys.stdin.fileno()
            asyncio.get_running_loop().remove_reader(descriptor)
            termios.tcsetattr(descriptor, termios.TCSADRAIN, self._saved)

    def _read(self) -> None:
        for key in os.read(sys.stdin.fileno(), 64).decode(errors="replace"):
            self._pressed(key)
