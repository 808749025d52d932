"""The signals that end a program in good order: Ctrl-C, SIGTERM, and a terminal that is closed (SIGHUP)."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import threading
import time
from collections.abc import Callable
from types import FrameType

_NAMES = ("SIGINT", "SIGTERM", "SIGHUP")


GRACE_S = 3.0
"""How long a loop may be busy before an end signal breaks what it does."""
TWICE_S = 0.5
"""Signals closer together are one: a terminal and a program around this one may both pass it on."""


def on_end_signal(end: Callable[[], object], *, even_if_stuck: bool = False) -> None:
    """Have the running loop call `end` on each of them, where the loop can do that.

    A program that was started with `nohup` ignores SIGHUP, and goes on ignoring it.

    Args:
        end: begins the end; called by the loop.
        even_if_stuck: the loop runs code of others, which may never return: what it does is broken by a
            KeyboardInterrupt, GRACE_S after a signal or at the next one.
    """
    loop = asyncio.get_running_loop()
    stuck = _Stuck(end)
    for name in _NAMES:
        number = getattr(signal, name, None)  # Windows has no SIGHUP
        if number is None or (name == "SIGHUP" and signal.getsignal(number) is signal.SIG_IGN):
            continue
        with contextlib.suppress(NotImplementedError):
            loop.add_signal_handler(number, stuck.heed)
            if even_if_stuck:  # beside the loop's own way, which waits until the loop comes round
                signal.signal(number, stuck.note)
                signal.siginterrupt(number, False)


class _Stuck:
    """Knows whether the loop has come round since a signal."""

    def __init__(self, end: Callable[[], object]) -> None:
        self._end = end
        self._noted_at: float | None = None

    def heed(self) -> None:
        """Called by the loop."""
        self._noted_at = None
        self._end()

    def note(self, _number: int, _frame: FrameType | None) -> None:
        """Called by Python between two steps of whatever the main thread does, with each signal."""
        now = time.monotonic()
        if self._noted_at is None:
            self._noted_at = now
            waiting = threading.Timer(GRACE_S, self._remind, (now,))
            waiting.daemon = True
            waiting.start()
        elif now - self._noted_at > TWICE_S:
            raise KeyboardInterrupt

    def _remind(self, noted_at: float) -> None:
        if self._noted_at == noted_at:
            signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)  # breaks a sleep, too
