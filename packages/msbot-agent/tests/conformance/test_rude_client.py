"""What rude, broken and hostile agents send: the client lives on, counts it by reason, and its memory is bounded."""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Iterator
from contextlib import suppress
from random import Random

import pytest

from msbot.part.client.client import Client
from msbot.part.client.client_settings import ConnectionState
from msbot.process.virtual_time import run_virtual
from msbot_xrce import ClientState
from msbot_xrce.errors import RemoteProtocolError
from msbot_xrce.messages import STREAM_RELIABLE
from msbot_xrce.sessions import StatusReceived
from tests.agent.replay import load
from tests.conformance.agent_rig import WELCOME, octets
from tests.part.wire import HandLink
from tests.xrce.client_bench import Bench, acknack, data, fragment, head, heartbeat, received, status

RECORDINGS = ["udp_xml_loop_dds", "udp_reqrep_req", "udp_reqrep_rep", "udp_timesync", "udp_raw_get_info"]


def from_agents(name: str) -> Iterator[bytes]:
    """The packets that an agent sent in a recording."""
    return (line.packet for line in load(name) if not line.from_client)


def lives(bench: Bench) -> None:
    """Fail unless the client still logs in, hears and speaks."""
    bench.events()
    bench.session.connect(bench.now)
    bench.feed(WELCOME)
    bench.events()
    assert bench.state() is ClientState.CONNECTED
    assert bench.feed(head(0x80) + data("01")) == [acknack(1)]
    assert bench.events() == [received("01")]
    bench.session.write(0x0015, b"x", STREAM_RELIABLE)
    assert len(bench.pull()) == 1


def mutilated(packet: bytes) -> Iterator[bytes]:
    """The packet cut short at every octet, and with each octet changed."""
    for at in range(len(packet) + 1):
        yield packet[:at]
    for at in range(len(packet)):
        for octet in (0x00, 0x07, 0xFF):
            yield packet[:at] + bytes([octet]) + packet[at + 1 :]


@pytest.mark.parametrize("name", RECORDINGS)
@pytest.mark.parametrize("connected", [True, False])
def test_recorded_packets_cut_short_and_changed(name: str, *, connected: bool) -> None:
    bench = Bench(connected=connected)
    if not connected:
        bench.session.connect(0.0)
    for packet in from_agents(name):
        for one in mutilated(packet):
            with suppress(RemoteProtocolError):
                bench.feed(one.hex())
        bench.events()
    lives(bench)


def test_every_submessage_id_with_every_flag() -> None:
    bench = Bench()
    random = Random(1)
    for kind in range(256):
        for flags in (0x00, 0x01, 0x02, 0x07, 0x0E, 0x80, 0xFF):
            for contents in (b"", b"\0" * 4, b"\xff" * 9, random.randbytes(32)):
                body = bytes((kind, flags)) + struct.pack("<H", len(contents)) + contents
                bench.feed(head(0) + body.hex())
    lives(bench)


@pytest.mark.parametrize(
    ("packet", "reason"),
    [
        (head(1) + "0901ff00 000a0016", "broken DATA"),
        (head(1) + "09010300000a00", "DATA without ids, or in another format than DATA"),
        (head(1) + "09030800000a001600000000", "DATA without ids, or in another format than DATA"),
        (head(1) + "05010200 000a", "broken STATUS"),
        (head(0) + "04010200 0000", "broken STATUS_AGENT"),
        (head(0) + "06010900 000afffd 0000 07 0d58", "broken INFO"),
        (head(0) + "0f010800 0000000000000000", "broken TIMESTAMP_REPLY"),
        (head(0) + "02010200 0000", "broken GET_INFO"),
        (head(0) + "0a010300 000000", "broken ACKNACK"),
        (head(0) + "0b010300 000000", "broken HEARTBEAT"),
        (head(0) + "66010900 00", "broken submessage of an unknown kind"),
        (head(1) + fragment("00", last=True), "FRAGMENT outside of a reliable stream"),
        ("82000000" + data("00"), "message of another session"),
        (status(0, 0, 2), "answer that nobody asked for"),
        (WELCOME.replace("0b 00 00 00", "0b 00 85 00"), "answer that nobody asked for"),
        (acknack(7), "ACKNACK outside of what was sent"),
        (head(0x80, 500) + data("00"), "message beyond the window"),
    ],
    ids=lambda value: str(value)[:48],
)
def test_what_makes_no_sense_is_counted_by_reason(packet: str, reason: str) -> None:
    bench = Bench()
    bench.session.write(0x0015, b"x", STREAM_RELIABLE)
    bench.pull()
    bench.feed(packet)
    assert bench.session.dropped == {reason: 1}
    assert bench.events() == []
    lives(bench)


def test_streams_of_every_id_are_bounded() -> None:
    bench = Bench()
    for stream in range(1, 256):
        bench.feed(head(stream) + data("00"), heartbeat(0, 9, stream))
    assert bench.session.dropped["too many streams"] > 200
    lives(bench)


def test_fragments_without_end_are_given_up() -> None:
    bench = Bench()
    for number in range(40):
        assert bench.feed(head(0x80, number) + fragment("00" * 60_000)) == [acknack(number + 1)]
    assert bench.session.dropped == {"fragmented message larger than allowed": 1}
    bench.feed(head(0x80, 40) + fragment("00", last=True))
    assert bench.feed(head(0x80, 41) + data("01")) == [acknack(42)]
    assert bench.events() == [received("01")]


def test_statuses_for_requests_never_made_are_told_and_harm_nobody() -> None:
    bench = Bench()
    assert bench.feed(status(0x80, 0, 0xFFFF, 0x42, 0xFFFF)) == [acknack(1)]
    assert bench.events() == [StatusReceived(0xFFFF, 0xFFFF, 0x42)]


def test_the_client_of_a_part_lives_on() -> None:
    async def main() -> None:
        link = HandLink()
        client = Client(link, key=0xAABBCCDD)
        running = asyncio.create_task(client.run())
        await asyncio.sleep(0.01)
        link.receive(octets(WELCOME))
        client.read(
            client.create_reader(
                client.create_subscriber(participant := client.create_participant("p")),
                client.create_topic(participant, "t", "T"),
            )
        )
        for name in RECORDINGS:
            for packet in from_agents(name):
                for one in mutilated(packet):
                    link.receive(one)
        await asyncio.sleep(10.0)
        link.receive(octets(WELCOME))
        link.receive(octets(WELCOME.replace("81", "82", 1)))
        await asyncio.sleep(0.01)
        assert client.state is ConnectionState.CONNECTED
        assert not running.done()
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)

    run_virtual(main())
