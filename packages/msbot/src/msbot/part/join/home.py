"""Where a part runs, and with which MsBOT: a text such as `C 0.1.0`, which it says once it is active. Pure.

It travels as versions do (`part_log`). A master that does not know the kind of text drops it; of a part that says
nothing, the home is not known.
"""

from __future__ import annotations

import sys
from enum import Enum
from typing import Final, NamedTuple

VERSION: Final = "0.1.0"
"""Of MsBOT here; `tools/version.py` writes it."""


class Home(Enum):
    """What runs a part's program; the value is the word on the wire, short enough for one piece with its version."""

    PC = "PC"
    MICROPYTHON = "MPy"
    C = "C"
    BROWSER = "web"
    BRIDGE = "bridge"
    """A bridge, which speaks for a device of another maker."""

    @property
    def label(self) -> str:
        """For people, in a table."""
        return _LABELS[self]


_LABELS: Final = {
    Home.PC: "PC",
    Home.MICROPYTHON: "MicroPython",
    Home.C: "C",
    Home.BROWSER: "browser",
    Home.BRIDGE: "bridge",
}


class ToldHome(NamedTuple):
    """What a part has said of where it runs."""

    home: Home | None = None
    """None: it has not said, or in a word that this version does not know."""
    version: str = ""
    """Of MsBOT there."""

    @property
    def label(self) -> str:
        """The home for a table; empty: not known."""
        return "" if self.home is None else self.home.label


def own_home() -> Home:
    """What runs this program."""
    return Home.BROWSER if sys.platform == "emscripten" else Home.PC


def home_text(home: Home) -> str:
    """What a part says of itself."""
    return f"{home.value} {VERSION}"


def read_home(text: str) -> ToldHome:
    """What a part says, whatever it is."""
    word, _, version = text.strip().partition(" ")
    known = {home.value: home for home in Home}
    return ToldHome(known.get(word), version.strip())
