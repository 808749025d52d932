"""Frames of other equipment on a bus, in the words of whoever brings its protocol; none is known here."""

from __future__ import annotations

from collections.abc import Callable
from types import FunctionType

from msbot_agent.link.can.protocol import Frame
from msbot_agent.startup.extensions import extensions

GROUP = "frame_words"
"""Each is a function that takes a frame, and returns what it says, or an empty text."""


def foreign_words() -> Callable[[Frame], str]:
    """What says what a frame of other equipment means: the first that knows."""
    known = list(extensions().all(GROUP, FunctionType).values())
    return lambda frame: next((words for one in known if (words := one(frame))), "")
