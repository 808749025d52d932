"""One thread for each bus: drivers block, the event loop does not.

Everything on one bus is done in one thread, one job after the other, as the wires require. The queue is bounded. A bus
that hangs blocks only its own thread; the thread is a daemon, so that the program can still end.
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import ParamSpec, TypeVar

from msbot.hardware.hardware_fault import HardwareFault

_P = ParamSpec("_P")
_T = TypeVar("_T")

MOST_WAITING = 64
"""Most waiting jobs of one bus: each part on it has at most one for reading and one for writing."""


class BusWorker(Executor):
    """An executor of one daemon thread that starts with its first job."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._jobs: queue.Queue[Callable[[], None] | None] = queue.Queue(MOST_WAITING)
        self._thread: threading.Thread | None = None

    def submit(self, fn: Callable[_P, _T], /, *args: _P.args, **kwargs: _P.kwargs) -> Future[_T]:
        """Run a job in the bus's thread.

        A job that finds no room fails with HardwareFault at once: the bus hangs.
        """
        future: Future[_T] = Future()

        def work() -> None:
            if not future.set_running_or_notify_cancel():
                return
            try:
                future.set_result(fn(*args, **kwargs))
            except BaseException as error:
                future.set_exception(error)

        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name=f"msbot-{self.name}", daemon=True)
            self._thread.start()
        try:
            self._jobs.put_nowait(work)
        except queue.Full:
            future.set_exception(HardwareFault(f"{self.name} hangs: {MOST_WAITING} jobs wait for it"))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the thread once its jobs are done; does not wait for a bus that hangs."""
        if cancel_futures:
            while not self._jobs.empty():
                self._jobs.get_nowait()
        if self._thread is not None and not self._jobs.full():
            self._jobs.put_nowait(None)
            if wait:
                self._thread.join(1.0)

    def _run(self) -> None:
        while (job := self._jobs.get()) is not None:
            job()


class BusWorkers:
    """The threads of one program, by bus."""

    def __init__(self) -> None:
        self._threads: dict[str, BusWorker] = {}

    def of(self, bus: str) -> BusWorker:
        """The thread of that bus."""
        return self._threads.setdefault(bus, BusWorker(bus))

    def end(self) -> None:
        """End all of them."""
        for thread in self._threads.values():
            thread.shutdown()
        self._threads.clear()
