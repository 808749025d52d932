"""Conformance cases 70 to 74: clocks, liveliness, discovery, framing (XRCE 1.0 §8.3.5.15, §8.4)."""

from __future__ import annotations

import asyncio
import os
import socket
import struct

import pytest

from msbot_agent.agent import DiscoveryResponder
from msbot_agent.link.byte_frames import SerialReceiver
from msbot_agent.link.net import TcpServerLink
from msbot_agent.link.serial import PtyServerLink
from tests.conformance.agent_rig import (
    CLOCK_NS,
    DELETE_CLIENT,
    DELETED,
    PING,
    PING_INSIDE,
    PROBE,
    WELCOME,
    AgentRig,
    acknack,
    create_client,
    hard_liveliness,
    info,
    octets,
    packets,
    participant,
    status,
)
from tests.conformance.servers import serving
from tests.link.ports import readable

CLOCK = struct.pack("<iI", *divmod(CLOCK_NS, 10**9)).hex()


@pytest.mark.parametrize("transmit", ["01 00 00 00 02 00 00 00", "16 3e 01 6b a3 94 8a 32", "ff ff ff ff ff c9 9a 3b"])
def test_case_70_timestamp_is_answered_on_none_and_returned_bit_by_bit(agent: AgentRig, transmit: str) -> None:
    agent.log_in()
    reply = f"81 00 00 00 0f 01 18 00 {CLOCK} {CLOCK} {transmit}"
    assert agent.say(f"81 80 00 00 0e 01 08 00 {transmit}") == packets(reply, acknack(1))
    assert len(octets(reply)) == 32
    assert agent.say(f"81 00 00 00 0e 01 08 00 {transmit}") == packets(reply)
    assert agent.say(f"80 00 00 00 0e 01 08 00 {transmit}") == []


def test_case_70_reply_that_does_not_fit_the_mtu_is_not_sent(agent: AgentRig) -> None:
    agent.log_in(mtu="18 00")
    assert agent.say("81 00 00 00 0e 01 08 00 01 00 00 00 02 00 00 00") == []


def test_case_71_silent_client_is_probed_three_times_200_ms_apart_and_is_unknown_then(agent: AgentRig) -> None:
    assert agent.say(create_client(properties=hard_liveliness("000400"))) == packets(WELCOME)
    probe = octets("81 00 00 00 02 01 08 00 00 00 ff fe 01 00 00 00").hex()
    assert agent.wait(0.99) == [(0.4, probe), (0.6, probe), (0.8, probe)]
    assert agent.say(PING_INSIDE) == packets(info("81 00 00 00", known=True))
    assert agent.wait(0.99) == [(0.4, probe), (0.6, probe), (0.8, probe)]
    assert agent.wait(0.02) == []
    assert agent.say(PING_INSIDE) == packets(info("81 00 00 00", known=False))
    assert agent.say(participant("81 80 00 00")) == []


@pytest.mark.parametrize(
    "answer",
    ["81 00 00 00 00 00 00 00 00 00 00 00", "81 00 00 00 06 01 08 00 00 00 ff fe 00 00 00 00"],
    ids=["as the C client", "a proper INFO"],
)
def test_case_71_answering_the_probe_keeps_the_session(agent: AgentRig, answer: str) -> None:
    agent.say(create_client(properties=hard_liveliness("000400")))
    agent.say(participant("81 80 00 00"), acknack(1))
    for _ in range(20):
        assert (0.4, octets(PROBE).hex()) in agent.wait(0.401)
        assert agent.say(answer) == []
    assert agent.say(participant("81 80 01 00")) == packets(status("81 80 01 00", code="82"), acknack(2))


async def test_case_72_discovery_is_answered_with_locators() -> None:
    responder = DiscoveryResponder(28889, port=0, interface="127.0.0.1")
    running = asyncio.create_task(responder.run())
    while responder.address is None:  # noqa: ASYNC110 - a port that opens makes no sound
        await asyncio.sleep(0)
    loop = asyncio.get_running_loop()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        client.setblocking(False)
        await loop.sock_sendto(client, octets("80 00 00 00 02 01 08 00 00 09 ff fd 03 00 00 00"), responder.address)
        answer = await loop.sock_recv(client, 2048)
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)
    assert answer == octets(
        "80 00 00 00 06 01 24 00 00 09 ff fd 00 00 01 0d 58 52 43 45 01 00 01 0f 00 01 0d 00 01 00 00 00"
        "01 00 00 00 01 7f 00 00 01 00 d9 70"
    )


