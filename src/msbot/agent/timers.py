"""When to look at which client again: a heap without one asyncio timer per client."""

from __future__ import annotations

from collections.abc import Hashable, Iterator
from heapq import heappop, heappush
from typing import Generic, TypeVar

MOST_STALE = 256
"""Stale entries that are never thrown out before their time."""

Owner = TypeVar("Owner", bound=Hashable)


class TimerHeap(Generic[Owner]):
    """The next time of every owner, earliest first.

    Moving an owner's time later costs nothing: the old time fires, the owner finds nothing to do and says when to fire
    next. The same goes for an owner that rests: its time stays, and counts again when it has something to do. So there
    is normally one entry per owner, plus a stale one each time it is moved earlier or forgotten. When more than half of
    the entries are stale, they are thrown out.
    """

    __slots__ = ("_due", "_heap", "_number", "_owners", "_resting")

    def __init__(self) -> None:
        self._heap: list[tuple[float, int]] = []
        self._owners: dict[int, Owner] = {}
        self._resting: dict[int, Owner] = {}
        self._due: dict[Owner, tuple[float, int]] = {}
        self._number = 0

    def __len__(self) -> int:
        return len(self._heap)

    def schedule(self, owner: Owner, when: float) -> None:
        """Fire for that owner at `when`, unless it fires earlier anyway."""
        due = self._due.get(owner)
        if due is not None:
            at, number = due
            if at <= when:
                if number in self._resting:
                    self._owners[number] = self._resting.pop(number)
                return
            self._drop(number)
        self._number = number = self._number + 1
        self._due[owner] = (when, number)
        self._owners[number] = owner
        heappush(self._heap, (when, number))
        if len(self._heap) > 2 * len(self._due) + MOST_STALE:
            self._heap = sorted(self._due.values())

    def rest(self, owner: Owner) -> None:
        """Do not fire for that owner until it is scheduled again; cheap, for owners that soon will be."""
        due = self._due.get(owner)
        if due is not None and due[1] in self._owners:
            self._resting[due[1]] = self._owners.pop(due[1])

    def forget(self, owner: Owner) -> None:
        """Do not fire for that owner, and do not keep it alive."""
        due = self._due.pop(owner, None)
        if due is not None:
            self._drop(due[1])

    def next_at(self) -> float | None:
        """When the next owner fires."""
        heap = self._heap
        while heap and heap[0][1] not in self._owners:
            resting = self._resting.pop(heappop(heap)[1], None)
            if resting is not None:
                del self._due[resting]
        return heap[0][0] if heap else None

    def pop_due(self, now: float) -> Iterator[Owner]:
        """The owners whose time has come, each once; they may be scheduled again during the loop, but later than
        `now`."""
        while (when := self.next_at()) is not None and when <= now:
            owner = self._owners.pop(heappop(self._heap)[1])
            del self._due[owner]
            yield owner

    def _drop(self, number: int) -> None:
        self._owners.pop(number, None)
        self._resting.pop(number, None)
