"""The signals that end a program in good order: Ctrl-C, SIGTERM, and a terminal that is closed (SIGHUP)."""

from __future__ import annotations

import asyncio
import contextlib
import ctypes
import gc
import signal
import sys
import threading
import time
from collections.abc import Callable, Coroutine, Iterator, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import TypeVar

from msbot_agent.process.direct_loop import DirectLoop

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


# Has the C library give large pieces of memory back to the system as soon as they are free.
#
# glibc takes pieces from 128 kB up from the system one by one, and gives each back when it is free. But whenever such a
# piece is freed it raises that bound to the piece's size, and from then on keeps what is smaller in its heap, where one
# small piece that is still used holds everything below it: after a flood of connections by TLS (256 kB each in asyncio)
# the process would stay as large as it was at worst. With a bound that somebody has set it does not raise it.


LARGE = 128 * 1024
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3


def give_memory_back() -> None:
    """Do so in this process from now on; nothing where the C library is another one."""
    if sys.platform != "linux":
        return
    set_option = getattr(ctypes.CDLL(None), "mallopt", None)
    if set_option is not None:
        set_option(_M_MMAP_THRESHOLD, LARGE)
        set_option(_M_TRIM_THRESHOLD, LARGE)


# Has Python look for garbage less often.
#
# Python begins a search whenever 700 objects more are there than were. Each message of a robot makes some that are gone
# a moment later, by their counts of references; a search finds nothing, and with many parts what it goes through has
# left the processor's caches meanwhile. The bound for the young ones is what a thousand parts make when they beat at
# once. What only a search can free is pages that were closed, some 3,000 objects and up to a megabyte each: those that
# were open at a search of the middle generation wait for one of everything, which comes soon enough to keep them few.


YOUNG, MIDDLE, OLD = 10_000, 2, 1
"""Objects more than at the last search; searches until also the next generation is searched, and the last one."""


def collect_seldom() -> None:
    """Do so in this process from now on; what is there already is never searched again."""
    gc.freeze()
    gc.set_threshold(YOUNG, MIDDLE, OLD)


# The event loop of a program, which watches sockets and serial lines on every system.


_T = TypeVar("_T")


def run_to_end(
    main: Coroutine[object, object, _T], loop_factory: Callable[[], asyncio.AbstractEventLoop] | None = None
) -> _T:
    """Run a coroutine to its end, as `asyncio.run` does.

    The loop that Windows gets from `asyncio.run` cannot watch a socket (`add_reader`), which links live on.
    """
    give_memory_back()
    collect_seldom()
    with asyncio.Runner(loop_factory=loop_factory or _loop_factory()) as runner:
        return runner.run(main)


def _loop_factory() -> Callable[[], asyncio.AbstractEventLoop] | None:
    return DirectLoop if sys.platform in {"linux", "win32"} else None


# One error in place of the group that a `TaskGroup` makes of it.


@contextmanager
def ungrouped(kind: type[Exception]) -> Iterator[None]:
    """Raise the first error of that kind by itself, when a group holds nothing but such errors.

    Not `except*`: up to Python 3.11.3, which Debian 12 and Raspberry Pi OS have, an error raised there comes out in a
    group again.

    Raises:
        Exception: of that kind; other groups come out as they are.
    """
    try:
        yield
    except BaseExceptionGroup as group:
        found, rest = group.split(kind)
        if found is None or rest is not None:
            raise
        raise _first(found) from None


def _first(group: BaseExceptionGroup[BaseException]) -> BaseException:
    leaves: Sequence[BaseException] = group.exceptions
    while isinstance(leaves[0], BaseExceptionGroup):
        leaves = leaves[0].exceptions
    return leaves[0]
