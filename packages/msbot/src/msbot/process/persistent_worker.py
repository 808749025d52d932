"""A worker process that stays for a while, for questions that come one after the other, as when a slider is drawn.

Starting a worker takes a second on a busy computer, so the one that has answered waits for the next question, and may
remember what it has read. It ends when nobody has asked for a while, when it needs too much, and with the robot.
"""

from __future__ import annotations

import asyncio
import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from struct import Struct
from threading import Event, Lock, Timer
from typing import IO, Final, ParamSpec, TypeVar

from msbot.process.worker_pool import TooMuchWork, WorkLimits, answer_of, limiter
from msbot_xrce.errors import ConfigError, MsbotError

_P = ParamSpec("_P")
_T = TypeVar("_T")

IDLE_S: Final = 60.0
"""After this time without a question the process ends."""
MOST_WAITING: Final = 8
_SIZE: Final = Struct("<Q")


class PersistentWorker:
    """Calls functions in one process, one after the other, without blocking the event loop.

    Args:
        limits: what one call may use, and the memory of the process.
        idle_s: how long the process waits for the next call.
    """

    def __init__(self, limits: WorkLimits, *, idle_s: float = IDLE_S) -> None:
        self._limits = limits
        self._too_much = {
            "late": f"this did not come to an end within {limits.wall_s:g} s; this computer may have too much to do",
            "memory": f"this needs more than {limits.memory_mb} MB of memory",
            "ended": f"this needs more than {limits.cpu_s} s of processor time or {limits.memory_mb} MB of memory",
        }
        self._idle_s = idle_s
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="msbot-kept-worker")  # started when needed
        self._process: subprocess.Popen[bytes] | None = None
        self._idle: Timer | None = None
        self._lock = Lock()
        self._open = 0

    @property
    def is_there(self) -> bool:
        """Whether the process runs."""
        process = self._process
        return process is not None and process.poll() is None

    async def run(self, function: Callable[_P, _T], *args: _P.args, **kwargs: _P.kwargs) -> _T:
        """Call a module-level function, whose arguments and result can be pickled.

        Raises:
            ConfigError: too many are waiting.
            TooMuchWork: it needed more than it may use.
            MsbotError: what the function raised.
            RuntimeError: the function failed in another way; the text has its traceback.
        """
        if self._open > MOST_WAITING:
            raise ConfigError("the robot is busy with what others have asked; try again in a moment")
        call = pickle.dumps((function.__module__, function.__qualname__, args, kwargs))
        self._open += 1
        try:
            kind, value = await asyncio.get_running_loop().run_in_executor(self._thread, self._ask, call)
        finally:
            self._open -= 1
        if kind == "given":
            given: _T = value  # type: ignore[assignment]  # what the function has returned
            return given
        if kind == "refused" and isinstance(value, MsbotError):
            raise value
        if kind in self._too_much:
            raise TooMuchWork(self._too_much[kind])
        raise RuntimeError(f"a worker failed:\n{value}")

    def end(self) -> None:
        """End the process; the next call starts another."""
        with self._lock:
            self._end()

    def _ask(self, call: bytes) -> tuple[str, object]:
        with self._lock:
            if self._idle is not None:
                self._idle.cancel()
            process = self._process
            if process is None or process.poll() is not None:
                process = self._process = self._start()
            is_late = Event()

            def end_it() -> None:
                is_late.set()
                process.kill()

            too_late = Timer(self._limits.wall_s, end_it)
            too_late.daemon = True
            too_late.start()
            answer: tuple[str, object] | None = None
            try:
                assert process.stdin is not None
                assert process.stdout is not None
                with suppress(OSError):  # it has ended: there is no answer
                    _write(process.stdin, call)
                    octets = _read(process.stdout)
                    answer = None if octets is None else pickle.loads(octets)  # ours: written by `_main` below
            finally:
                too_late.cancel()
                if answer is None:
                    self._end()
            self._idle = Timer(self._idle_s, self.end)
            self._idle.daemon = True
            self._idle.start()
            return answer or ("late" if is_late.is_set() else "ended", None)

    def _start(self) -> subprocess.Popen[bytes]:
        limits = self._limits
        command = [
            sys.executable,
            "-P",
            "-m",
            "msbot.process.persistent_worker",
            str(limits.cpu_s),
            str(limits.memory_mb),
        ]
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
        return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment)

    def _end(self) -> None:
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.communicate()


def _write(stream: IO[bytes], octets: bytes) -> None:
    stream.write(_SIZE.pack(len(octets)) + octets)
    stream.flush()


def _read(stream: IO[bytes]) -> bytes | None:
    """The next message; None: the other side has ended."""
    head = stream.read(_SIZE.size)
    if len(head) < _SIZE.size:
        return None
    (size,) = _SIZE.unpack(head)
    octets = stream.read(size)
    return octets if len(octets) == size else None


def _main(cpu_s: int, memory_mb: int, source: IO[bytes], target: IO[bytes]) -> None:
    limit = limiter(cpu_s, memory_mb)
    while (call := _read(source)) is not None:
        _write(target, answer_of(call, limit))


if __name__ == "__main__":
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints must not mix with the answers
    _main(int(sys.argv[1]), int(sys.argv[2]), sys.stdin.buffer, answers)
