"""A real agent behind real transports of this machine, for the cases that are about the transport."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from msbot_agent.agent import Agent
from msbot_agent.link import Link, Signal
from msbot_agent.space import MemorySpace

PATIENCE_S = 60
"""After this a test has failed; nothing waits for it otherwise."""


@asynccontextmanager
async def serving(link: Link) -> AsyncIterator[Agent]:
    """A real agent on that link; the block begins when the link is open."""
    is_open = asyncio.Event()
    agent = Agent(MemorySpace(), signal=lambda _link, signal, *_: is_open.set() if signal is Signal.LINK_UP else None)
    agent.add_link(link)
    task = asyncio.create_task(agent.run())
    try:
        async with asyncio.timeout(PATIENCE_S):
            await is_open.wait()
            yield agent
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
