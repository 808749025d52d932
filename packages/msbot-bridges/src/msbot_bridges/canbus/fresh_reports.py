"""Which reports of a node say what became of STOP. Pure.

Nodes that report by themselves say nothing of an order that has not reached them yet. What was heard before STOP went
out does not count; and of each kind of report neither does the first one after it, which may have been on its way.
"""

from __future__ import annotations

from collections.abc import Hashable
from math import inf


class FreshReports:
    """The reports of one node."""

    def __init__(self) -> None:
        self._stop = 0
        self._told_at = inf
        self._heard = set[Hashable]()

    def told(self, stop: int, now: float) -> None:
        """An order of STOP goes out; only the first one of each STOP counts.

        Args:
            stop: which STOP, from 1.
            now: the time in seconds.
        """
        if stop != self._stop:
            self._stop, self._told_at = stop, now
            self._heard.clear()

    def is_old(self, stop: int, kind: Hashable, heard_at: float) -> bool:
        """Whether a report may be of the time before.

        Args:
            stop: the STOP that holds.
            kind: what tells its reports from others of this node.
            heard_at: when it was heard, by the same clock.
        """
        if stop != self._stop or heard_at < self._told_at:
            return True
        if kind in self._heard:
            return False
        self._heard.add(kind)
        return True
