"""The broker for simulated devices: against the library aiomqtt, mosquitto's clients, and what is no MQTT."""

from __future__ import annotations

import asyncio
import socket

import pytest

from msbot_bridges.mqtt.own_broker.broker_core import MOST_CLIENTS, BrokerClient, BrokerCore
from msbot_bridges.mqtt.own_broker.packets import (
    LONGEST_PACKET,
    MqttPacket,
    PacketSplitter,
    PacketType,
    is_filter,
    matches,
    read_publish,
)
from msbot_bridges.mqtt.own_broker.server import OwnBroker
from msbot_xrce.errors import LinkDown, RemoteProtocolError
from tests.bridges.mosquitto import kept, publish

aiomqtt = pytest.importorskip("aiomqtt")
PATIENCE_S = 60
CONNECT = b"\x10\x0d\x00\x04MQTT\x04\x02\x00\x05\x00\x01a"
"""Client `a`, clean session, keep-alive of 5 s."""


class Peer:
    """A client without a network."""

    def __init__(self, core: BrokerCore, first: bytes = CONNECT) -> None:
        self.core, self.splitter = core, PacketSplitter()
        self.heard = list[MqttPacket]()
        self.is_closed = False
        self.client = BrokerClient(self._take, self._close, 0.0)
        self.is_in = core.joined(self.client)
        if first and self.is_in:
            self.say(first)

    def _take(self, octets: bytes) -> None:
        self.heard += self.splitter.receive(octets)

    def _close(self) -> None:
        self.is_closed = True

    def say(self, octets: bytes, now: float = 0.0) -> None:
        for packet in PacketSplitter().receive(octets):
            self.core.hear(self.client, packet, now)

    def took(self) -> list[MqttPacket]:
        taken, self.heard = self.heard, []
        return taken


def connect(name: bytes, will: bytes = b"") -> bytes:
    body = b"\x00\x04MQTT\x04" + (b"\x26" if will else b"\x02") + b"\x00\x05" + len(name).to_bytes(2, "big") + name
    return b"\x10" + bytes([len(body) + len(will)]) + body + will


async def test_the_librarys_client_hears_what_another_says_and_what_was_retained() -> None:
    async with asyncio.timeout(PATIENCE_S), OwnBroker().running() as broker:
        lamp = aiomqtt.Client("127.0.0.1", broker.port)
        other = aiomqtt.Client("127.0.0.1", broker.port)
        async with lamp, other:
            await lamp.publish("a/there", "online", qos=1, retain=True)
            await other.subscribe([("a/+", 1), ("b/#", 0)])
            messages = other.messages
            old = await anext(messages)
            assert (old.topic.value, old.payload, old.retain) == ("a/there", b"online", True)
            for qos in range(3):
                await lamp.publish("b/x/y", f"qos {qos}", qos=qos)
                new = await anext(messages)
                assert (new.payload, new.retain, new.qos) == (f"qos {qos}".encode(), False, 0)
            await other.subscribe("a/there")
            assert (await anext(messages)).retain, "a filter that is subscribed to again brings it again"


async def test_mosquittos_clients_work_with_it() -> None:
    async with asyncio.timeout(PATIENCE_S), OwnBroker().running() as broker:
        await asyncio.to_thread(publish, broker.port, "room/lamp", "ON", retained=True)
        assert await asyncio.to_thread(kept, broker.port, "room/+") == "ON"


async def test_what_is_no_mqtt_ends_its_connection_and_no_other() -> None:
    async with (
        asyncio.timeout(PATIENCE_S),
        OwnBroker().running() as broker,
        aiomqtt.Client("127.0.0.1", broker.port) as good,
    ):
        for wrong in (b"GET / HTTP/1.1\r\n\r\n", b"\x10\xff\xff\xff\xff\x01", b"\x82\x00", CONNECT + b"\x00\x00"):
            reader, writer = await asyncio.open_connection("127.0.0.1", broker.port)
            writer.write(wrong)
            while await reader.read(100):
                pass
            writer.close()
        await good.subscribe("x")
        await good.publish("x", "still here")
        assert (await anext(good.messages)).payload == b"still here"


async def test_a_port_that_is_taken_is_named() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(LinkDown, match=f"port {port}"):
            async with OwnBroker(port).running():
                pass


