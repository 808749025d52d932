"""Curves that somebody asks for by name, also those that nobody has measured yet."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from msbot.recording.curves.names import is_wanted


class WantedCurves:
    """What was asked for, until it is there.

    Args:
        names: of curves, or of ports or slots with all their curves.
        most: so many are shown at the same time.
    """

    def __init__(self, names: Iterable[str], most: int) -> None:
        self.awaited = [name for name in names if name]
        """What of it nobody has measured so far."""
        self._most = most

    def found(self, known: Iterable[str], shown: Sequence[str] = ()) -> list[str]:
        """The curves that are there now and are not shown yet; they are awaited no longer."""
        known = list(known)
        more = [name for name in known if name not in shown and is_wanted(name, self.awaited)]
        self.awaited = [one for one in self.awaited if not any(is_wanted(name, [one]) for name in known)]
        return more[: max(0, self._most - len(shown))]
