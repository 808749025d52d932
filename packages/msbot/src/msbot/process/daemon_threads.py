"""Threads for work that may hang (a database, a disk): the process ends without waiting for them.

The interpreter waits for the executors of `concurrent.futures` when it exits, so a database server that does not answer
would keep the process alive for ever.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import LazyLoader
from queue import SimpleQueue
from threading import Lock, Thread
from types import ModuleType
from typing import ParamSpec, TypeVar

_P = ParamSpec("_P")
_T = TypeVar("_T")


class DaemonThreads(Executor):
    """An executor whose threads nobody waits for.

    Args:
        most: the largest number of threads; each is started when it is needed.
        name: the name of the threads.
    """

    def __init__(self, most: int, name: str) -> None:
        self._most = most
        self._name = name
        self._jobs: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        self._lock = Lock()
        self._threads = 0
        self._unfinished = 0
        self._is_shut = False

    def submit(self, fn: Callable[_P, _T], /, *args: _P.args, **kwargs: _P.kwargs) -> Future[_T]:
        """See `Executor.submit`."""
        future: Future[_T] = Future()

        def job() -> None:
            if not future.set_running_or_notify_cancel():
                return
            try:
                result = fn(*args, **kwargs)
            except BaseException as error:
                future.set_exception(error)
            else:
                future.set_result(result)

        with self._lock:
            if self._is_shut:
                raise RuntimeError(f"{self._name}: nothing is done any more")
            if self._threads < min(self._most, self._unfinished + 1):
                self._start_thread()
            self._unfinished += 1
        self._jobs.put(job)
        return future

    def shutdown(self, wait: bool = False, *, cancel_futures: bool = False) -> None:  # noqa: ARG002 - `Executor`'s own
        """Take no more work; work already submitted is done if the process lasts that long."""
        with self._lock:
            if self._is_shut:
                return
            self._is_shut = True
            for _ in range(self._threads):
                self._jobs.put(None)

    def _start_thread(self) -> None:
        """Have one more; the system may refuse it now and grant it next time, and those that there are do the work."""
        try:
            Thread(target=self._work, name=self._name, daemon=True).start()
        except RuntimeError:
            if not self._threads:
                raise
        else:
            self._threads += 1

    def _work(self) -> None:
        while (job := self._jobs.get()) is not None:
            job()
            with self._lock:
                self._unfinished -= 1


# Modules of others that are loaded when something of them is used, not when they are imported.
#
# For libraries that import what only some of their users need: the websocket server of the page brings the client's
# half along, with two HTTP clients. The import system's own `LazyLoader` does it, so the module is whole, only later.


def load_lazily(*names: str) -> None:
    """Have the first import of each of these modules load nothing: the first use of it does, or a second import.

    To be called before whoever imports them. A module that is loaded already, or not installed, stays so.
    """
    sys.meta_path.insert(0, _LazyFinder(names))


def leave_out(*names: str) -> None:
    """Have the import of each of these modules fail, for libraries that try it and do without.

    A module that is loaded already stays.
    """
    for name in names:
        sys.modules.setdefault(name, None)  # type: ignore[arg-type]


class _LazyFinder:
    """Finds what others find, and has it loaded later."""

    def __init__(self, names: Sequence[str]) -> None:
        self._names = set(names)

    def find_spec(
        self, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """As the import system asks for it."""
        if fullname not in self._names:
            return None
        self._names.discard(fullname)
        spec = PathFinder.find_spec(fullname, path, target)
        if spec is not None and spec.loader is not None:
            spec.loader = LazyLoader(spec.loader)
        return spec