def test_a_will_is_done_unless_the_client_said_goodbye() -> None:
    core = BrokerCore()
    listening = Peer(core)
    listening.say(b"\x82\x06\x00\x01\x00\x01w\x01")
    listening.took()
    for goodbye, wills in (("", 1), ("DISCONNECT", 0), ("another of its name", 1)):
        leaving = Peer(core, connect(b"b", b"\x00\x01w\x00\x04gone"))
        if goodbye:
            leaving.say(b"\xe0\x00") if goodbye == "DISCONNECT" else Peer(core, connect(b"b"))
            assert leaving.is_closed
        core.left(leaving.client)
        assert [read_publish(one).payload for one in listening.took()] == [b"gone"] * wills


def test_a_silent_client_is_found_after_one_and_a_half_of_its_keep_alive() -> None:
    core = BrokerCore()
    peer = Peer(core)
    assert core.next_silent() == 7.5
    assert not core.silent(7.4)
    assert core.silent(7.5) == [peer.client]
    peer.say(b"\xc0\x00", 7.4)
    assert [one.type for one in peer.took()] == [PacketType.CONNACK, PacketType.PINGRESP]
    assert not core.silent(7.5)
    assert Peer(core, b"").client in core.silent(10.0), "one that does not say who it is"


def test_what_comes_with_qos_2_is_taken_once() -> None:
    core = BrokerCore()
    peer = Peer(core)
    peer.say(b"\x82\x06\x00\x01\x00\x01t\x00")
    peer.took()
    message = b"\x34\x06\x00\x01t\x00\x09x"
    peer.say(message)
    peer.say(b"\x3c" + message[1:])  # sent again
    assert [one.type for one in peer.took()] == [PacketType.PUBREC, PacketType.PUBLISH, PacketType.PUBREC]
    peer.say(b"\x62\x02\x00\x09")
    assert [one.type for one in peer.took()] == [PacketType.PUBCOMP]


def test_tables_are_bounded() -> None:
    core = BrokerCore()
    peers = [Peer(core, connect(b"c%d" % number)) for number in range(MOST_CLIENTS + 1)]
    assert [one.is_in for one in peers] == [True] * MOST_CLIENTS + [False]
    assert peers[-1].took()[0].body == b"\0\3"
    with pytest.raises(RemoteProtocolError, match=str(LONGEST_PACKET)):
        PacketSplitter().receive(b"\x30\xff\xff\xff\x7f")


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (CONNECT, "which no client sends then"),
        (b"\x36\x05\x00\x01t\x00\x01", "QoS 3"),
        (b"\x30\x03\x00\x01+", "wildcards"),
        (b"\x30\x02\x00\x00", "empty"),
        (b"\x30\x04\x00\x02\xff\xff", "UTF-8"),
        (b"\x32\x05\x00\x01t\x00\x00", "number 0"),
        (b"\x30\x02\x00\x09", "too short"),
    ],
)
def test_malformed_packets_are_refused(wrong: bytes, words: str) -> None:
    peer = Peer(BrokerCore())
    with pytest.raises(RemoteProtocolError, match=words):
        peer.say(wrong)


def test_another_version_is_told_so() -> None:
    peer = Peer(BrokerCore(), b"")
    with pytest.raises(RemoteProtocolError, match="level 5"):
        peer.say(b"\x10\x0e\x00\x04MQTT\x05\x02\x00\x05\x00\x00\x01a")
    assert peer.took()[0].body == b"\0\1"


@pytest.mark.parametrize(
    ("wanted", "topic", "does"),
    [
        ("a/b", "a/b", True),
        ("a/+", "a/b", True),
        ("a/+", "a/b/c", False),
        ("a/+/c", "a/b/c", True),
        ("a/#", "a", True),
        ("a/#", "a/b/c", True),
        ("#", "a/b", True),
        ("+", "/a", False),
        ("/+", "/a", True),
        ("#", "$SYS/x", False),
        ("$SYS/#", "$SYS/x", True),
        ("a/b/c", "a/b", False),
    ],
)
def test_filters_cover_topics_as_the_standard_has_them(wanted: str, topic: str, *, does: bool) -> None:
    assert matches(wanted.split("/"), topic.split("/")) is does


@pytest.mark.parametrize(("text", "is_one"), [("a/+", True), ("#", True), ("a+", False), ("#/a", False), ("", False)])
def test_what_is_a_filter(text: str, *, is_one: bool) -> None:
    assert is_filter(text) is is_one
