"""Bounded histories: samples that a reader has not taken yet, and samples that a writer keeps for later readers."""

from __future__ import annotations

from collections import deque

from msbot_agent.space.contract import Sample

FAIR_SHARE = 16 << 10
"""Octets that a reader or writer may keep even when the space is full, so that no single one can take it all."""


class Store:
    """How many octets all histories of a space may keep together."""

    __slots__ = ("limit", "used")

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self.used = 0


class History:
    """The last samples of one reader or writer, as many as its depth and the store allow."""

    __slots__ = ("_depth", "_octets", "_store", "samples")

    def __init__(self, depth: int, store: Store) -> None:
        self.samples: deque[Sample] = deque()
        self._depth = depth
        self._store = store
        self._octets = 0

    def push(self, sample: Sample) -> int:
        """Keep a sample; returns how many were pushed out, possibly this one."""
        samples, store = self.samples, self._store
        samples.append(sample)
        size = len(sample.payload)
        self._octets += size
        store.used += size
        lost = 0
        while len(samples) > self._depth or (store.used > store.limit and self._octets > FAIR_SHARE):
            self.pop()
            lost += 1
        return lost

    def pop(self) -> Sample:
        """Take the oldest one."""
        sample = self.samples.popleft()
        size = len(sample.payload)
        self._octets -= size
        self._store.used -= size
        return sample

    def clear(self) -> None:
        """Forget all samples."""
        self.samples.clear()
        self._store.used -= self._octets
        self._octets = 0
