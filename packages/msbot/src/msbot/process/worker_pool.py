"""Handles input from strangers in a process of its own, with limited memory and time, apart from the robot.

A robot's event loop must not wait for a parser, and no text may cost the robot its memory. So the work is done by
another Python process, whose memory and processor time the system limits; if it needs more, that process ends and the
robot keeps running. Starting one takes some 0.2 s, so this is for what people send now and then.
"""

from __future__ import annotations

import asyncio
import contextlib
import importlib
import math
import os
import pickle
import subprocess
import sys
import traceback
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import BinaryIO, ParamSpec, TypeVar

from msbot_xrce.errors import ConfigError, MsbotError
from msbot_xrce.lazy import dataclass

_P = ParamSpec("_P")
_T = TypeVar("_T")


class TooMuchWork(ConfigError):
    """It needed more than it may use."""


AT_ONCE = 2
"""How many workers of one robot run at the same time."""
MOST_WAITING = 8
"""How many more may wait for their turn; any further one is refused."""


@dataclass(frozen=True, slots=True)
class WorkLimits:
    """What a worker may use."""

    cpu_s: int = 5
    """Seconds of processor time."""
    memory_mb: int = 300
    """Megabytes of memory; not limited on Windows."""
    wall_s: float = 30.0
    """Seconds until it must have answered, even on a busy computer."""


def run_limited(function: Callable[_P, _T], limits: WorkLimits, *args: _P.args, **kwargs: _P.kwargs) -> _T:
    """Call a function in a process of its own, and wait for its result.

    Args:
        function: a module-level function, so that the other process finds it by its name.
        limits: what it may use.
        args: its arguments; like the result, they must be picklable.
        kwargs: likewise.

    Raises:
        TooMuchWork: it needed more than it may use.
        MsbotError: what the function raised.
        RuntimeError: the function failed in another way; the text has its traceback.
    """
    call = pickle.dumps((function.__module__, function.__qualname__, args, kwargs))
    command = [sys.executable, "-P", "-m", "msbot.process.worker_pool", str(limits.cpu_s), str(limits.memory_mb)]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    try:
        done = subprocess.run(
            command, input=call, capture_output=True, timeout=limits.wall_s, check=False, env=environment
        )
    except subprocess.TimeoutExpired:
        raise TooMuchWork(
            f"what was sent did not come to an end within {limits.wall_s:g} s, and is refused; "
            "this computer may have too much to do"
        ) from None
    if done.returncode > 0 and b"MemoryError" not in done.stderr:
        raise RuntimeError(f"a worker failed:\n{done.stderr.decode(errors='replace')}")
    if done.returncode != 0:
        raise _too_much(f"needs more than {limits.cpu_s} s of processor time or {limits.memory_mb} MB of memory")
    kind, value = pickle.loads(done.stdout)  # ours: written by `_main` below
    if kind == "given":
        given: _T = value
        return given
    if kind == "memory":
        raise _too_much(f"needs more than {limits.memory_mb} MB of memory")
    if isinstance(value, MsbotError):
        raise value
    raise RuntimeError(f"a worker failed:\n{value}")


class WorkerPool:
    """Calls functions in processes of their own, a bounded number at a time, without blocking the event loop."""

    def __init__(self, limits: WorkLimits | None = None, *, most_waiting: int = MOST_WAITING) -> None:
        self._most = AT_ONCE + most_waiting
        self._limits = limits or WorkLimits()
        self._threads = ThreadPoolExecutor(AT_ONCE, thread_name_prefix="msbot-workshop")  # started when needed
        self._open = 0

    async def run(self, function: Callable[_P, _T], *args: _P.args, **kwargs: _P.kwargs) -> _T:
        """As `run_limited`.

        Raises:
            ConfigError: too many are running or waiting already.
        """
        if self._open >= self._most:
            raise ConfigError("the robot is busy with what others have sent; try again in a moment")
        self._open += 1
        try:
            loop = asyncio.get_running_loop()
            return await loop.run_in_executor(
                self._threads, lambda: run_limited(function, self._limits, *args, **kwargs)
            )
        finally:
            self._open -= 1


def _too_much(words: str) -> TooMuchWork:
    return TooMuchWork(f"what was sent {words}, and is refused: no text of a person does that")


def answer_of(call: bytes, limit: Callable[[], None]) -> bytes:
    """Do what a pickled call asks for: the answer, pickled, as a pair of its kind and what was given or raised.

    Args:
        call: module, name, arguments.
        limit: limits this process. MsBOT's own modules are imported before: that takes what it takes, and on a busy
            computer would take half a minute for a process that lets all others go first.
    """
    try:
        module, name, args, kwargs = pickle.loads(call)  # from this program's other process
        function: object = importlib.import_module(module)
        for step in name.split("."):
            function = getattr(function, step)
        assert callable(function)
        limit()
        return pickle.dumps(("given", function(*args, **kwargs)))
    except MsbotError as error:
        return pickle.dumps(("refused", error))
    except MemoryError:
        return pickle.dumps(("memory", None))
    except Exception:
        return pickle.dumps(("failed", traceback.format_exc()))


def limiter(cpu_s: int, memory_mb: int) -> Callable[[], None]:
    """What limits this process, to be called before each piece of work: its memory, once; its processor time from then
    on. It gives the robot priority, too."""
    is_limited = False

    def limit() -> None:
        nonlocal is_limited
        try:
            import resource
        except ImportError:
            return  # Windows: only the caller's wait limits the time
        used = resource.getrusage(resource.RUSAGE_SELF)
        longest_s = math.ceil(used.ru_utime + used.ru_stime) + cpu_s
        _, most_s = resource.getrlimit(resource.RLIMIT_CPU)  # of whoever has started the robot: it cannot be raised
        if most_s != resource.RLIM_INFINITY:
            longest_s = min(longest_s, most_s)
        resource.setrlimit(resource.RLIMIT_CPU, (longest_s, most_s))
        if not is_limited:
            is_limited = True
            os.nice(5)  # as the recorder's; one that lets all others go first gets nothing on a busy computer
            with contextlib.suppress(ValueError, OSError):  # macOS refuses a limit below what a process has mapped
                resource.setrlimit(resource.RLIMIT_AS, (memory_mb << 20, memory_mb << 20))

    return limit


def _main(cpu_s: int, memory_mb: int, source: BinaryIO, target: BinaryIO) -> None:
    target.write(answer_of(source.read(), limiter(cpu_s, memory_mb)))
    target.flush()


if __name__ == "__main__":
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints must not mix with the answer
    _main(int(sys.argv[1]), int(sys.argv[2]), sys.stdin.buffer, answers)
