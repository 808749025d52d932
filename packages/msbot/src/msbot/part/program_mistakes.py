"""A mistake in a program that MsBOT recognises is one sentence with the program's line, not a traceback."""

from __future__ import annotations

import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from types import TracebackType

from msbot_agent.process.user_folders import own_folders
from msbot_xrce.errors import MsbotError


def line_of(error: BaseException) -> str | None:
    """The innermost line of the program's own code: `my_part.py:12 in measure`."""
    for frame in reversed(traceback.extract_tb(error.__traceback__)):
        if not frame.filename.startswith(own_folders()) and not frame.filename.startswith("<frozen"):
            return f"{Path(frame.filename).name}:{frame.lineno} in {frame.name}".replace(" in <module>", "")
    return None


def sentence(error: BaseException) -> str:
    """A mistake as one line, with the line of the program if it is known."""
    place = line_of(error)
    words = " ".join(str(error).split())
    return words if place is None or place in words else f"{place}: {words}"


def tell_mistakes_as_sentences() -> None:
    """From now on, in this process; a prompt and errors of others are left as they are."""
    if not getattr(sys.excepthook, "is_of_msbot", False):
        sys.excepthook = _as_sentence(sys.excepthook)


_Hook = Callable[[type[BaseException], BaseException, TracebackType | None], object]


def _as_sentence(before: _Hook) -> _Hook:
    def say(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
        if isinstance(error, MsbotError):
            sys.stderr.write(f"{sentence(error)}\n")
        else:
            before(kind, error, trace)

    say.is_of_msbot = True  # type: ignore[attr-defined]  # a function carries what it is told to
    return say
