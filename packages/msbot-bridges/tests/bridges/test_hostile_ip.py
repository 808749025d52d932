"""Peers on MQTT and Modbus that break the rules: the bridge goes on, and finds honest devices all the same."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress

import pytest

from msbot.part.messages.standard import Level, Speed
from msbot_bridges.bridge import BridgeLink, ForeignDevice
from msbot_bridges.mqtt.own_broker.broker_core import MOST_RETAINED_OCTETS, BrokerCore
from msbot_bridges.mqtt.own_broker.packets import LONGEST_PACKET, MOST_AT_ONCE, MOST_LEVELS, PacketType
from msbot_bridges.mqtt.own_broker.server import OwnBroker
from msbot_xrce.errors import RemoteProtocolError
from tests.bridges.hosting import running
from tests.bridges.test_every_world import PUMP
from tests.bridges.test_ip_swap import line, register
from tests.bridges.test_mqtt_settings import plugged
from tests.bridges.test_own_broker import Peer, connect
from tests.e2e.test_processes import free_port

aiomqtt = pytest.importorskip("aiomqtt")
pytest.importorskip("pymodbus")

PATIENCE_S = 120


@asynccontextmanager
async def in_front_of(port: int, answers: list[bytes]) -> AsyncIterator[tuple[int, asyncio.Event]]:
    """A server: each of its first connections gets one of these answers to whatever it says; later ones reach `port`.

    Gives where it is, and whether all the answers were given.
    """
    waiting, all_given = list(answers), asyncio.Event()

    async def carry(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with suppress(OSError):
            while octets := await reader.read(4096):
                writer.write(octets)
                await writer.drain()
        writer.close()

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with suppress(OSError):
            if waiting:
                await reader.read(4096)
                writer.write(waiting.pop(0))
                await writer.drain()
                with suppress(TimeoutError):
                    async with asyncio.timeout(0.3):
                        await reader.read(4096)
                writer.close()
                return
            all_given.set()
            there, here = await asyncio.open_connection("127.0.0.1", port)
            await asyncio.gather(carry(reader, here), carry(there, writer))

    server = await asyncio.start_server(serve, "127.0.0.1", 0)
    try:
        yield server.sockets[0].getsockname()[1], all_given
    finally:
        server.close()


CONNACK = b"\x20\x02\x00\x00"
BROKERS = [
    CONNACK + b"GET / HTTP/1.1\r\n\r\n",
    CONNACK + b"\x30\xff\xff\xff\xff\x01",
    CONNACK + b"\x30\x80\x80\x80\x02",  # announces 4 MB, and closes
    CONNACK + b"\x30\x04\x00\x02\xff\xfe" + b"\x30\x02\x00\x09" + b"\x30\x00",
    CONNACK + b"\x90\x03\xff\xff\x80" + b"\x40\x02\xff\xff" + b"\xb0\x00" + b"\x20\x02\x00\x00",
    b"\x20\x02\x00\xfe",
    b"\x20\x00",
    b"\xf0\x00" * 2000,
    b"",
]


@pytest.mark.parametrize("answer", BROKERS)
async def test_a_broker_that_breaks_the_rules_does_not_end_a_bridge_that_was_connected(answer: bytes) -> None:
    from msbot_bridges.mqtt.world import open_world

    async with (
        asyncio.timeout(PATIENCE_S),
        OwnBroker().running() as broker,
        plugged(broker.port, "1"),
        in_front_of(broker.port, [CONNACK + b"\xd0\x00", answer]) as (port, given),
        running(open_world(BridgeLink(f"mqtt://127.0.0.1:{port}"))) as host,
    ):
        device = await host.devices.get()
        assert given.is_set()
        assert device.identity.part_number == "simulated:lamp"


async def test_discovery_that_makes_no_sense_is_left_out_and_an_honest_device_is_found() -> None:
    configs: list[dict[str, object]] = [
        {"name": "x" * 60_000, "state_topic": "s", "device": {"identifiers": ["a"], "manufacturer": "\x00\x1b[31m"}},
        {"state_topic": "#", "command_topic": "+/#", "unique_id": "u", "device": {"identifiers": ["b"]}},
        {"state_topic": "a", "min": float("nan"), "max": 1e999, "step": -1, "device": {"identifiers": ["c"]}},
        {"state_topic": "t", "value_template": "{{ " + "(" * 3000 + " }}", "device": {"identifiers": ["d"]}},
        {"state_topic": "t", "value_template": "{{ value ** 9 ** 9 }}", "device": {"identifiers": ["e"]}},
        {"state_topic": "/" * 60_000, "device": {"identifiers": ["f"]}},
    ]
    bad = ["[" * 5000 + "]" * 5000, "{", "null", "[]", '{"device": 7}', '{"device": {"identifiers": [[]]}}']
    bad += [json.dumps(one) for one in configs]
    from msbot_bridges.mqtt.world import open_world

    async with asyncio.timeout(PATIENCE_S), OwnBroker().running() as broker:  # noqa: SIM117 - one client of the other
        async with aiomqtt.Client("127.0.0.1", broker.port) as attacker:
            for number, payload in enumerate(bad):
                for kind in ("light", "number", "sensor", "../x", "button"):
                    await attacker.publish(f"homeassistant/{kind}/n{number}/config", payload, qos=1, retain=True)
            for number in range(600):
                text = json.dumps({"state_topic": f"f/{number}", "device": {"identifiers": [f"flood{number}"]}})
                await attacker.publish(f"homeassistant/sensor/flood{number}/config", text, retain=True)
            async with (
                plugged(broker.port, "1"),
                running(open_world(BridgeLink(f"mqtt://127.0.0.1:{broker.port}"))) as host,
            ):
                while (device := await host.devices.get()).identity.part_number != "simulated:lamp":
                    pass
                device.begin(lambda _port, _message: None)
                device.act("lamp", Level(percent=40))
                await attacker.publish("msbot-lamp/1/state", "\x00" * 30_000)
                await attacker.publish("msbot-lamp/1/available", "perhaps")
                device.stop()
                while not host.told.is_set():
                    device.stop()
                    await asyncio.sleep(0.05)
                assert device.not_stopped == ""


def answer_to(body: bytes) -> bytes:
    """A frame of Modbus TCP for the bridge's first request."""
    return b"\x00\x01\x00\x00" + len(body).to_bytes(2, "big") + body


