"""A USB serial adapter that can be pulled out: two pseudo terminals with a wire between them, in the script's loop.

Pulled out, both ends hang up and their names are gone, as those of a real adapter; plugged in, they are new terminals.
"""

from __future__ import annotations

import asyncio
import os
import tty
from contextlib import suppress
from pathlib import Path

MOST_WAITING = 1 << 16
"""Octets that wait for an end that does not read; more are lost, as in a UART."""


class SerialAdapter:
    """The wire between `folder/NAME.master` and `folder/NAME.part`."""

    def __init__(self, folder: Path, name: str) -> None:
        self.master, self.part = folder / f"{name}.master", folder / f"{name}.part"
        self._ends: list[int] = []
        self._slaves: list[int] = []

    def plug(self) -> None:
        """Plug it in."""
        loop = asyncio.get_running_loop()
        for name in (self.master, self.part):
            ours, theirs = os.openpty()
            tty.setraw(theirs)
            os.set_blocking(ours, False)
            self._ends.append(ours)
            self._slaves.append(theirs)
            name.symlink_to(os.ttyname(theirs))
        for index, end in enumerate(self._ends):
            loop.add_reader(end, self._carry, end, self._ends[1 - index])

    def pull(self) -> None:
        """Pull it out."""
        loop = asyncio.get_running_loop()
        for name in (self.master, self.part):
            name.unlink(missing_ok=True)
        for end in self._ends:
            loop.remove_reader(end)
        for end in (*self._ends, *self._slaves):
            os.close(end)
        self._ends.clear()
        self._slaves.clear()

    @staticmethod
    def _carry(source: int, target: int) -> None:
        octets = os.read(source, MOST_WAITING)
        with suppress(BlockingIOError):  # nobody reads at the other end: they are lost
            os.write(target, octets)
