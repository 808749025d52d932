"""Silent connections, and logins without end, keep nobody out."""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections.abc import AsyncIterator
from random import Random

import pytest

from msbot.part import Client, ConnectionState
from msbot_agent.agent import Agent, AgentSettings, ClientInfo, OpenGate
from msbot_agent.link import Signal
from msbot_agent.link.net import TcpClientLink, TcpServerLink, UdpClientLink, UdpServerLink
from msbot_agent.space import MemorySpace
from msbot_xrce.messages import SESSION_NONE, CreateClient, Header, encode_message

PATIENCE_S = 60
SILENT = 150


class Strangers(OpenGate):
    """Nobody holds a place."""

    def is_settled(self, client: ClientInfo) -> bool:
        return False


@contextlib.asynccontextmanager
async def serving(link: TcpServerLink | UdpServerLink, settings: AgentSettings | None = None) -> AsyncIterator[Agent]:
    """A real agent on that link."""
    up = asyncio.Event()
    agent = Agent(
        MemorySpace(),
        gate=Strangers(),
        settings=settings,
        signal=lambda _link, signal, *_: up.set() if signal is Signal.LINK_UP else None,
    )
    agent.add_link(link)
    task = asyncio.create_task(agent.run())
    async with asyncio.timeout(PATIENCE_S):
        await up.wait()
    try:
        yield agent
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


async def gets_in(client: Client) -> None:
    """The client has a session."""
    task = asyncio.create_task(client.run())
    try:
        await client.connect(PATIENCE_S)
        assert client.state is ConnectionState.CONNECTED
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


@pytest.mark.promise("Idle connections keep nobody out")
async def test_silent_connections_do_not_lock_newcomers_out_of_tcp() -> None:
    link = TcpServerLink("127.0.0.1", 0, max_connections=100)
    async with serving(link):
        with contextlib.ExitStack() as stack:
            for _ in range(SILENT):
                stack.enter_context(socket.create_connection(("127.0.0.1", link.port)))
                await asyncio.sleep(0)
            await gets_in(Client(TcpClientLink("127.0.0.1", link.port), key=7, random=Random(1)))


@pytest.mark.promise("A flood neither keeps parts out nor makes active ones late")
async def test_logins_without_end_from_one_socket_do_not_lock_newcomers_out_of_udp() -> None:
    link = UdpServerLink("127.0.0.1", 0)
    settings = AgentSettings(max_clients=300, max_unsettled=200, max_unsettled_of_address=200)
    hour = (("uxr_hl", "3600000"),)
    async with serving(link, settings) as agent:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as attacker:
            attacker.connect(("127.0.0.1", link.port))
            for key in range(1, 2001):
                request = CreateClient(key, 0x01, 512, hour)
                attacker.send(encode_message(Header(SESSION_NONE), [request], pad_end=False))
                await asyncio.sleep(0)
            await gets_in(Client(UdpClientLink("127.0.0.1", link.port), key=70_000, random=Random(1)))
            assert settings.max_joining <= len(agent.clients()) <= settings.max_unsettled + 1
