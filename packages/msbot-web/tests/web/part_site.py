"""A robot's master with the place where parts come in by the page, on the loopback: what tests of `ws:` share."""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from random import Random

import uvicorn
from starlette.applications import Starlette
from uvicorn.server import ServerState

from msbot.config import Blueprint, PartType, RobotProfile, Slot
from msbot.master import Master
from msbot.operations.rights import Role
from msbot.part import HelloWorld, Part
from msbot.pnp import Configuration, MemoryStore, PartState, SlotBinding
from msbot_agent.link.net import WebSocketClientLink, WebSocketServerLink
from msbot_agent.pace import ProtocolServer
from msbot_web.access.access_middleware import AccessMiddleware, CookieNames
from msbot_web.access.accounts import Accounts
from msbot_web.access.users import MemoryUsers
from msbot_web.connection_limits import ConnectionLimits, LimitedConnection
from msbot_web.nicegui_internals.application import LazyWebSocket
from msbot_web.part_websocket import PartWebSocket
from msbot_xrce.counting import Tally
from msbot_xrce.errors import MsbotError
from tests.web.access.test_accounts import PlainHasher, user

PATIENCE_S = 60.0
"""How long a test waits for what must happen; the machine may be busy."""


def store(slots: int) -> MemoryStore:
    """Slots S0, S1, ... for parts T0, T1, ..., each of which says something on a topic of its own."""
    return MemoryStore(
        types=tuple(PartType(f"T{n}", "a test's") for n in range(slots)),
        slots=tuple(Slot(f"S{n}", f"T{n}") for n in range(slots)),
        configurations=tuple(
            Configuration(
                1, f"S{n}", (SlotBinding("out", f"out{n}", "HelloWorld", publishes=True, reliable=False),), ()
            )
            for n in range(slots)
        ),
    )


class PartSite:
    """The robot, and whom it lets in."""

    def __init__(
        self, master: Master, accounts: Accounts, link: WebSocketServerLink, guard: AccessMiddleware, port: int
    ) -> None:
        self.master = master
        self.accounts = accounts
        self.link = link
        self.guard = guard
        self.port = port
        self.lost: list[str] = []
        """Slots whose part was lost, with the reason."""
        self.break_all: Callable[[], None] = lambda: None
        """Tear every connection off."""

    @property
    def address(self) -> str:
        return f"ws://127.0.0.1:{self.port}"

    async def token(self, name: str, purpose: str = "test") -> str:
        return await self.accounts.new_token(name, purpose, who="ada")

    def client(self, token: str) -> WebSocketClientLink:
        return WebSocketClientLink(self.address, token)

    def active(self) -> set[str]:
        """The slots whose part is active."""
        now = asyncio.get_running_loop().time()
        infos = self.master.inventory.view(now)
        return {info.slot or "" for info in infos if info.state is PartState.ACTIVE}

    async def until(self, condition: Callable[[], bool]) -> None:
        async with asyncio.timeout(PATIENCE_S):
            while not condition():  # noqa: ASYNC110 - nobody tells
                await asyncio.sleep(0.01)

    @asynccontextmanager
    async def part(
        self, number: int, token: str, *, period_s: float = 0.1, program: Callable[[Part], object] | None = None
    ) -> AsyncIterator[Part]:
        """A part that comes in by the page: with a program, or it says something again and again."""
        part = Part(f"T{number}", uid=number.to_bytes(8, "big"), random=Random(number))
        if program is not None:
            program(part)
        else:
            part.every(period_s)(lambda: part.publish("out", HelloWorld(index=number, message="x")))
        task = asyncio.create_task(part.run_async(self.client(token)))
        try:
            yield part
        finally:
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError, MsbotError):
                await task


@asynccontextmanager
async def part_site(slots: int = 2, *, stored: MemoryStore | None = None) -> AsyncIterator[PartSite]:
    """A running robot with the guard, the connections and the part socket of the real page, and no page."""
    loop = asyncio.get_running_loop()
    people = [user("ada"), user("bob", Role.STUDENT), user("eve", Role.STUDENT), user("vic", Role.VIEWER)]
    accounts = Accounts(MemoryUsers(*people), clock=loop.time, hasher=PlainHasher())
    link = WebSocketServerLink("ws:test")
    app = Starlette(routes=[PartWebSocket(link, accounts).route()])
    guard = AccessMiddleware(
        app, accounts, ["127.0.0.1"], cookies=CookieNames(), owns=lambda *_: False, beat=lambda: b"{}"
    )
    config = uvicorn.Config(guard, log_level="error", lifespan="off", ws=LazyWebSocket, ws_max_size=1024 * 1024)
    config.load()
    master = Master(Blueprint(RobotProfile("R", "1", "2", "", ""), ()), stored or store(slots), random=Random(1))
    master.add_link(link)
    with socket.create_server(("127.0.0.1", 0)) as listening:
        listening.setblocking(False)
        state, connections = ServerState(), ConnectionLimits()
        acceptor = ProtocolServer(listening, lambda: LimitedConnection(connections, config, state, {}), Tally())
        running = asyncio.create_task(master.run())
        async with asyncio.timeout(PATIENCE_S):
            await master.ready.wait()
        accepting = asyncio.create_task(acceptor.run())
        try:
            site = PartSite(master, accounts, link, guard, listening.getsockname()[1])
            master.inventory.on_event(
                lambda event: (
                    site.lost.append(f"{event.slot}: {event.reason}")
                    if event.slot and event.to_state is PartState.LOST
                    else None
                )
            )
            site.break_all = lambda: _break_all(state)
            yield site
        finally:
            accepting.cancel()
            running.cancel()
            await asyncio.gather(accepting, running, return_exceptions=True)
            _break_all(state)
            for task in list(state.tasks):
                task.cancel()
            await asyncio.gather(*state.tasks, return_exceptions=True)


def _break_all(state: ServerState) -> None:
    for connection in list(state.connections):
        connection.transport.abort()
