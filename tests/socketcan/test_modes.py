"""The link by itself on a bus of the kernel, in each of its modes; no packet is lost, doubled or altered."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from random import Random

import pytest

from msbot_agent.agent import Agent
from msbot_agent.link import Link, Signal, open_link
from msbot_agent.link.can import CanPartLink
from msbot_agent.link.can.legacy_link import COMPONENT, MASTER
from msbot_agent.link.can.protocol import Frame
from msbot_agent.link.can.protocol.join_master import STARTING_S
from msbot_agent.space import MemorySpace
from msbot_xrce.errors import LinkDown
from msbot_xrce.messages import Header, WriteData, encode_message
from msbot_xrce.objects import EndpointQos
from tests.hearing_client import HearingClient
from tests.socketcan.bus import HASH, SETTINGS, candump, listening, running, until

NATIVE = ["can:vcan0", "can:vcan0?compression=0", "can:vcan0?fd=1", "can:vcan0?fd=1&compression=0"]
SIZES = [*((size, 10) for size in (1, 7, 8, 62, 63, 64, 200)), (418, 3), (4096, 1)]
"""Octets of a packet, and how many parts exchange it with the master at once: a virtual bus has no bit rate that would
keep the senders back, and a computer can be too slow for it."""
KEY = 0xBA5EBA11
"""The client key of the thesis' firmware."""


def part_link(address: str, number: int) -> Link:
    """A part's end with an identity of its own."""
    return open_link(address, can=replace(SETTINGS, uid=number.to_bytes(8, "big")))


async def exchange(one: HearingClient, other: HearingClient, samples: list[bytes]) -> None:
    """Samples go from one client to the other, all of them, in order."""
    came: list[bytes] = []
    other.on_topic = lambda object_id, request_id, payload: came.append(payload)
    participant = one.create_participant()
    writer = one.create_writer(one.create_publisher(participant), one.create_topic(participant, "rt/olimex", "T"))
    participant = other.create_participant()
    topic = other.create_topic(participant, "rt/olimex", "T")
    other.read(other.create_reader(other.create_subscriber(participant), topic, EndpointQos(keep_all=True)))
    for client in (one, other):
        await client.until_all_statuses(timeout_s=60)
    for number, sample in enumerate(samples, start=1):
        one.write(writer, sample)
        await until(lambda number=number: len(came) >= number)  # type: ignore[misc]
    assert came == samples


async def ended(tasks: list[asyncio.Task[None]]) -> None:
    """End tasks."""
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


@pytest.mark.parametrize("address", NATIVE)
async def test_packets_of_all_sizes_arrive_both_ways_with_ten_parts(address: str) -> None:
    master = open_link(address, serve=True, can=SETTINGS)
    parts = [part_link(address, number) for number in range(1, 11)]
    dice = Random(address)
    async with running(master, *parts) as (top, *ends):
        await until(lambda: len(top.told(Signal.PEER_JOINED)) >= 10)
        nodes = {end.link.node_id: end for end in ends if isinstance(end.link, CanPartLink)}
        sent: dict[int, list[bytes]] = {node: [] for node in nodes}
        for size, receivers in SIZES:
            for node in list(nodes)[:receivers]:
                sent[node].append(dice.randbytes(size))
                await top.send_all(sent[node][-1:], node)
                await nodes[node].send_all(sent[node][-1:], 0)
            total = sum(map(len, sent.values()))
            await until(lambda total=total: len(top.packets) == sum(len(end.packets) for end in ends) == total)  # type: ignore[misc]
        for node, end in nodes.items():
            assert [packet for packet, _ in end.packets] == sent[node]
            assert [packet for packet, peer in top.packets if peer == node] == sent[node]
        assert [end.link.counters.dropped for end in (top, *ends)] == [{}] * 11