SERVERS = [
    b"\xff" * 300,
    answer_to(b"\x01\x2b\x0e\x01\x01\xff\xff\xff" + b"\x00\xff" * 3),  # objects that are not there
    answer_to(b"\x01\x2b\x0e\x01\x01\x00\x00\x03\x00\x02\xff\xfe\x01\x02\x00\x1b\x02\x01\xc3"),  # texts that are none
    answer_to(b"\x01\x04\xfe" + b"\x00" * 20),
    answer_to(b"\x01"),
    b"\x00\x01\x00\x07\x00\x05\x01\x04\x02\x00\x00",
    b"\x00\x01\x00\x00\xff\xff\x01\x04\xff" + b"\x00" * 2000,
    answer_to(b"\x01\xab\x63"),
    b"",
]


async def test_a_server_of_modbus_that_breaks_the_rules_does_not_end_the_bridge() -> None:
    from msbot_bridges.modbus.world import open_world

    port = free_port()
    async with (
        asyncio.timeout(PATIENCE_S),
        line(f"tcp:127.0.0.1:{port}", PUMP) as pump,
        in_front_of(port, SERVERS) as (here, given),
        running(open_world(BridgeLink(f"tcp:127.0.0.1:{here}", {"table": str(PUMP)}))) as host,
    ):
        device: ForeignDevice = await host.devices.get()
        assert given.is_set()
        assert device.identity.part_number == "ACME:pump"
        device.begin(lambda _port, _message: None)
        device.act("speed", Speed(rpm=100))
        while register(pump, 16) != 200:  # noqa: ASYNC110 - the library's server has no event for it
            await asyncio.sleep(0.02)


async def test_clients_of_modbus_that_break_the_rules_leave_the_simulated_devices_to_others() -> None:
    from msbot_bridges.modbus.world import open_world

    port = free_port()
    async with (
        asyncio.timeout(PATIENCE_S),
        line(f"tcp:127.0.0.1:{port}", PUMP),
        in_front_of(port, []) as (here, _),
        running(open_world(BridgeLink(f"tcp:127.0.0.1:{here}", {"table": str(PUMP)}))) as host,
    ):
        device = await host.devices.get()
        heard = asyncio.Queue[str]()
        device.begin(lambda name, _message: heard.put_nowait(name))
        for octets in (*SERVERS[:-1], b"\x00\x01\x00\x00\x00\x06\x01\x03\x00\x00\xff\xff", b"GET / HTTP/1.1\r\n\r\n"):
            _, writer = await asyncio.open_connection("127.0.0.1", port)
            writer.write(octets)
            await writer.drain()
            writer.close()
        while not heard.empty():
            heard.get_nowait()
        assert await heard.get()


def test_one_packet_does_not_bring_what_is_retained_again_and_again() -> None:
    core = BrokerCore()
    peer = Peer(core)
    peer.say(b"\x31\x04\x00\x01tx")
    same = b"\x00\x01#\x00" * MOST_AT_ONCE
    body = b"\x00\x01" + same
    head = b"\x82" + bytes((len(body) & 0x7F | 0x80, len(body) >> 7))
    peer.say(head + body)
    assert [one.type for one in peer.took()] == [PacketType.CONNACK, PacketType.SUBACK, PacketType.PUBLISH]
    more = body + b"\x00\x01#\x00"
    with pytest.raises(RemoteProtocolError, match=f"{MOST_AT_ONCE + 1} filters"):
        peer.say(b"\x82" + bytes((len(more) & 0x7F | 0x80, len(more) >> 7)) + more)
    with pytest.raises(RemoteProtocolError, match="0 filters"):
        peer.say(b"\x82\x02\x00\x01")


def test_levels_and_retained_octets_are_bounded() -> None:
    core = BrokerCore()
    peer = Peer(core, connect(b"a"))
    topic = b"/" * MOST_LEVELS
    with pytest.raises(RemoteProtocolError, match=f"more than {MOST_LEVELS} levels"):
        peer.say(b"\x30" + bytes((len(topic) + 2,)) + b"\x00" + bytes((len(topic),)) + topic)
    peer.took()
    peer.say(b"\x82" + bytes((len(topic) + 5,)) + b"\x00\x01\x00" + bytes((len(topic),)) + topic + b"\x00")
    assert peer.took()[0].body[-1] == 0x80, "a filter with so many levels is refused"
    size = LONGEST_PACKET - 10
    length = size + 4
    head = b"\x31" + bytes((length & 0x7F | 0x80, length >> 7 & 0x7F | 0x80, length >> 14))
    for number in range(MOST_RETAINED_OCTETS // size + 3):
        peer.say(head + b"\x00\x02" + b"%02d" % number + b"x" * size)
    assert core._retained_octets <= MOST_RETAINED_OCTETS
    assert core.dropped >= 2
    peer.say(b"\x31\x04\x00\x0200")
    assert "00" not in core._retained
