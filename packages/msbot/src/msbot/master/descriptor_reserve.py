"""File descriptors held in reserve, for what must work when a process has no others left."""

from __future__ import annotations

import logging
import os

_log = logging.getLogger(__name__)


class DescriptorReserve:
    """Holds some descriptors, and gives them back when they are needed.

    Args:
        most: how many.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._held: list[int] = []
        self.fill()

    def fill(self) -> None:
        """Hold as many again, as far as there are any."""
        try:
            while len(self._held) < self._most:
                self._held.append(os.open(os.devnull, os.O_RDONLY))
        except OSError as error:
            _log.debug("no descriptor can be held in reserve: %s", error)

    def free_one(self) -> None:
        """Release one for the moment, if any is held."""
        if self._held:
            os.close(self._held.pop())

    def free(self) -> None:
        """Release all of them."""
        while self._held:
            os.close(self._held.pop())
