"""When to look at which client again: a heap without one asyncio timer per client."""

from __future__ import annotations

from collections.abc import Hashable, Iterator
from heapq import heappop, heappush
from typing import Any, Generic, TypeVar

MOST_STALE = 256
"""Stale entries that are never thrown out before their time."""

Owner = TypeVar("Owner", bound=Hashable)

_Entry = list[Any]
"""When, a number of its own, the owner (None: the entry is stale), and whether it fires (no: stale, or at rest)."""
_OWNER, _FIRES = 2, 3


class TimerHeap(Generic[Owner]):
    """The next time of every owner, earliest first.

    Moving an owner's time later costs nothing: the old time fires, the owner finds nothing to do and says when to fire
    next. The same goes for an owner that rests: its time stays, and counts again when it has something to do. So there
    is normally one entry per owner, plus a stale one each time it is moved earlier or forgotten. When more than half of
    the entries are stale, they are thrown out.
    """

    __slots__ = ("_due", "_heap", "_number")

    def __init__(self) -> None:
        self._heap: list[_Entry] = []
        self._due: dict[Owner, _Entry] = {}
        self._number = 0

    def __len__(self) -> int:
        return len(self._heap)

    def schedule(self, owner: Owner, when: float) -> None:
        """Fire for that owner at `when`, unless it fires earlier anyway."""
        due = self._due
        entry = due.get(owner)
        if entry is not None:
            if entry[0] <= when:
                entry[_FIRES] = True
                return
            entry[_FIRES], entry[_OWNER] = False, None
        self._number = number = self._number + 1
        due[owner] = entry = [when, number, owner, True]
        heappush(self._heap, entry)
        if len(self._heap) > 2 * len(due) + MOST_STALE:
            self._heap = sorted(due.values())

    def rest(self, owner: Owner) -> None:
        """Do not fire for that owner until it is scheduled again; cheap, for owners that soon will be."""
        entry = self._due.get(owner)
        if entry is not None:
            entry[_FIRES] = False

    def forget(self, owner: Owner) -> None:
        """Do not fire for that owner, and do not keep it alive."""
        entry = self._due.pop(owner, None)
        if entry is not None:
            entry[_FIRES], entry[_OWNER] = False, None

    def next_at(self) -> float | None:
        """When the next owner fires."""
        heap = self._heap
        while heap and not heap[0][_FIRES]:
            resting = heappop(heap)[_OWNER]
            if resting is not None:
                del self._due[resting]
        when: float | None = heap[0][0] if heap else None
        return when

    def pop_due(self, now: float) -> Iterator[Owner]:
        """The owners whose time has come, each once; they may be scheduled again during the loop, but later than
        `now`."""
        while (when := self.next_at()) is not None and when <= now:
            owner: Owner = heappop(self._heap)[_OWNER]
            del self._due[owner]
            yield owner
