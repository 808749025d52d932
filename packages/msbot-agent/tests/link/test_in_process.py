from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msbot.process.virtual_time import run_virtual
from msbot_agent.link import InprocEnd, InprocHub, Link, Peer, Signal, inproc_pair
from msbot_agent.link.in_process import QUEUE_PACKETS, SERVER
from msbot_xrce.errors import LinkDown, LinkFull
from tests.effort import tries


class Seen:
    """What one end was told."""

    def __init__(self, end: InprocEnd) -> None:
        self.packets: list[tuple[bytes, Peer]] = []
        self.signals: list[tuple[Signal, Peer | None]] = []
        self.room: list[Peer | None] = []
        end.attach(packet=lambda packet, peer, now: self.packets.append((packet, peer)))
        end.attach(signal=lambda signal, peer, words, now: self.signals.append((signal, peer)))
        end.attach(room=self.room.append)


def with_open_ends(ends: list[InprocEnd], body: Callable[[], Awaitable[None]]) -> None:
    async def main() -> None:
        async with asyncio.TaskGroup() as group:
            tasks = [group.create_task(end.run()) for end in ends]
            await asyncio.sleep(0)
            await body()
            for task in tasks:
                task.cancel()

    run_virtual(main())


async def turn() -> None:
    await asyncio.sleep(0)
    await asyncio.sleep(0)


def test_packets_go_both_ways_in_order_in_the_next_turn() -> None:
    hub = InprocHub()
    server, first, second = hub.server, hub.connect(), hub.connect()
    ends: list[Link] = [server, first, second]
    seen = {end.number: Seen(end) for end in (server, first, second)}

    async def body() -> None:
        first.send(b"a", SERVER)
        first.send(b"b", SERVER)
        second.send(b"c", SERVER)
        server.send(b"to 2", 2)
        assert seen[0].packets == []
        await turn()

    with_open_ends([server, first, second], body)
    assert seen[0].packets == [(b"a", 1), (b"b", 1), (b"c", 2)]
    assert seen[1].packets == []
    assert seen[2].packets == [(b"to 2", SERVER)]
    assert [end.remote for end in ends] == [None, SERVER, SERVER]
    assert (first.counters.packets_out, first.counters.bytes_out) == (2, 2)
    assert (server.counters.packets_in, server.counters.bytes_in) == (3, 3)


def test_ends_hear_of_each_other() -> None:
    hub = InprocHub()
    server, first, second = hub.server, hub.connect(), hub.connect()
    seen = [Seen(end) for end in (server, first, second)]

    async def body() -> None:
        task = asyncio.create_task(second.run())
        await turn()
        task.cancel()
        await turn()
        server.send(b"too late", 2)

    with_open_ends([server, first], body)
    assert seen[0].signals[:4] == [
        (Signal.LINK_UP, None),
        (Signal.PEER_JOINED, 1),
        (Signal.PEER_JOINED, 2),
        (Signal.PEER_GONE, 2),
    ]
    assert seen[2].signals == [(Signal.LINK_UP, None), (Signal.LINK_DOWN, None)]
    assert (Signal.PEER_JOINED, 2) not in seen[1].signals
    assert server.counters.dropped == {"nobody at the other end": 1}


def test_what_is_under_way_when_the_other_end_closes_is_counted() -> None:
    server, client = inproc_pair()

    async def body() -> None:
        task = asyncio.create_task(client.run())
        await turn()
        task.cancel()
        asyncio.get_running_loop().call_soon(server.send, b"x", 1)
        await turn()
        await turn()

    with_open_ends([server], body)
    assert server.counters.dropped == {"nobody at the other end": 1}


def test_a_full_queue_says_so_and_then_that_there_is_room() -> None:
    server, client = inproc_pair()
    seen, heard = Seen(client), Seen(server)

    async def body() -> None:
        for number in range(QUEUE_PACKETS):
            assert client.has_room(SERVER)
            client.send(number.to_bytes(2), SERVER)
        assert not client.has_room(SERVER)
        with pytest.raises(LinkFull, match="256 packets wait for in-process server"):
            client.send(b"one more", SERVER)
        await turn()
        assert client.has_room(SERVER)

    with_open_ends([server, client], body)
    assert seen.room == [SERVER]
    assert [packet for packet, _ in heard.packets] == [number.to_bytes(2) for number in range(QUEUE_PACKETS)]


def test_a_closed_end_sends_nothing() -> None:
    server, client = inproc_pair()
    assert not client.has_room(SERVER)
    with pytest.raises(LinkDown, match="start its run"):
        client.send(b"x", SERVER)
    server.receive(b"x", 1)
    server.notice(Signal.STOP, None, "")
    assert server.counters.packets_in == 0


def test_ends_without_handlers_carry_on() -> None:
    server, client = inproc_pair()

    async def body() -> None:
        for _ in range(QUEUE_PACKETS):
            client.send(b"x", SERVER)
        await turn()

    with_open_ends([server, client], body)
    assert server.counters.packets_in == QUEUE_PACKETS


def test_taps_see_every_packet() -> None:
    server, client = inproc_pair()
    tapped: list[tuple[str, str, Peer, bytes]] = []
    server.tap = lambda now, way, peer, packet: tapped.append(("server", way, peer, packet))
    client.tap = lambda now, way, peer, packet: tapped.append(("client", way, peer, packet))

    async def body() -> None:
        client.send(b"x", SERVER)
        await turn()

    with_open_ends([server, client], body)
    assert tapped == [("client", "out", SERVER, b"x"), ("server", "in", 1, b"x")]
    assert server.describe(1) == "in-process client 1"
    assert client.describe(SERVER) == "in-process server"


@settings(max_examples=tries(50, 2000))
@given(st.lists(st.tuples(st.integers(0, 2), st.booleans()), max_size=60))
def test_order_is_kept_whatever_the_handlers_answer(steps: list[tuple[int, bool]]) -> None:
    hub = InprocHub()
    clients = [hub.connect() for _ in range(3)]
    heard: dict[Peer, list[bytes]] = {client.number: [] for client in clients}
    back: dict[Peer, list[bytes]] = {client.number: [] for client in clients}

    def at_server(packet: bytes, peer: Peer, now: float) -> None:
        heard[peer].append(packet)
        hub.server.send(packet, peer)

    hub.server.attach(packet=at_server)

    def listen(client: InprocEnd) -> None:
        client.attach(packet=lambda packet, peer, now: back[client.number].append(packet))

    for client in clients:
        listen(client)
    sent: dict[Peer, list[bytes]] = {client.number: [] for client in clients}

    async def body() -> None:
        for index, (which, pause) in enumerate(steps):
            packet = index.to_bytes(2)
            clients[which].send(packet, SERVER)
            sent[clients[which].number].append(packet)
            if pause:
                await asyncio.sleep(0)
        await turn()
        await turn()

    with_open_ends([hub.server, *clients], body)
    assert heard == sent
    assert back == sent


def test_an_end_that_is_pulled_says_nothing_and_is_told_nothing() -> None:
    hub = InprocHub()
    server, client = hub.server, hub.connect()
    seen = {end.number: Seen(end) for end in (server, client)}

    async def body() -> None:
        client.send(b"on its way", SERVER)
        client.pull()
        client.send(b"goodbye", SERVER)
        server.send(b"still there?", client.number)
        await turn()
        assert (seen[0].packets, seen[client.number].packets) == ([], [])
        assert server.counters.dropped == {"nobody at the other end": 1}

    with_open_ends([server, client], body)
    assert (Signal.PEER_JOINED, client.number) in seen[0].signals
    assert (Signal.PEER_GONE, client.number) not in seen[0].signals
