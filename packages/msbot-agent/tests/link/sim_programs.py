"""A served simulated bus and raw programs on it, for tests; real sockets, and nobody sleeps."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

from msbot_agent.link.can.controller import BusState, CanBus
from msbot_agent.link.can.protocol.frames import Frame
from msbot_agent.link.can.sim.model.sim_bus import SimBus
from msbot_agent.link.can.sim.model.sim_bus_messages import Hello, Message, Splitter, Welcome, encode
from msbot_agent.link.can.sim.sim_bus_driver import SimBusDriver
from msbot_agent.link.can.sim.sim_bus_server import SimBusServer

PATIENCE_S = 60.0
"""Longer than any busy machine needs."""

M = TypeVar("M", bound=Message)


@contextlib.asynccontextmanager
async def served(
    folder: Path, name: str = "classroom", bus: SimBus | None = None
) -> AsyncIterator[tuple[SimBusServer, SimBusDriver]]:
    """A bus that others can join."""
    driver = SimBusDriver(bus or SimBus(500_000))
    server = SimBusServer(driver, name, folder=folder)
    task = asyncio.create_task(server.run())
    async with asyncio.timeout(PATIENCE_S):
        await server.ready.wait()
    try:
        yield server, driver
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


class RawProgram:
    """Speaks the protocol by hand."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.reader, self.writer = reader, writer
        self.splitter = Splitter()
        self.messages: list[Message] = []

    @classmethod
    async def connect(cls, port: int) -> RawProgram:
        return cls(*await asyncio.open_connection("127.0.0.1", port))

    @classmethod
    async def join(cls, server: SimBusServer, port: int, name: str = "raw", *, listen_only: bool = False) -> RawProgram:
        program = await cls.connect(port)
        program.say(Hello(server.key, name, listen_only=listen_only))
        await program.hear(Welcome)
        return program

    def say(self, message: Message) -> None:
        self.writer.write(encode(message))

    async def hear(self, kind: type[M]) -> M:
        """The next message of that kind; others before it are thrown away."""
        async with asyncio.timeout(PATIENCE_S):
            while True:
                while self.messages:
                    message = self.messages.pop(0)
                    if isinstance(message, kind):
                        return message
                data = await self.reader.read(65536)
                assert data, f"the connection ended before a {kind.__name__}"
                self.messages += self.splitter.receive(data)

    async def ended(self) -> list[Message]:
        """Wait for the end of the connection; what came before it."""
        async with asyncio.timeout(PATIENCE_S):
            with contextlib.suppress(ConnectionError):
                while data := await self.reader.read(65536):
                    self.messages += self.splitter.receive(data)
        self.writer.close()
        return self.messages


@dataclass
class Ear:
    """Everything a controller tells, and a way to wait for it."""

    bus: CanBus
    frames: list[tuple[Frame, float]] = field(default_factory=list)
    states: list[tuple[BusState, str]] = field(default_factory=list)
    rooms: int = 0

    def __post_init__(self) -> None:
        self._news = asyncio.Event()
        self.bus.attach(frame=self._frame)
        self.bus.attach(state=self._state)
        self.bus.attach(room=self._room)

    def _frame(self, frame: Frame, now: float) -> None:
        self.frames.append((frame, now))
        self._news.set()

    def _state(self, state: BusState, words: str, _now: float) -> None:
        self.states.append((state, words))
        self._news.set()

    def _room(self, _now: float) -> None:
        self.rooms += 1
        self._news.set()

    def poke(self, *_: object) -> None:
        """Something happened that the controller does not tell."""
        self._news.set()

    async def until(self, condition: Callable[[], bool]) -> None:
        """Wait for something that one of the handlers brings about."""
        async with asyncio.timeout(PATIENCE_S):
            while not condition():
                self._news.clear()
                await self._news.wait()
