"""MQTT: the broker for simulated devices, whatever its clients send, in chunks of any size."""

from __future__ import annotations

from collections.abc import Iterable
from random import Random

from fuzz.bounds import hold
from fuzz.case import Case, Step, Violation, plain
from fuzz.mutate import mutate_octets
from msbot_bridges.mqtt.own_broker.broker_core import (
    MOST_CLIENTS,
    MOST_FILTERS_IN_ALL,
    MOST_RETAINED,
    MOST_RETAINED_OCTETS,
    MOST_UNRELEASED,
    BrokerClient,
    BrokerCore,
)
from msbot_bridges.mqtt.own_broker.packets import (
    LONGEST_PACKET,
    MqttPacket,
    PacketSplitter,
    PacketType,
    read_publish,
)
from msbot_xrce.errors import RemoteProtocolError

PEERS = 3


def packet(kind: int, body: bytes = b"", flags: int = 0) -> bytes:
    """A packet of any kind and size."""
    length, head = len(body), bytearray([kind << 4 | flags])
    while True:
        length, octet = length >> 7, length & 0x7F
        head.append(octet | (0x80 if length else 0))
        if not length:
            return bytes(head) + body


def text(words: bytes) -> bytes:
    """A text as MQTT has it."""
    return len(words).to_bytes(2, "big") + words


TOPICS = (
    b"a",
    b"a/b",
    b"a/+",
    b"a/#",
    b"#",
    b"+",
    b"$SYS/x",
    b"a//b",
    b"/",
    "ä".encode(),
    b"\xff",
    b"a\0b",
    b"/" * 400,
)
ALIVE = packet(1, text(b"MQTT") + b"\x04\x02\x00\x00" + text(b"honest"))


def _connect(random: Random) -> bytes:
    flags = random.choice((0x02, 0x02, 0x06, 0x26, 0x2E, 0x36, 0x03, 0xC2, 0x00))
    body = text(random.choice((b"MQTT", b"MQTT", b"MQIsdp", b"XXXX"))) + bytes((random.choice((4, 4, 4, 3, 5)), flags))
    body += random.choice((b"\x00\x00", b"\x00\x05", b"\xff\xff")) + text(random.choice((b"", b"a", b"b", b"honest")))
    if flags & 0x04:
        body += text(random.choice(TOPICS)) + text(random.randbytes(random.choice((0, 3))))
    return packet(1, body)


def _subscribe(random: Random) -> bytes:
    number = random.choice((0, 1, 7, 65535)).to_bytes(2, "big")
    some = [text(random.choice(TOPICS)) for _ in range(random.choice((0, 1, 2, 5, 1200)))]
    if random.random() < 0.3:
        return packet(10, number + b"".join(some), 2)
    return packet(8, number + b"".join(one + bytes((random.choice((0, 1, 2, 0x83)),)) for one in some), 2)


def _publish(random: Random) -> bytes:
    qos = random.choice((0, 0, 1, 2, 3))
    number = random.choice((0, 1, 2, 3)).to_bytes(2, "big") if qos else b""
    payload = random.randbytes(random.choice((0, 1, 30, 3000)))
    return packet(3, text(random.choice(TOPICS)) + number + payload, qos << 1 | random.choice((0, 1)) | 8 * (qos > 1))


def _answer(random: Random) -> bytes:
    return packet(
        random.choice((2, 4, 5, 6, 7, 9, 11, 12, 13, 14, 15, 0)), random.randbytes(random.choice((0, 2, 2, 5)))
    )


