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
from functools import wraps
from pathlib import Path
from types import FrameType
from typing import Any

from sqlalchemy import Engine, event

from msbot.registry.database.pending_change import PendingChange
from msbot.registry.database.writer import Writer

ROOT = Path(__file__).parent.parent
PRODUCT = ROOT / "src" / "msbot"
ONLOOKERS = (ROOT / "tests", ROOT / "bench")
"""What may look something up between two steps of a robot."""
NO_ROBOT_RUNS = PRODUCT / "operations" / "stored_robot.py"


class LoopHeldUp(AssertionError):
    """Somebody waits for the database where the robot cannot go on meanwhile."""


def guard() -> None:
    """From now on every statement and every wait is looked at, in every thread of this process."""
    event.listen(Engine, "before_cursor_execute", lambda _connection, _cursor, statement, *_: _look(statement))
    for of, name in ((Writer, "flush"), (PendingChange, "wait")):
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
    ours = (PRODUCT, *ONLOOKERS)
    files = [file for file in _callers(sys._getframe(1)) if any(map(file.is_relative_to, ours))]
    asker = next(file for file in files if not file.is_relative_to(PRODUCT / "registry") and file != Path(__file__))
    if not any(map(asker.is_relative_to, ONLOOKERS)) and NO_ROBOT_RUNS not in files:
        raise LoopHeldUp(f"{asker.relative_to(PRODUCT)} has the event loop wait for: {what}")


def _callers(frame: FrameType | None) -> Iterator[Path]:
    while frame is not None:
        yield Path(frame.f_code.co_filename)
        frame = frame.f_back
