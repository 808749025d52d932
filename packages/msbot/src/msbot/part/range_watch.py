"""Whether what a program publishes is in the range that the library declares for the port.

The ranges come with the configuration, as settings `PORT.range.FIELD`. A value outside of one is published as it is,
because only the program knows what is wrong; it is counted, and said once for each field. Pure.
"""

from __future__ import annotations

from collections.abc import Mapping

from msbot.part.join.pnp_messages import RANGE_MARK
from msbot.part.messages.message import Message


class RangeWatch:
    """See the module's docstring; for one part."""

    def __init__(self) -> None:
        self.count = 0
        """Messages with a value outside of its range."""
        self._ranges: dict[str, dict[str, tuple[float, float]]] = {}
        self._said: set[tuple[str, str]] = set()

    def configure(self, settings: Mapping[str, str]) -> None:
        """Take the ranges of a configuration: `PORT.range.FIELD` -> least and greatest value; others are left out."""
        self._ranges = {}
        for name, text in settings.items():
            port, _, field = name.partition(RANGE_MARK)
            try:
                least, most = map(float, text.split())
            except ValueError:
                continue  # of a master that says it in another way
            self._ranges.setdefault(port, {})[field] = least, most

    def look(self, port: str, message: Message) -> str:
        """A sentence about a value that is outside of its range for the first time; empty: there is none."""
        ranges = self._ranges.get(port)
        if ranges is None:
            return ""
        words = ""
        is_outside = False
        for field, (least, most) in ranges.items():
            value = _outside(message, field, least, most)
            if value is None:
                continue
            is_outside = True
            if (port, field) not in self._said:
                self._said.add((port, field))
                words = f"{port}: {field} is published as {value:g}; the robot's library says {least:g} to {most:g}"
        self.count += is_outside
        return words


def _outside(message: Message, way: str, least: float, most: float) -> float | None:
    """The value of a field (`pose.x`), or the first of a list, that is out of range; None: there is none."""
    found: object = message
    for name in way.split("."):
        found = getattr(found, name, None)
    values = found if isinstance(found, list) else [found]
    numbers = (one for one in values if isinstance(one, int | float) and not isinstance(one, bool))
    return next((one for one in numbers if not least <= one <= most), None)
