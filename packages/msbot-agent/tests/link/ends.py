"""Runs links and keeps what they say, for the tests of links with sockets and ports."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from msbot_agent.link import Link, Peer, Signal


class End:
    """One link, what came in over it, and a way to wait for it."""

    def __init__(self, link: Link) -> None:
        self.link = link
        self.packets: asyncio.Queue[tuple[bytes, Peer]] = asyncio.Queue()
        self.signals: asyncio.Queue[tuple[Signal, Peer | None, str]] = asyncio.Queue()
        self.room: asyncio.Queue[Peer | None] = asyncio.Queue()
        link.attach(packet=lambda packet, peer, now: self.packets.put_nowait((packet, peer)))
        link.attach(signal=lambda signal, peer, words, now: self.signals.put_nowait((signal, peer, words)))
        link.attach(room=self.room.put_nowait)

    async def heard(self) -> bytes:
        """The next packet."""
        return (await self.packets.get())[0]

    async def told(self, signal: Signal) -> tuple[Peer | None, str]:
        """The next signal of that kind, others left out: whom it is about, and its words."""
        while True:
            came, peer, words = await self.signals.get()
            if came is signal:
                return peer, words


@asynccontextmanager
async def running(*links: Link) -> AsyncIterator[list[End]]:
    """Run links and wait until each is up."""
    ends = [End(link) for link in links]
    async with asyncio.timeout(20), asyncio.TaskGroup() as group:
        tasks = [group.create_task(link.run()) for link in links]
        for end in ends:
            await end.told(Signal.LINK_UP)
        yield ends
        for task in tasks:
            task.cancel()
