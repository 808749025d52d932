"""A thread in which the library of a world may wait for its bus, while the event loop goes on.

Jobs come in through a bounded queue, STOP in front of all others; what the thread has to say goes into the loop
through another bounded queue.
"""

from __future__ import annotations

import asyncio
import logging
import threading
from collections import deque
from collections.abc import Callable

MOST_JOBS = 1000
"""Jobs that wait for the thread; beyond, the oldest of those that are not urgent is dropped and counted."""
MOST_NEWS = 10_000
"""What waits for the loop; beyond, the oldest is dropped and counted."""
END_S = 5.0
"""Longest wait for the thread at the end."""

_log = logging.getLogger("msbot.part")
Job = Callable[[], object]


class WorldThread:
    """One thread.

    Args:
        name: for people who list threads.
    """

    def __init__(self, name: str) -> None:
        self.dropped = 0
        """Jobs and news that found no room."""
        self._name = name
        self._loop = asyncio.get_running_loop()
        self._urgent = deque[Job]()
        self._jobs = deque[Job]()
        self._news = deque[Job]()
        self._is_called = False
        self._wake = threading.Condition()
        self._is_ended = False
        self._failure: asyncio.Future[None] = self._loop.create_future()
        self._thread: threading.Thread | None = None

    # From the loop.

    async def run(self, main: Callable[[], None]) -> None:
        """Run `main` in the thread until it returns, or until cancelled; raises what it raises.

        `main` returns soon after `is_ended` has become true.
        """
        self._thread = threading.Thread(target=self._main, args=(main,), name=self._name, daemon=True)
        self._thread.start()
        try:
            await self._failure
        finally:
            self.end()
            if self._thread.is_alive():
                await asyncio.to_thread(self._thread.join, END_S)

    def end(self) -> None:
        """Tell the thread to end."""
        with self._wake:
            self._is_ended = True
            self._wake.notify_all()

    def post(self, job: Job, *, urgent: bool = False) -> None:
        """Have the thread do something; what is urgent goes before everything else. From any thread."""
        with self._wake:
            if urgent:
                self._urgent.append(job)
            else:
                if len(self._jobs) >= MOST_JOBS:
                    self._jobs.popleft()
                    self.dropped += 1
                self._jobs.append(job)
            self._wake.notify_all()

    # From the thread.

    @property
    def is_ended(self) -> bool:
        """Whether the thread is to end."""
        return self._is_ended

    def work(self) -> None:
        """Do the jobs that wait now; a job that fails is named in the log, and the others are done."""
        for _ in range(MOST_JOBS):
            with self._wake:
                queue = self._urgent or self._jobs
                if not queue:
                    return
                job = queue.popleft()
            try:
                job()
            except Exception as error:  # of the library of the world
                _log.warning("%s: %s: %s", self._name, type(error).__name__, error)

    def wait(self, timeout_s: float) -> None:
        """Wait for a job, or so long."""
        with self._wake:
            self._wake.wait_for(lambda: self._urgent or self._jobs or self._is_ended, timeout_s)

    def tell(self, news: Job) -> None:
        """Have the loop do something."""
        with self._wake:
            if len(self._news) >= MOST_NEWS:
                self._news.popleft()
                self.dropped += 1
            self._news.append(news)
            if self._is_called:
                return
            self._is_called = True
        self._call_loop(self._take_news)

    def _take_news(self) -> None:
        with self._wake:
            self._is_called = False
            taken = list(self._news)
            self._news.clear()
        for news in taken:
            try:
                news()
            except Exception as error:  # of one device's report; what others have reported is told all the same
                _log.warning("%s: %s: %s", self._name, type(error).__name__, error)

    def _call_loop(self, function: Job) -> None:
        try:
            self._loop.call_soon_threadsafe(function)
        except RuntimeError:
            _log.debug("%s: the loop has ended", self._name)

    def _main(self, main: Callable[[], None]) -> None:
        error: Exception | None = None
        try:
            main()
        except Exception as failure:  # handed over to whoever awaits `run`
            error = failure
        self._call_loop(lambda: self._ended(error))

    def _ended(self, error: Exception | None) -> None:
        if self._failure.done():
            return
        if error is None:
            self._failure.set_result(None)
        else:
            self._failure.set_exception(error)
