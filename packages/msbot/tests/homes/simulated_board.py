"""A simulated board at a serial port: MicroPython's VM in node (`board.mjs`) behind a pseudo terminal."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import tty
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tests.homes.runners import NODE, VM

SCRIPT = Path(__file__).with_name("board.mjs")


class SimulatedBoard:
    """One board, from plugging in to unplugging.

    Args:
        settings: see `board.mjs`.
    """

    def __init__(self, **settings: Any) -> None:
        assert NODE is not None
        ours, theirs = os.openpty()
        tty.setraw(theirs)
        os.set_blocking(ours, False)
        self.port = os.ttyname(theirs)
        self._theirs = theirs
        self._process = subprocess.Popen([NODE, str(SCRIPT), json.dumps({"vm": str(VM), **settings})], stdin=ours)
        os.close(ours)

    def unplug(self) -> None:
        """End it; whoever has its port open notices."""
        self._process.kill()
        self._process.wait(30)
        with contextlib.suppress(OSError):
            os.close(self._theirs)


@contextlib.contextmanager
def simulated_board(**settings: Any) -> Iterator[SimulatedBoard]:
    """A board that is unplugged at the end."""
    board = SimulatedBoard(**settings)
    try:
        yield board
    finally:
        board.unplug()
