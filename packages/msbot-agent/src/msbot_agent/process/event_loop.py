"""The event loop of a program, which watches sockets and serial lines on every system."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable, Coroutine
from typing import TypeVar

from msbot_agent.process.returned_memory import give_memory_back

_T = TypeVar("_T")


def run_to_end(main: Coroutine[object, object, _T]) -> _T:
    """Run a coroutine to its end, as `asyncio.run` does.

    The loop that Windows gets from `asyncio.run` cannot watch a socket (`add_reader`), which links live on.
    """
    give_memory_back()
    with asyncio.Runner(loop_factory=_loop_factory()) as runner:
        return runner.run(main)


def _loop_factory() -> Callable[[], asyncio.AbstractEventLoop] | None:
    return asyncio.SelectorEventLoop if sys.platform == "win32" else None
