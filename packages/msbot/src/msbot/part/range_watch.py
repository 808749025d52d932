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
            value = getattr(message, field, None)
            if not isinstance(value, int | float) or isinstance(value, bool) or least <= value <= most:
                continue
            is_outside = True
            if (port, field) not in self._said:
                self._said.add((port, field))
                words = f"{port}: {field} is published as {value:g}; the robot's library says {least:g} to {most:g}"
        self.count += is_outside
        return words
