"""When to look at which client again: a heap without one asyncio timer per client."""

from __future__ import annotations

from collections.abc import Iterator
from heapq import heappop, heappush
from typing import Generic, TypeVar

Owner = TypeVar("Owner")


class TimerHeap(Generic[Owner]):
    """The next time of every owner, earliest first.

    Moving an owner's time later costs nothing: the old time fires, the owner finds nothing to do and says when to
    come again. So there is one entry per owner as a rule, and a stale one more each time it is moved earlier.
    """

    __slots__ = ("_due", "_heap", "_order")

    def __init__(self) -> None:
        self._heap: list[tuple[float, int, Owner]] = []
        self._due: dict[Owner, float] = {}
        self._order = 0

    def __len__(self) -> int:
        return len(self._heap)

    def schedule(self, owner: Owner, when: float) -> None:
        """Fire for that owner at `when`, unless it fires earlier anyway."""
        due = self._due.get(owner)
        if due is not None and due <= when:
            return
        self._due[owner] = when
        self._order += 1
        heappush(self._heap, (when, self._order, owner))

    def forget(self, owner: Owner) -> None:
        """Do not fire for that owner."""
        self._due.pop(owner, None)

    def next_at(self) -> float | None:
        """When the next owner fires (or a forgotten one would have)."""
        return self._heap[0][0] if self._heap else None

    def pop_due(self, now: float) -> Iterator[Owner]:
        """The owners whose time has come, each once; they may be scheduled again meanwhile, but later than `now`."""
        while self._heap and self._heap[0][0] <= now:
            when, _, owner = heappop(self._heap)
            if self._due.get(owner) == when:
                del self._due[owner]
                yield owner
