from __future__ import annotations

import asyncio
from collections import Counter
from dataclasses import replace
from random import Random

from hypothesis import given
from hypothesis import strategies as st

from msbot.process.virtual_time import run_virtual
from msbot_agent.link import Link, LossyLink, Signal, inproc_pair
from msbot_agent.link.disturbed_link import Disturbance
from msbot_agent.link.in_process import QUEUE_PACKETS, SERVER


def carried(count: int, *, pause: float = 0.001, incoming: bool = False, **faults: float) -> list[tuple[bytes, float]]:
    """Sends `count` numbered packets through a lossy client end; returns what arrived and when."""
    server, client = inproc_pair()
    lossy: Link = LossyLink(client, random=Random(1), **faults)
    arrived: list[tuple[bytes, float]] = []
    receiver: Link = lossy if incoming else server
    receiver.attach(packet=lambda packet, peer, now: arrived.append((packet, now)))

    async def main() -> None:
        async with asyncio.TaskGroup() as group:
            tasks = [group.create_task(server.run()), group.create_task(lossy.run())]
            await asyncio.sleep(0)
            for number in range(count):
                if incoming:
                    server.send(number.to_bytes(2), 1)
                else:
                    lossy.send(number.to_bytes(2), SERVER)
                await asyncio.sleep(pause)
            await asyncio.sleep(1.0)
            for task in tasks:
                task.cancel()

    run_virtual(main())
    return arrived


def numbers(arrived: list[tuple[bytes, float]]) -> list[int]:
    return [int.from_bytes(packet) for packet, _ in arrived]


def test_without_faults_everything_arrives() -> None:
    assert numbers(carried(100)) == list(range(100))
    assert numbers(carried(100, incoming=True)) == list(range(100))


def test_lost_packets_are_lost_in_both_directions_and_the_same_each_time() -> None:
    for incoming in (False, True):
        arrived = numbers(carried(1000, drop=0.2, incoming=incoming))
        assert 750 < len(arrived) < 850
        assert arrived == sorted(arrived)
        assert arrived == numbers(carried(1000, drop=0.2, incoming=incoming))


def test_doubled_packets_come_twice() -> None:
    times = Counter(numbers(carried(1000, duplicate=0.1)))
    assert set(times.values()) == {1, 2}
    assert 70 < sum(count == 2 for count in times.values()) < 130


def test_held_packets_are_overtaken_and_none_is_lost() -> None:
    arrived = numbers(carried(200, reorder=0.1))
    assert arrived != sorted(arrived)
    assert sorted(arrived) == list(range(200))


def test_delay_moves_every_packet_and_keeps_the_order() -> None:
    arrived = carried(50, pause=0.0, delay=0.25)
    assert numbers(arrived) == list(range(50))
    assert {now for _, now in arrived} == {0.25}


def test_a_late_packet_without_room_is_counted() -> None:
    server, client = inproc_pair()
    lossy = LossyLink(client, random=Random(1), delay=0.1)

    async def main() -> None:
        async with asyncio.TaskGroup() as group:
            tasks = [group.create_task(server.run()), group.create_task(lossy.run())]
            await asyncio.sleep(0)
            for _ in range(QUEUE_PACKETS + 3):
                lossy.send(b"x", SERVER)
            assert lossy.has_room(SERVER)
            await asyncio.sleep(1.0)
            lossy.send(b"never released", SERVER)
            for task in tasks:
                task.cancel()
        await asyncio.sleep(1.0)

    run_virtual(main())
    assert lossy.counters.dropped == {"held back, then not sent: LinkFull": 3}
    assert server.counters.packets_in == QUEUE_PACKETS


def test_everything_else_is_the_wrapped_link() -> None:
    server, client = inproc_pair()
    lossy = LossyLink(client, random=Random(1))
    told: list[object] = []
    lossy.attach(signal=lambda signal, peer, words, now: told.append(signal))
    lossy.attach(room=told.append)
    lossy.tap = lambda now, way, peer, packet: told.append((way, packet))
    assert lossy.tap is client.tap

    async def main() -> None:
        async with asyncio.TaskGroup() as group:
            tasks = [group.create_task(server.run()), group.create_task(lossy.run())]
            await asyncio.sleep(0)
            for _ in range(QUEUE_PACKETS):
                lossy.send(b"x", SERVER)
            await asyncio.sleep(0.1)
            for task in tasks:
                task.cancel()

    run_virtual(main())
    assert told[0] is Signal.LINK_UP
    assert told.count(("out", b"x")) == QUEUE_PACKETS
    assert SERVER in told
    assert (lossy.remote, lossy.describe(SERVER)) == (SERVER, "in-process server")
    assert lossy.info == replace(client.info, sparse_acknacks=False)


def test_a_link_without_a_handler_drops_what_it_gets() -> None:
    server, client = inproc_pair()
    lossy = LossyLink(client, random=Random(1))

    async def main() -> None:
        async with asyncio.TaskGroup() as group:
            tasks = [group.create_task(server.run()), group.create_task(lossy.run())]
            await asyncio.sleep(0)
            server.send(b"x", 1)
            await asyncio.sleep(0.1)
            for task in tasks:
                task.cancel()

    run_virtual(main())
    assert client.counters.packets_in == 1


@given(packets=st.lists(st.binary(max_size=20), max_size=30), seed=st.integers(0, 1 << 32))
def test_a_disturbance_that_is_told_nothing_does_nothing(packets: list[bytes], seed: int) -> None:
    disturbance = Disturbance(Random(seed))
    for packet in packets:
        assert disturbance.applies_to(1, packet, inward=True)
        assert list(disturbance.delays(1, 5.0, inward=False)) == [0.0]
        assert disturbance.free_at(1, 5.0) == 5.0
