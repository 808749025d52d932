"""Programs that mean no good on the page's link: robot and other parts go on, and the person reads a sentence."""

from __future__ import annotations

import asyncio
import contextlib
from random import Random

import pytest
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed

from msbot_agent.link.net.connection_budget import BURST_S, OCTETS_S, PACKETS_S
from msbot_agent.link.net.websocket_server import MOST_OF_PERSON, TOO_MANY
from tests.web.part_site import PartSite, part_site

GARBAGE = b"0123456789" * 666
HONEST_PACKETS_S = 100
"""More than the honest part sends: ten messages a second, beats, and what a session needs."""
HONEST_OCTETS = 200
"""More than each of these has."""


def dial(site: PartSite, token: str) -> connect:
    headers = {"Authorization": f"Bearer {token}"}
    # No pings: behind a flood their answers wait, and on a busy machine that would be the end of the connection.
    return connect(
        f"{site.address}/api/link", additional_headers=headers, compression=None, max_size=None, ping_interval=None
    )


async def end_of(socket: ClientConnection) -> tuple[int | None, str | None]:
    """Read until the server closes the connection: its code and sentence."""
    with contextlib.suppress(ConnectionClosed):
        while True:
            await socket.recv()
    return socket.close_code, socket.close_reason


async def still_there(site: PartSite) -> None:
    """The honest part has never lost its slot, is active, and its messages still come in.

    On a busy machine a beat of it may be late for want of processor time; that passes.
    """
    assert site.lost == []
    await site.until(lambda: site.active() == {"S0"})
    before = site.link.counters.packets_in
    await site.until(lambda: site.link.counters.packets_in > before + 3)


@pytest.mark.promise("Idle connections keep nobody out")
async def test_fifty_sockets_of_one_person_leave_room_for_others() -> None:
    async with part_site() as site, contextlib.AsyncExitStack() as stack:
        token = await site.token("eve")
        sockets = [await stack.enter_async_context(dial(site, token)) for _ in range(50)]
        for socket in sockets[:MOST_OF_PERSON]:
            await socket.send(b"x")
        for socket in sockets[MOST_OF_PERSON:]:
            assert await end_of(socket) == (4403, "eve has 32 parts on the page already: end one first")
        assert site.link.counters.dropped[TOO_MANY] == 50 - MOST_OF_PERSON
        async with site.part(0, await site.token("bob")):
            await site.until(lambda: site.active() == {"S0"})
            await still_there(site)


@pytest.mark.parametrize("size", [1, 16, 512, 65_535])
@pytest.mark.promise("Hostile packets and files end in a sentence or a count, never a traceback")
async def test_garbage_disturbs_nobody(size: int) -> None:
    dice = Random(size)
    async with part_site() as site, site.part(0, await site.token("bob")):
        await site.until(lambda: site.active() == {"S0"})
        async with dial(site, await site.token("eve")) as socket:
            for _ in range(100 if size < 10_000 else 3):
                await socket.send(dice.randbytes(size))
            await still_there(site)


async def test_what_is_no_packet_is_answered_with_a_sentence() -> None:
    async with part_site() as site, site.part(0, await site.token("bob")):
        await site.until(lambda: site.active() == {"S0"})
        token = await site.token("eve")
        for message, words in (
            ("hello robot", "a part sends packets of DDS-XRCE in binary messages, and no text"),
            (bytes(70_000), "a packet has 1 to 65535 bytes, not 70000"),
        ):
            async with dial(site, token) as socket:
                await socket.send(message)
                assert await end_of(socket) == (4400, words)
        async with dial(site, token) as socket:
            with contextlib.suppress(ConnectionClosed):
                await socket.send(bytes(2_000_000))  # more than the server takes at all
            code, _ = await end_of(socket)
            assert code == 1009
        await still_there(site)


async def test_a_connection_that_is_torn_off_in_mid_message_is_gone() -> None:
    async with part_site() as site, site.part(0, await site.token("bob")):
        await site.until(lambda: site.active() == {"S0"})
        async with dial(site, await site.token("eve")) as socket:
            await socket.send(b"x")
            await site.until(lambda: len(site.link._peers) == 2)
            # A frame of 1,000 octets, of which ten come.
            socket.transport.write(b"\x82\xfe\x03\xe8\0\0\0\0" + bytes(10))
            socket.transport.abort()
            await site.until(lambda: len(site.link._peers) == 1)
        await still_there(site)


@pytest.mark.promise("A flood neither keeps parts out nor makes active ones late")
async def test_who_floods_is_told_and_slows_down_nobody_but_itself() -> None:
    async with part_site() as site, site.part(0, await site.token("bob")):
        await site.until(lambda: site.active() == {"S0"})
        loop = asyncio.get_running_loop()
        async with dial(site, await site.token("eve")) as socket:
            told = asyncio.create_task(socket.recv())
            began, before, octets_before = loop.time(), site.link.counters.packets_in, site.link.counters.bytes_in

            async def flood() -> None:
                # Some 40 of these a second are too many octets: a machine that is busy elsewhere floods as well.
                while True:
                    await socket.send(GARBAGE)
                    await asyncio.sleep(0)  # the honest part lives in this process, too

            flooding = asyncio.create_task(flood())
            words = await asyncio.wait_for(told, 60)
            assert words == "this part sends more than the robot takes from one part: send less often"
            for _ in range(3):
                await still_there(site)
            counters, seconds = site.link.counters, loop.time() - began
            honest = HONEST_PACKETS_S * (seconds + 1)
            assert counters.packets_in - before < PACKETS_S * (seconds + BURST_S) + 1 + honest
            assert (
                counters.bytes_in - octets_before
                < OCTETS_S * (seconds + BURST_S) + len(GARBAGE) + honest * HONEST_OCTETS
            )
            flooding.cancel()
            await asyncio.gather(flooding, return_exceptions=True)
            socket.transport.abort()
        await still_there(site)
