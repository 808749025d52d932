"""What both ends share: compression, taps, and what cannot be sent."""

from __future__ import annotations

import asyncio
from random import Random

import pytest

from msbot_agent.link import LinkCounters, Peer
from msbot_agent.link.can.controller import BusState
from msbot_agent.link.can.legacy_link import Codec
from msbot_agent.link.can.native_link import MASTER
from msbot_agent.link.can.protocol.frames import MTU, Frame
from msbot_xrce import compress, decompress
from msbot_xrce.counting import MOST_NAMES, OTHERS
from msbot_xrce.errors import LinkDown, LocalProtocolError, RemoteProtocolError
from tests.link.can_robot import End, Robot, node_of, play


def shorten(packet: bytes) -> bytes:
    return packet.removeprefix(b"header")


def lengthen(message: bytes) -> bytes:
    if message == b"broken":
        raise RemoteProtocolError("no packet gives these bytes")
    return b"header" + message


CODEC = Codec(shorten, lengthen)


@pytest.mark.parametrize(
    ("master_knows", "part_knows", "frames"), [(True, True, 1), (True, False, 2), (False, True, 2)]
)
def test_packets_are_shortened_only_when_both_sides_can(master_knows: bool, part_knows: bool, frames: int) -> None:
    async def scene(robot: Robot) -> None:
        master = robot.master(codec=CODEC if master_knows else None)
        part = robot.part(codec=CODEC if part_knows else None)
        await asyncio.sleep(0.5)
        before = robot.bus.counters.frames
        part.link.send(b"header data", MASTER)
        await asyncio.sleep(0.1)
        master.link.send(b"header data", 1)
        await asyncio.sleep(0.1)
        assert robot.bus.counters.frames - before == 2 * frames
        assert master.packets == [(b"header data", 1)]
        assert part.packets == [(b"header data", MASTER)]

    play(scene)


def test_the_longest_packet_arrives_also_where_it_has_no_short_form() -> None:
    packet = bytes([5]) + Random(1).randbytes(MTU - 1)
    assert len(compress(packet)) == MTU + 1

    async def scene(robot: Robot) -> None:
        codec = Codec(compress, decompress)
        master, part = robot.master(codec=codec), robot.part(codec=codec)
        await asyncio.sleep(0.5)
        part.link.send(packet, MASTER)
        await asyncio.sleep(1)
        assert master.packets == [(packet, 1)]

    play(scene)


def test_bytes_that_no_packet_gives_are_counted_in_words() -> None:
    async def scene(robot: Robot) -> None:
        master, part = robot.master(codec=CODEC), robot.part(codec=CODEC)
        await asyncio.sleep(0.5)
        part.link.send(b"broken", MASTER)
        await asyncio.sleep(0.1)
        assert master.packets == []
        assert master.link.counters.dropped == {"no packet gives these bytes": 1}

    play(scene)


def test_reasons_with_a_number_of_the_sender_in_them_do_not_fill_the_memory() -> None:
    counters = LinkCounters()
    for size in range(1000):
        counters.dropped.count(f"compressed message of {size} bytes")
    assert len(counters.dropped) == MOST_NAMES + 1
    assert counters.dropped[OTHERS] == 1000 - MOST_NAMES


def test_a_tap_sees_every_packet_both_ways() -> None:
    async def scene(robot: Robot) -> None:
        master, part = robot.master(), robot.part()
        await asyncio.sleep(0.5)
        seen: list[tuple[str, Peer, bytes]] = []
        master.link.tap = lambda now, way, peer, packet: seen.append((way, peer, packet))
        part.link.send(b"up", MASTER)
        master.link.send(b"down", 1)
        await asyncio.sleep(0.1)
        assert sorted(seen) == [("in", 1, b"up"), ("out", 1, b"down")]

    play(scene)


def test_what_cannot_be_sent_says_why() -> None:
    async def scene(robot: Robot) -> None:
        master = robot.master()
        part = robot.part()
        await asyncio.sleep(0.5)
        assert master.link.info.mtu == 4096
        assert (master.link.info.name, master.link.info.bits_per_second) == ("sim:500000", 500_000)
        assert master.link.info.shared_bus
        assert master.link.bus_state is BusState.ACTIVE
        with pytest.raises(LocalProtocolError, match="4097 bytes is longer than the link's 4096"):
            master.link.send(bytes(4097), node_of(part))
        with pytest.raises(LinkDown, match="CAN node 5 has no address"):
            master.link.send(b"x", 5)
        with pytest.raises(LinkDown, match="has no address"):
            master.link.send(b"x", "nobody")
        assert not master.link.has_room(5)
        assert not master.link.has_room(0)
        assert not master.link.has_room(121)
        await robot.stop(master)
        with pytest.raises(LinkDown, match="does not run"):
            master.link.send(b"x", node_of(part))
        with pytest.raises(LinkDown, match="does not run"):
            master.link.send_stop()

    play(scene)


def test_a_peer_too_verbose_for_the_mtu_is_dropped_not_delivered() -> None:
    async def scene(robot: Robot) -> None:
        master = robot.master()
        robot.part(9)
        part: End = robot.part()
        await asyncio.sleep(0.5)
        fake = robot.driver.attach("fake")
        for q in range(700):
            fake.send(Frame(0x100 + node_of(part), bytes([(0x80 if q == 0 else 0) | q & 63]) + bytes(7)))
            await asyncio.sleep(0.001)
        assert master.packets == []
        assert master.link.counters.dropped == {"message is longer than the link allows": 1}

    play(scene)


def test_several_taps_see_every_frame_and_the_bus_is_told() -> None:
    async def scene(robot: Robot) -> None:
        part = robot.part()
        taps: list[list[tuple[float, str, Frame]]] = [[], [], []]
        for tap in taps:
            part.link.on_frame(lambda at, whose, frame, tap=tap: tap.append((at, whose, frame)))  # type: ignore[misc]
        robot.master()
        await asyncio.sleep(1.0)
        assert {whose for _, whose, _ in taps[0]} == {"here", "bus"}
        assert taps[0] == taps[1] == taps[2]
        assert part.link.bus_info == part.link._port.bus.info

    play(scene)
