"""Sees to it that no event loop of a robot waits for its database.

Two things make a loop wait: a statement that is executed on its thread, and waiting there for the thread that writes.
Both are an error when the product does it. Not meant is a test or a bench that looks something up between two steps of
the robot (the innermost caller outside the registry counts), and a command that works on the database of a robot that
does not run.
"""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Iterator
from enum import Enum, auto
from functools import cache, wraps
from pathlib import Path
from types import FrameType
from typing import Any

from sqlalchemy import Engine, event

from msbot.registry.database.database_writer import DatabaseWriter, PendingChange
from tests import FOLDERS, ROOT

PRODUCT = ROOT / "packages"
ONLOOKERS = (*FOLDERS, ROOT / "bench")
"""What may look something up between two steps of a robot."""
NO_ROBOT_RUNS = PRODUCT / "msbot/src/msbot/operations/stored_robot.py"


class LoopHeldUp(AssertionError):
    """Somebody waits for the database where the robot cannot go on meanwhile."""


def guard() -> None:
    """From now on every statement and every wait is looked at, in every thread of this process."""
    event.listen(Engine, "before_cursor_execute", lambda _connection, _cursor, statement, *_: _look(statement))
    for of, name in ((DatabaseWriter, "flush"), (PendingChange, "wait")):
        setattr(of, name, _looked_at(getattr(of, name)))


def _looked_at(method: Any) -> Any:
    @wraps(method)
    def call(*args: object, **kwargs: object) -> object:
        _look(method.__qualname__)
        return method(*args, **kwargs)

    return call


def _look(what: str) -> None:
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return
    asker = ""
    for file in _callers(sys._getframe(1)):
        whose = _whose(file)
        if whose is Whose.NO_ROBOT or (whose is Whose.ONLOOKER and not asker):
            return
        if whose is Whose.ROBOT:
            asker = asker or file
    raise LoopHeldUp(f"{Path(asker).relative_to(PRODUCT)} has the event loop wait for: {what}")


class Whose(Enum):
    """Whose a file of a caller is."""

    ROBOT = auto()
    NO_ROBOT = auto()
    ONLOOKER = auto()
    ASKED = auto()
    """The registry itself, which does what others ask for, and this file."""
    OTHERS = auto()


@cache
def _whose(file: str) -> Whose:
    """Found out once for each file: there are a dozen of them below every statement of every test."""
    path = Path(file)
    if path in (Path(__file__), NO_ROBOT_RUNS):
        return Whose.NO_ROBOT if path == NO_ROBOT_RUNS else Whose.ASKED
    if any(map(path.is_relative_to, ONLOOKERS)):
        return Whose.ONLOOKER
    if path.is_relative_to(PRODUCT):
        return Whose.ASKED if path.is_relative_to(PRODUCT / "msbot/src/msbot/registry") else Whose.ROBOT
    return Whose.OTHERS


def _callers(frame: FrameType | None) -> Iterator[str]:
    while frame is not None:
        yield frame.f_code.co_filename
        frame = frame.f_back
