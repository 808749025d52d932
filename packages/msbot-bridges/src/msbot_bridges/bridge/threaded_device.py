"""A simulated device in a thread of its own: its world's library waits for the bus, and the event loop must not."""

from __future__ import annotations

import asyncio
import threading
from abc import ABC, abstractmethod


class ThreadedDevice(ABC):
    """A simulated device whose `run_in_thread` waits, and returns soon after `_ended` is set."""

    def __init__(self) -> None:
        self._ended = threading.Event()

    async def run(self) -> None:
        """See `SimulatedDevice`."""
        running = asyncio.create_task(asyncio.to_thread(self.run_in_thread))
        try:
            await asyncio.wait([running])
        finally:
            self.end()
            await asyncio.gather(running, return_exceptions=True)
        running.result()

    def end(self) -> None:
        """Pull it off its bus."""
        self._ended.set()

    @abstractmethod
    def run_in_thread(self) -> None:
        """Run until `end`.

        Raises:
            LinkDown: the bus cannot be opened, or has ended.
        """
