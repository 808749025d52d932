"""A host for worlds in tests: what a world tells, in queues; and devices in threads."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

from msbot.part import Message
from msbot_bridges.bridge import ForeignDevice, World

LONG_S = 60


class Host:
    def __init__(self) -> None:
        self.devices = asyncio.Queue[ForeignDevice]()
        self.lost_why = asyncio.Queue[str]()
        self.said = asyncio.Queue[str]()
        self.warned = asyncio.Queue[str]()
        self.told = asyncio.Event()

    def found(self, device: ForeignDevice) -> None:
        self.devices.put_nowait(device)

    def lost(self, device: ForeignDevice, why: str) -> None:
        self.lost_why.put_nowait(why)

    def explain(self, device: ForeignDevice, why: str) -> None:
        self.lost_why.put_nowait(why)

    def news(self, device: ForeignDevice) -> None:
        self.told.set()

    def warn(self, device: ForeignDevice, words: str) -> None:
        self.warned.put_nowait(words)

    def say(self, words: str) -> None:
        self.said.put_nowait(words)

    async def until(self, condition: Callable[[], object]) -> None:
        """Wait for news that make a condition true."""
        while not condition():
            await self.told.wait()
            self.told.clear()


class Reports:
    """What goes out of a device's ports."""

    def __init__(self) -> None:
        self._come = asyncio.Event()
        self.last = dict[str, Message]()

    def __call__(self, port: str, message: Message) -> None:
        self.last[port] = message
        self._come.set()

    async def until(self, condition: Callable[[dict[str, Message]], object]) -> None:
        while not condition(self.last):
            await self._come.wait()
            self._come.clear()


@asynccontextmanager
async def running(world: World) -> AsyncIterator[Host]:
    """A world that runs, and its host."""
    host = Host()
    task = asyncio.create_task(world.run(host))
    try:
        async with asyncio.timeout(LONG_S):
            yield host
    finally:
        task.cancel()
        await asyncio.wait([task])
    if not task.cancelled() and (error := task.exception()) is not None:
        raise error


@asynccontextmanager
async def in_thread(run: Callable[[], None], end: Callable[[], None]) -> AsyncIterator[None]:
    """A device in a thread of its own."""
    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        yield
    finally:
        end()
        await asyncio.to_thread(thread.join)