async def test_stop_reaches_everybody() -> None:
    master, part = open_link("can:vcan0", serve=True, can=SETTINGS), part_link("can:vcan0", 1)
    async with running(master, part) as ends, listening("can:vcan0") as ear:
        await ear.send(Frame(0x008, b"\x01"))
        for end in ends:
            assert await end.until_told(Signal.STOP) == "STOP was pressed"


async def test_a_second_master_refuses_to_start_and_names_the_other_robot() -> None:
    first = open_link("can:vcan0", serve=True, can=SETTINGS)
    second = open_link("can:vcan0", serve=True, can=replace(SETTINGS, profile_hash=0xBADC0DE))
    async with running(first) as (end,):
        await asyncio.sleep(STARTING_S + 0.1)  # from then on it stays, and whoever comes goes
        with pytest.raises(LinkDown, match=f"another master is on this bus.*{HASH:08x}"):
            await asyncio.wait_for(second.run(), 60)
        assert end.told(Signal.LINK_DOWN) == []


async def test_legacy_frames_are_those_of_the_thesis_and_its_client_works() -> None:
    """T7 and T8: identifiers 0x123 and 0x120, byte 0 counts down; the whole set-up is done at the first try."""
    agent = Agent(MemorySpace())
    agent.add_link(open_link("can-legacy:vcan0", serve=True, can=SETTINGS))
    client = HearingClient(open_link("can-legacy:vcan0", can=SETTINGS), key=KEY)
    async with candump("vcan0") as tool:
        tasks = [asyncio.create_task(agent.run()), asyncio.create_task(client.run())]
        try:
            await client.connect(timeout_s=60)
            frames = [await tool.next() for _ in range(7)]
            assert [(frame.can_id, frame.data[0], len(frame.data)) for frame in frames] == [
                *((0x123, index, dlc) for index, dlc in ((3, 8), (2, 8), (1, 8), (0, 4))),
                *((0x120, index, dlc) for index, dlc in ((2, 8), (1, 8), (0, 6))),
            ]
            assert bytes.fromhex("BA5EBA11") in b"".join(frame.data[1:] for frame in frames[:4])
            await exchange(client, client, [bytes([number]) * size for number, size in enumerate((4, 12, 400, 1500))])
            assert client.counters.logins == 1
        finally:
            await ended(tasks)


async def test_a_legacy_message_has_at_most_1792_octets() -> None:
    master = open_link("can-legacy:vcan0", serve=True, can=SETTINGS)
    component = open_link("can-legacy:vcan0", can=SETTINGS)
    message = encode_message(Header(0x81, 0x80, 1), [WriteData(10, 0x15, bytes(1780))], pad_end=False)
    assert len(message) == 1792
    async with running(master, component) as (top, end):
        await end.send_all([message], MASTER)
        await top.until_packets(1)
        await top.send_all([message], COMPONENT)
        await end.until_packets(1)
        assert (top.packets, end.packets) == ([(message, COMPONENT)], [(message, MASTER)])


async def test_clients_with_eprosimas_can_fd_framing_reach_each_other_through_the_agent() -> None:
    """One frame is one packet of at most 63 octets; larger ones travel in fragments."""
    agent = Agent(MemorySpace())
    agent.add_link(open_link("canfd:vcan0", serve=True, can=SETTINGS))
    clients = [HearingClient(open_link(f"canfd:vcan0?id={key:#x}", can=SETTINGS), key=key) for key in (0xA1, 0xB2)]
    async with listening("can:vcan0?fd=1") as ear:
        tasks = [asyncio.create_task(agent.run()), *(asyncio.create_task(client.run()) for client in clients)]
        try:
            for client in clients:
                await client.connect(timeout_s=60)
            await exchange(clients[0], clients[1], [bytes([number]) * (10 + 30 * number) for number in range(8)])
            assert {view.address for view in agent.clients()} == {"CAN identifier 0xa1", "CAN identifier 0xb2"}
            assert {(frame.can_id, frame.fd, frame.extended) for frame in ear.frames} == {
                (0xA1, True, True),
                (0xB2, True, True),
            }
        finally:
            await ended(tasks)
