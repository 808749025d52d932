"""Whose password is hashed next: everybody in turn, so that nobody's many tries delay another's. Pure.

Hashing is slow on purpose, so tries wait. Each asker (a browser, an address, a person who administers) has a queue of
its own, and the queues have their turn one after the other: whoever sends a hundred tries at once delays another one's
by a single hash.
"""

from __future__ import annotations

from collections import deque
from typing import Generic, TypeVar

Job = TypeVar("Job")

MOST_OF_ONE = 40
"""Tries of one asker that may wait: a class behind one router signs in at once."""
MOST_ALL = 400
"""Tries that may wait in all."""


class HashQueue(Generic[Job]):
    """See the module's docstring."""

    def __init__(self) -> None:
        self._waiting: dict[str, deque[Job]] = {}
        """By asker; whose turn it is first."""

    def __len__(self) -> int:
        """How many wait."""
        return sum(map(len, self._waiting.values()))

    def add(self, asker: str, job: Job) -> bool:
        """Have a job wait for its turn; False: too many wait already, and it does not."""
        waiting = self._waiting.get(asker, ())
        if len(waiting) >= MOST_OF_ONE or len(self) >= MOST_ALL:
            return False
        self._waiting.setdefault(asker, deque()).append(job)
        return True

    def next(self) -> Job | None:
        """Whose turn it is, which waits no more; None: nobody waits."""
        if not self._waiting:
            return None
        asker, jobs = next(iter(self._waiting.items()))
        del self._waiting[asker]
        job = jobs.popleft()
        if jobs:  # the next one of theirs after all others
            self._waiting[asker] = jobs
        return job
