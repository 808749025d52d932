"""A USB-GPIO module on a pseudo terminal: the serial line of the thesis' module, with the simulator behind it."""

from __future__ import annotations

import contextlib
import os
import pty
import select
import threading
from collections.abc import Iterator
from pathlib import Path

from msbot.part.boards.gpio import SimGpio
from msbot.part.boards.numato import NumatoSimulator


class Module:
    """Answers in a thread of its own, as a module does; what it does badly is up to the test."""

    def __init__(self, path: Path, pins: int = 8) -> None:
        self.board = SimGpio(pins)
        self.simulator = NumatoSimulator(self.board)
        self.path = path
        self.piece = 255
        """So many octets at a time are sent."""
        self.silent = False
        self.said: list[bytes] = []
        """What came from the computer."""
        self._closing, self._close = os.pipe()
        self._ours = -1
        self._thread: threading.Thread | None = None

    def plug_in(self) -> None:
        """Be there."""
        self._ours, theirs = pty.openpty()
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self.path.symlink_to(os.ttyname(theirs))
        os.close(theirs)
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def pull_out(self) -> None:
        """Be gone: the line hangs up."""
        os.write(self._close, b"x")
        assert self._thread is not None
        self._thread.join(10)
        os.read(self._closing, 1)
        os.close(self._ours)
        self.path.unlink()
        self._thread = None

    @property
    def is_there(self) -> bool:
        """Whether it is plugged in."""
        return self._thread is not None

    def end(self) -> None:
        """Pull it out if it is in."""
        if self.is_there:
            self.pull_out()
        os.close(self._closing)
        os.close(self._close)

    def _run(self) -> None:
        while True:
            ready, _, _ = select.select([self._ours, self._closing], [], [])
            if self._closing in ready:
                return
            try:
                received = os.read(self._ours, 255)
            except OSError:  # the computer has closed its end: nobody has the line open now
                if select.select([self._closing], [], [], 0.01)[0]:
                    return
                continue
            self.said.append(received)
            if self.silent:
                continue
            self.simulator.write(received)
            answer = self.simulator.read(0.0)
            for at in range(0, len(answer), self.piece):
                os.write(self._ours, answer[at : at + self.piece])


@contextlib.contextmanager
def plugged_in(path: Path, pins: int = 8) -> Iterator[Module]:
    """A module at that path."""
    module = Module(path, pins)
    module.plug_in()
    try:
        yield module
    finally:
        module.end()
