"""When to look at which client again: a heap without one asyncio timer per client."""

from __future__ import annotations

from collections.abc import Hashable, Iterator
from heapq import heappop, heappush
from typing import Generic, TypeVar

Owner = TypeVar("Owner", bound=Hashable)


class TimerHeap(Generic[Owner]):
    """The next time of every owner, earliest first.

    Moving an owner's time later costs nothing: the old time fires, the owner finds nothing to do and says when to
    come again. So there is one entry per owner as a rule, and a stale one more each time it is moved earlier. Stale
    entries are bare numbers: they keep no owner alive.
    """

    __slots__ = ("_due", "_heap", "_number", "_owners")

    def __init__(self) -> None:
        self._heap: list[tuple[float, int]] = []
        self._owners: dict[int, Owner] = {}
        self._due: dict[Owner, tuple[float, int]] = {}
        self._number = 0

    def __len__(self) -> int:
        return len(self._heap)

    def schedule(self, owner: Owner, when: float) -> None:
        """Fire for that owner at `when`, unless it fires earlier anyway."""
        due = self._due.get(owner)
        if due is not None:
            if due[0] <= when:
                return
            del self._owners[due[1]]
        self._number = number = self._number + 1
        self._due[owner] = (when, number)
        self._owners[number] = owner
        heappush(self._heap, (when, number))

    def forget(self, owner: Owner) -> None:
        """Do not fire for that owner."""
        due = self._due.pop(owner, None)
        if due is not None:
            del self._owners[due[1]]

    def next_at(self) -> float | None:
        """When the next owner fires, or a stale entry does."""
        return self._heap[0][0] if self._heap else None

    def pop_due(self, now: float) -> Iterator[Owner]:
        """The owners whose time has come, each once; they may be scheduled again meanwhile, but later than `now`."""
        while self._heap and self._heap[0][0] <= now:
            _, number = heappop(self._heap)
            owner = self._owners.pop(number, None)
            if owner is not None:
                del self._due[owner]
                yield owner
