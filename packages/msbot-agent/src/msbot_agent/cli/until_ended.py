"""How a command runs something until it ends, Ctrl-C or SIGTERM, and what it says when that goes wrong."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Iterable

from msbot_agent.process.end_signals import on_end_signal, ungrouped
from msbot_xrce.errors import MsbotError


async def run_until_signal(
    work: Coroutine[object, object, None],
    *,
    beside: Iterable[Coroutine[object, object, None]] = (),
    ready: asyncio.Event | None = None,
    say: Callable[[], None] | None = None,
) -> None:
    """Run until the work ends, or until SIGINT, SIGTERM or SIGHUP, which end it cleanly.

    Args:
        work: what to run.
        beside: what else to run as long as the work runs.
        ready: set by the work when it is up.
        say: called then.

    Raises:
        MsbotError: the error that ended the work, taken out of its exception group.
    """
    with ungrouped(MsbotError):
        async with asyncio.TaskGroup() as tasks:
            working = tasks.create_task(work)
            helpers = [tasks.create_task(helping) for helping in beside]
            working.add_done_callback(lambda _: [helper.cancel() for helper in helpers])
            on_end_signal(working.cancel)
            if ready is not None and say is not None:
                greeting = tasks.create_task(_say_when(ready, say))
                working.add_done_callback(lambda _: greeting.cancel())


async def _say_when(ready: asyncio.Event, say: Callable[[], None]) -> None:
    await ready.wait()
    say()
