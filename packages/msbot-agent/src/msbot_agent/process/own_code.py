"""Which code is MsBOT's own: five distributions, each with a package of its own."""

from __future__ import annotations

import sys
from pathlib import Path

PACKAGES = ("msbot_xrce", "msbot_agent", "msbot", "msbot_school", "msbot_web")
"""The import packages, from the lowest up."""
UNDIVIDED = {"msbot_xrce": "xrce", "msbot_web": "web"}
"""Packages that count as one room each; the others are divided into rooms."""


def room_of(name: str) -> str:
    """The room of MsBOT that a module belongs to; the package, for other modules."""
    package, _, rest = name.partition(".")
    if package not in PACKAGES:
        return package
    return UNDIVIDED.get(package) or rest.partition(".")[0] or package


def own_folders() -> tuple[str, ...]:
    """The folders of those that this program has loaded."""
    loaded = (sys.modules.get(name) for name in PACKAGES)
    return tuple(str(Path(one.__file__).parent) for one in loaded if one is not None and one.__file__)
