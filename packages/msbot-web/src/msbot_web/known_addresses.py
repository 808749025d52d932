"""From which addresses people who are signed in have come lately: their connections have a share of their own."""

from __future__ import annotations

import time
from collections.abc import Callable

MOST = 1000
KEPT_S = 3600.0


class KnownAddresses:
    """The addresses that came last."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._seen: dict[str, float] = {}

    def note(self, address: str) -> None:
        """Somebody who is signed in has asked for something from there."""
        self._seen.pop(address, None)
        if len(self._seen) >= MOST:
            del self._seen[next(iter(self._seen))]
        self._seen[address] = self._clock()

    def knows(self, address: str) -> bool:
        """Whether that was lately."""
        at = self._seen.get(address)
        return at is not None and self._clock() - at < KEPT_S