class MqttTarget:
    """See the module's docstring."""

    name = "mqtt"
    about = "the broker for simulated devices: chunks do not matter, tables are bounded, honest clients go on"

    def make(self, random: Random) -> Case:
        """A few clients, each with packets of which most are right."""
        steps = [
            Step(str(peer), packet(1, text(b"MQTT") + b"\x04\x02\x00\x05" + text(b"c%d" % peer)))
            for peer in range(PEERS)
        ]
        for _ in range(random.choice((1, 3, 10, 30))):
            octets = random.choice((_connect, _subscribe, _subscribe, _publish, _publish, _publish, _answer))(random)
            if random.random() < 0.25:
                octets = mutate_octets(random, octets, (ALIVE, b"\x30\xff\xff\xff\x7f", b"\xff" * 5))
            steps.append(Step(str(random.randrange(PEERS)), octets))
        if random.random() < 0.3:
            random.shuffle(steps)
        return tuple(steps)

    def run(self, case: Case) -> Iterable[str]:
        """Two honest clients beside, before and after."""
        core, seen = BrokerCore(), set[str]()
        sender, hearer = _Peer(core), _Peer(core)
        for peer, octets in (
            (sender, ALIVE.replace(b"honest", b"sender")),
            (hearer, ALIVE.replace(b"honest", b"hearer")),
        ):
            peer.say(octets)
        hearer.say(packet(8, b"\0\1" + text(b"honest/only") + b"\1", 2))
        peers: dict[str, _Peer] = {}
        for step in case:
            own = peers.get(step.verb)
            if own is None or own.is_over:
                own = peers[step.verb] = _Peer(core)
            seen.update(own.say(step.data))
            self._bounded(core)
        for peer in peers.values():
            _same_in_chunks(peer)
        hearer.heard.clear()
        sender.say(packet(3, text(b"honest/only") + b"\0\1after", 2))
        got = [read_publish(one).payload for one in hearer.heard if one.type == PacketType.PUBLISH]
        if got != [b"after"] and not (sender.is_over or hearer.is_over):  # another of the same name takes a place
            raise Violation(f"an honest client heard {got}")
        return seen

    def _bounded(self, core: BrokerCore) -> None:
        hold("clients", len(core.clients), MOST_CLIENTS)
        hold("filters in all", sum(len(one.filters) for one in core.clients), MOST_FILTERS_IN_ALL)
        hold("retained messages", len(core._retained), MOST_RETAINED)
        octets = sum(len(one.topic.encode()) + len(one.payload) for one in core._retained.values())
        if octets != core._retained_octets:
            raise Violation(f"{octets} octets are retained, and {core._retained_octets} are counted")
        hold("octets of retained messages", octets, MOST_RETAINED_OCTETS)
        for one in core.clients:
            hold("messages that were not released", len(one.unreleased), MOST_UNRELEASED)


class _Peer:
    """A client without a network; whatever the broker sends must be MQTT."""

    def __init__(self, core: BrokerCore) -> None:
        self.core, self.is_over = core, False
        self.heard = list[MqttPacket]()
        self.octets = b""
        self._from_broker, self._to_broker = PacketSplitter(), PacketSplitter(PacketType.CONNECT)
        self.client = BrokerClient(self._take, self._close, 0.0)
        self.is_over = not core.joined(self.client)

    def _take(self, octets: bytes) -> None:
        self.heard += self._from_broker.receive(octets)

    def _close(self) -> None:
        self.is_over = True

    def say(self, octets: bytes) -> list[str]:
        seen: list[str] = []
        if self.is_over:
            return seen
        self.octets += octets
        try:
            for one in self._to_broker.receive(octets):
                self.core.hear(self.client, one, 0.0)
                seen.append(f"type {one.type}")
                if self.is_over:
                    break
        except RemoteProtocolError as error:
            self.is_over = True
            seen.append(plain(str(error), 45))
        hold("octets of a packet", len(self._to_broker._rest), LONGEST_PACKET + 5 + len(octets))
        if self.is_over:
            self.core.left(self.client)
        return seen


def _same_in_chunks(peer: _Peer) -> None:
    """The same octets one by one are the same packets."""

    def split(size: int) -> list[MqttPacket]:
        splitter, found = PacketSplitter(PacketType.CONNECT), list[MqttPacket]()
        try:
            for at in range(0, len(peer.octets), size):
                found += splitter.receive(peer.octets[at : at + size])
        except RemoteProtocolError:
            return []
        return found

    pieces, whole = split(7), split(len(peer.octets) or 1)
    if pieces and whole and pieces != whole:
        raise Violation(f"{len(whole)} packets at once are {len(pieces)} in chunks")
