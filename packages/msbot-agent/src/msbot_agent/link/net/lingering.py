"""Whether a socket that has just been emptied is watched for a moment before the program goes to sleep.

To sleep and to be woken up by the next packet takes a processor some 30 to 50 µs, more than a packet's whole way
through the agent. So where packets usually follow each other faster than that, it is cheaper to look again until the
next one is there, and its answer is earlier. Where they do not, nobody looks: what decides is how long the latest
pauses were.
"""

from __future__ import annotations

from collections.abc import Callable

LINGER_S = 50e-6
"""The longest watch: what it would cost to sleep instead. So a watch in vain at most doubles that cost."""

WAKING_S = 20e-6
"""The part of a pause that was slept through in which the packet was there already."""

LOOKS_MAX = 200
"""Looks in one watch, should the clock stand still."""

_LONG = 8
"""A pause counts as at most so many of the longest watches, so that a few short ones make up for a very long one."""

_WEIGHT = 1 / 8
"""Of the latest pause in the average."""


class Lingering:
    """The pauses between the packets of one socket, and whether it is worth while to wait for the next one awake."""

    __slots__ = ("_longest_s", "_rested_at", "_usual_s")

    def __init__(self, longest_s: float = LINGER_S) -> None:
        """`longest_s`: bound of one watch; 0 = never watch."""
        self._longest_s = longest_s
        self._usual_s = longest_s * _LONG
        self._rested_at: float | None = None

    def woken(self, now: float) -> None:
        """A packet is there, and the program has slept until it came."""
        if self._rested_at is not None:
            self._learn(now - self._rested_at - WAKING_S)
            self._rested_at = None

    def watch(self, look: Callable[[], object], clock: Callable[[], float]) -> bool:
        """Call `look` until it finds something (True), or until it is time to sleep (False)."""
        start = clock()
        if self._usual_s < self._longest_s:
            until = start + self._longest_s
            for _ in range(LOOKS_MAX):
                if look():
                    self._learn(clock() - start)
                    return True
                if clock() >= until:
                    break
        self._rested_at = start
        return False

    def _learn(self, pause_s: float) -> None:
        self._usual_s += (min(pause_s, _LONG * self._longest_s) - self._usual_s) * _WEIGHT
