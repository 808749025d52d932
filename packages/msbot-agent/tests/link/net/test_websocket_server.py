"""The server's end of parts that come by the page, without a page: who is let in, what waits, what is told."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import pytest

from msbot.process.virtual_time import run_virtual
from msbot_agent.link import Signal
from msbot_agent.link.byte_frames import MAX_PACKET
from msbot_agent.link.contract import ConnectionUser
from msbot_agent.link.net.connection_budget import PACKETS_S
from msbot_agent.link.net.websocket_server import (
    FIRST_PACKET_S,
    MOST,
    MOST_OF_ADDRESS,
    MOST_OF_PERSON,
    SLOW_DOWN_AGAIN_S,
    WRITE_LIMIT,
    SocketPeer,
    WebSocketServerLink,
)
from msbot_xrce.errors import LinkDown, LinkFull
from tests.link.ends import End, running

ANN = ConnectionUser("ann", "192.168.1.30")


def play(scene: Callable[[WebSocketServerLink, End], Awaitable[None]]) -> None:
    """With a link that is open."""

    async def main() -> None:
        link = WebSocketServerLink("ws:test")
        async with running(link) as (end,):
            await scene(link, end)

    run_virtual(main())


def now() -> float:
    return asyncio.get_running_loop().time()


def test_packets_go_both_ways_and_who_it_is_has_a_name() -> None:
    async def scene(link: WebSocketServerLink, end: End) -> None:
        peer = link.join(ANN)
        assert await end.told(Signal.PEER_JOINED) == (peer, "connected")
        assert peer.receive(b"up", now()) == (0.0, "")
        assert end.packets.get_nowait() == (b"up", peer)
        assert (link.origin(peer), link.describe(peer)) == ("ann", "ann at 192.168.1.30")
        for packet in (b"one", b"two"):
            link.send(packet, peer)
        assert [await peer.next_packet(), await peer.next_packet()] == [b"one", b"two"]
        assert (link.counters.packets_in, link.counters.packets_out) == (1, 2)
        waiting = asyncio.create_task(peer.next_packet())
        await asyncio.sleep(1)
        assert not waiting.done()
        link.send(b"three", peer)
        assert await waiting == b"three"

    play(scene)


def test_packets_go_at_once_while_nothing_waits_and_never_overtake() -> None:
    async def scene(link: WebSocketServerLink, end: End) -> None:
        peer = link.join(ANN)
        sent: list[bytes] = []
        has_room = True

        def send_at_once(packet: bytes) -> bool:
            sent.extend([packet] if has_room else [])
            return has_room

        async def write() -> None:
            while True:
                packet = await peer.next_packet()
                await asyncio.sleep(1)
                sent.append(packet)

        peer.send_by(send_at_once)
        link.send(b"0", peer)  # nobody asks for packets yet
        writing = asyncio.create_task(write())
        await asyncio.sleep(2)
        link.send(b"1", peer)
        link.send(b"2", peer)
        assert sent == [b"0", b"1", b"2"]
        has_room = False
        link.send(b"3", peer)
        await asyncio.sleep(0.5)
        has_room = True
        link.send(b"4", peer)  # the one before it is on its way
        assert sent == [b"0", b"1", b"2"]
        await asyncio.sleep(2)
        link.send(b"5", peer)
        assert sent == [b"0", b"1", b"2", b"3", b"4", b"5"]
        assert end.room.empty()
        writing.cancel()

    play(scene)


def test_who_has_gone_is_sent_nothing_and_brings_nothing() -> None:
    async def scene(link: WebSocketServerLink, end: End) -> None:
        peer = link.join(ANN)
        stranger = SocketPeer(link, ANN, now())
        for who in (stranger, ("10.0.0.1", 5), None):
            assert not link.has_room(who)
            with pytest.raises(LinkDown, match="there is no connection with "):
                link.send(b"x", who)
        assert link.has_room(peer)
        peer.connection_ended("closed by the browser")
        assert await end.told(Signal.PEER_GONE) == (peer, "closed by the browser")
        assert not link.has_room(peer)
        with pytest.raises(LinkDown, match="there is no connection with ann at 192"):
            link.send(b"x", peer)
        peer.receive(b"late", now())
        stranger.connection_ended("twice")
        assert end.packets.empty()
        assert end.signals.empty()

    play(scene)


def test_so_much_waits_for_a_slow_part_and_room_is_told_when_all_of_it_has_gone() -> None:
    async def scene(link: WebSocketServerLink, end: End) -> None:
        peer = link.join(ANN)
        link.send(bytes(WRITE_LIMIT - 1), peer)
        assert link.has_room(peer)
        link.send(b"x", peer)
        assert not link.has_room(peer)
        with pytest.raises(LinkFull, match=r"ann at 192\.168\.1\.30 does not take its data"):
            link.send(b"y", peer)
        await peer.next_packet()
        assert link.has_room(peer)
        assert end.room.empty()  # something waits yet
        await peer.next_packet()
        assert end.room.get_nowait() == peer
        link.send(b"z", peer)
        await peer.next_packet()
        assert end.room.empty()  # it was not full

    play(scene)


@pytest.mark.parametrize("size", [0, MAX_PACKET + 1])
def test_what_is_no_packet_is_refused_and_counted(size: int) -> None:
    async def scene(link: WebSocketServerLink, end: End) -> None:
        peer = link.join(ANN)
        with pytest.raises(ValueError, match=f"a packet has 1 to 65535 bytes, not {size}"):
            peer.receive(bytes(size), now())
        assert "no text" in peer.took_text()
        assert list(link.counters.dropped.values()) == [2]
        assert end.packets.empty()
        peer.receive(bytes(MAX_PACKET), now())
        peer.receive(b"1", now())
        assert end.packets.qsize() == 2

    play(scene)


def test_only_who_brings_nothing_at_first_is_silent() -> None:
    async def scene(link: WebSocketServerLink, end: End) -> None:
        silent, speaks = link.join(ANN), link.join(ANN)
        speaks.receive(b"x", now())
        began = now()
        assert not silent.is_silent(began + FIRST_PACKET_S - 0.01)
        assert not speaks.is_silent(began + 100 * FIRST_PACKET_S)
        assert not link.counters.dropped
        assert silent.is_silent(began + FIRST_PACKET_S)
        assert link.counters.dropped == {"connection closed: no packet came": 1}

    play(scene)


def test_who_sends_too_much_is_read_later_and_told_so_now_and_then() -> None:
    async def scene(link: WebSocketServerLink, end: End) -> None:
        peer, at = link.join(ANN), now()
        for _ in range(int(PACKETS_S)):
            assert peer.receive(b"x", at) == (0.0, "")
        words = "this part sends more than the robot takes from one part: send less often"
        assert peer.receive(b"x", at) == (1 / PACKETS_S, words)
        assert peer.receive(b"x", at) == (2 / PACKETS_S, "")
        again = at + SLOW_DOWN_AGAIN_S
        for _ in range(int(PACKETS_S)):
            assert peer.receive(b"x", again - 1) == (0.0, "")
        pause_s, said = peer.receive(b"x", again - 1)
        assert pause_s > 0
        assert said == ""
        told = [peer.receive(b"x", again)[1] for _ in range(int(PACKETS_S))]
        assert sum(said == words for said in told) == 1
        assert end.packets.qsize() == link.counters.packets_in

    play(scene)


@pytest.mark.parametrize(
    ("most", "visitor", "other", "words"),
    [
        (
            MOST_OF_PERSON,
            lambda n: ConnectionUser("ann", f"10.0.0.{n}"),
            ConnectionUser("bob", "10.0.0.1"),
            "ann has 32 parts",
        ),
        (
            MOST_OF_ADDRESS,
            lambda n: ConnectionUser(f"pupil{n}", "10.0.0.1"),
            ConnectionUser("pupil0", "10.0.0.2"),
            "10.0.0.1 has 128 parts",
        ),
        (MOST, lambda n: ConnectionUser(f"pupil{n}", f"10.0.0.{n}"), None, "the robot has 256 parts"),
    ],
)
def test_so_many_and_not_one_more(
    most: int, visitor: Callable[[int], ConnectionUser], other: ConnectionUser | None, words: str
) -> None:
    async def scene(link: WebSocketServerLink, end: End) -> None:
        peers = [link.join(visitor(number)) for number in range(most)]
        with pytest.raises(LinkFull, match=f"{words} on the page already: end one first"):
            link.join(visitor(most))
        assert link.counters.dropped == {"connection refused: too many are open": 1}
        if other is not None:
            link.join(other)
        peers[0].connection_ended("closed")
        link.join(visitor(most))

    play(scene)


def test_a_robot_that_does_not_serve_lets_nobody_in() -> None:
    async def main() -> None:
        link = WebSocketServerLink("ws:test")
        with pytest.raises(LinkDown, match="the robot starts or ends just now: try again in a moment"):
            link.join(ANN)
        async with running(link) as (end,):
            peer = link.join(ANN)
        assert await end.told(Signal.LINK_DOWN) == (None, "closed")
        assert not link.has_room(peer)
        with pytest.raises(LinkDown):
            link.join(ANN)

    run_virtual(main())