def test_case_72_discovery_request_to_the_service_port_is_answered_without_locators(agent: AgentRig) -> None:
    assert agent.say("80 00 00 00 02 01 08 00 00 09 ff fd 03 00 00 00") == packets(
        info("80 00 00 00", request="00 09", known=False)
    )


async def test_case_73_tcp_packets_come_in_any_pieces_with_empty_ones_between() -> None:
    link = TcpServerLink("127.0.0.1", 0)
    async with serving(link):
        reader, writer = await asyncio.open_connection("127.0.0.1", link.port)
        writer.get_extra_info("socket").setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        login = octets("00 00 18 00 80 00 00 00 00 01 10 00 58 52 43 45 01 00 01 0f aa bb cc dd 81 00 fc 01 00 00")
        for octet in login:
            writer.write(bytes([octet]))
            await writer.drain()
        welcome = octets("13 00 81 00 00 00 04 01 0b 00 00 00 58 52 43 45 01 00 01 0f 00")
        assert await reader.readexactly(len(welcome)) == welcome
        # Several packets in one piece, too.
        create = octets(participant("81 80 00 00"))
        logout = octets(f"81 00 00 00 {DELETE_CLIENT}")
        writer.write(b"".join(len(packet).to_bytes(2, "little") + packet for packet in (create, logout)))
        answers = [octets(text) for text in (status("81 80 00 00"), acknack(1), DELETED)]
        expected = b"".join(len(packet).to_bytes(2, "little") + packet for packet in answers)
        assert await reader.readexactly(len(expected)) == expected
        writer.close()


async def test_case_74_serial_frames_of_others_and_broken_ones_are_ignored() -> None:
    link = PtyServerLink()
    async with serving(link):
        assert link.path is not None
        board = os.open(link.path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        receiver = SerialReceiver(1)

        async def say(*frames: str) -> list[bytes]:
            for frame in frames:
                os.write(board, octets(frame))
            came: list[tuple[int, bytes]] = []
            while not came:
                came = receiver.receive(await readable(board))
            return [packet for _, packet in came]

        ping = "7e 01 00 10 00 80 00 00 00 02 01 08 00 00 0a ff fd 02 00 00 00 cf 12"
        flipped = "7e 01 00 10 00 80 00 00 00 02 01 08 00 00 0b ff fd 02 00 00 00 cf 12"
        for_address_5 = "7e 01 05 10 00 80 00 00 00 02 01 08 00 00 0a ff fd 02 00 00 00 cf 12"
        pong = [octets(info("80 00 00 00", known=False))]
        try:
            assert await say(ping) == pong
            assert await say("67 61 72 62 61 67 65", ping) == pong
            assert await say(flipped, for_address_5, ping) == pong
            assert await say("7e 01 00 10 00 80 00", ping) == pong
            # Octets 7E and 7D in a packet, the address of the client among them.
            escaped = "7e 7d 5e 00 10 00 80 00 00 00 02 01 08 00 7d 5e 7d 5d ff fd 02 00 00 00 4e bd"
            receiver.address = 0x7E
            assert await say(escaped) == [octets(info("80 00 00 00", request="7e 7d", known=False))]
        finally:
            os.close(board)
    assert link.counters.dropped == {"wrong check sum": 1, "for another address": 1, "frame cut short": 1}


def test_case_74_the_frames_of_the_reference_decode() -> None:
    receiver = SerialReceiver(0)
    frame = octets("7e 00 00 10 00 81 01 7d 5e 00 07 01 08 00 00 7d 5d 00 15 7d 5e 7d 5d 5e 5d be fe")
    assert receiver.receive(frame) == [(0, octets("81 01 7e 00 07 01 08 00 00 7d 00 15 7e 7d 5e 5d"))]
    assert receiver.receive(octets("7e 00 00 09 00 31 32 33 34 35 36 37 38 39 3d bb")) == [(0, b"123456789")]
    assert receiver.receive(octets("7e 01 00 10 00 80 00 00 00 02 01 08 00 00 0a ff fd 02 00 00 00 cf 12")) == [
        (1, octets(PING))
    ]
