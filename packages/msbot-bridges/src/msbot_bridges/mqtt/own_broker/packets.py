"""Packets of MQTT 3.1.1 (OASIS standard, 29 October 2014), as far as a broker reads and writes them. Without I/O."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from enum import IntEnum

from msbot_xrce.errors import RemoteProtocolError
from msbot_xrce.lazy import dataclass

LONGEST_PACKET = 262_144
"""Octets of a packet; a client that sends a longer one is disconnected."""
MOST_LEVELS = 64
"""Levels of a topic or filter: each is looked at for each filter."""
MOST_AT_ONCE = 1000
"""Filters in one packet."""
LEVEL = 4
"""The protocol level of MQTT 3.1.1."""


class PacketType(IntEnum):
    """The kinds of packets, section 2.2.1."""

    CONNECT = 1
    CONNACK = 2
    PUBLISH = 3
    PUBACK = 4
    PUBREC = 5
    PUBREL = 6
    PUBCOMP = 7
    SUBSCRIBE = 8
    SUBACK = 9
    UNSUBSCRIBE = 10
    UNSUBACK = 11
    PINGREQ = 12
    PINGRESP = 13
    DISCONNECT = 14


@dataclass(frozen=True, slots=True)
class MqttPacket:
    """A packet as it came: its type, its four flags, and what follows the length."""

    type: int
    flags: int
    body: bytes


@dataclass(frozen=True, slots=True)
class Publication:
    """A message with its topic."""

    topic: str
    payload: bytes
    qos: int = 0
    is_retained: bool = False
    packet_id: int = 0
    """0 with QoS 0."""


@dataclass(frozen=True, slots=True)
class Connect:
    """What a client says first."""

    level: int
    client_id: str
    keep_alive_s: int
    will: Publication | None
    is_clean: bool


class PacketSplitter:
    """Cuts the octets of a connection into packets.

    Args:
        first: the type that the first packet must have; None: any.
    """

    def __init__(self, first: PacketType | None = None) -> None:
        self._rest = bytearray()
        self._first = first

    def receive(self, octets: bytes) -> list[MqttPacket]:
        """The packets that are complete.

        Raises:
            RemoteProtocolError: what came is no MQTT, or a packet is too long.
        """
        self._rest += octets
        if self._first is not None and self._rest:
            if self._rest[0] >> 4 != self._first:
                raise RemoteProtocolError(f"something else before {self._first.name}")
            self._first = None
        found = []
        while (packet := self._next()) is not None:
            found.append(packet)
        return found

    def _next(self) -> MqttPacket | None:
        length = shift = 0
        for at in range(1, 5):
            if at >= len(self._rest):
                return None
            length |= (self._rest[at] & 0x7F) << shift
            shift += 7
            if not self._rest[at] & 0x80:
                break
        else:
            raise RemoteProtocolError("a length of more than four octets")
        if length > LONGEST_PACKET:
            raise RemoteProtocolError(f"a packet of {length} octets; there may be {LONGEST_PACKET}")
        end = at + 1 + length
        if len(self._rest) < end:
            return None
        head, body = self._rest[0], bytes(self._rest[at + 1 : end])
        del self._rest[:end]
        return MqttPacket(head >> 4, head & 0x0F, body)


class _Reader:
    """The fields of a packet, in order."""

    def __init__(self, body: bytes) -> None:
        self._body, self._at = body, 0

    @property
    def is_at_end(self) -> bool:
        return self._at >= len(self._body)

    def octets(self, count: int) -> bytes:
        if self._at + count > len(self._body):
            raise RemoteProtocolError("a packet that is too short")
        self._at += count
        return self._body[self._at - count : self._at]

    def number(self, count: int) -> int:
        return int.from_bytes(self.octets(count), "big")

    def field(self) -> bytes:
        return self.octets(self.number(2))

    def text(self) -> str:
        try:
            text = self.field().decode()
        except UnicodeDecodeError:
            raise RemoteProtocolError("a text that is not UTF-8") from None
        if "\0" in text:
            raise RemoteProtocolError("a text with U+0000")
        return text

    def rest(self) -> bytes:
        return self.octets(len(self._body) - self._at)


def read_connect(packet: MqttPacket) -> Connect:
    """Section 3.1. User and password are not looked at.

    Raises:
        RemoteProtocolError: it is malformed.
    """
    reader = _Reader(packet.body)
    if reader.text() not in ("MQTT", "MQIsdp"):
        raise RemoteProtocolError("no MQTT")
    level, flags, keep_alive = reader.number(1), reader.number(1), reader.number(2)
    if level != LEVEL:
        return Connect(level, "", keep_alive, None, is_clean=True)
    if flags & 1:
        raise RemoteProtocolError("a CONNECT with its reserved flag")
    client_id, will = reader.text(), None
    if flags & 0x04:
        qos = flags >> 3 & 3
        topic, payload = reader.text(), reader.field()
        check_topic(topic)
        if qos == 3:
            raise RemoteProtocolError("a will with QoS 3")
        will = Publication(topic, payload, qos, bool(flags & 0x20))
    return Connect(level, client_id, keep_alive, will, is_clean=bool(flags & 0x02))


def read_publish(packet: MqttPacket) -> Publication:
    """Section 3.3.

    Raises:
        RemoteProtocolError: it is malformed.
    """
    reader, qos = _Reader(packet.body), packet.flags >> 1 & 3
    if qos == 3:
        raise RemoteProtocolError("a PUBLISH with QoS 3")
    topic = reader.text()
    check_topic(topic)
    packet_id = _packet_id(reader) if qos else 0
    return Publication(topic, reader.rest(), qos, bool(packet.flags & 1), packet_id)


def read_packet_id(packet: MqttPacket) -> int:
    """PUBACK, PUBREL and others that have nothing else.

    Raises:
        RemoteProtocolError: it is malformed.
    """
    return _packet_id(_Reader(packet.body))


def read_subscribe(packet: MqttPacket) -> tuple[int, list[tuple[str, int]]]:
    """Section 3.8: the number of the packet, and filters with the QoS that is wanted.

    Raises:
        RemoteProtocolError: it is malformed.
    """
    reader = _Reader(packet.body)
    packet_id, wanted = _packet_id(reader), list[tuple[str, int]]()
    while not reader.is_at_end:
        wanted.append((reader.text(), reader.number(1) & 3))
    _check_count(wanted)
    return packet_id, wanted


def read_unsubscribe(packet: MqttPacket) -> tuple[int, list[str]]:
    """Section 3.10: the number of the packet, and filters.

    Raises:
        RemoteProtocolError: it is malformed.
    """
    reader = _Reader(packet.body)
    packet_id, filters = _packet_id(reader), list[str]()
    while not reader.is_at_end:
        filters.append(reader.text())
    _check_count(filters)
    return packet_id, filters


def _check_count(filters: Sequence[object]) -> None:
    if not 0 < len(filters) <= MOST_AT_ONCE:
        raise RemoteProtocolError(f"a packet with {len(filters)} filters; there may be 1 to {MOST_AT_ONCE}")


def _packet_id(reader: _Reader) -> int:
    packet_id = reader.number(2)
    if not packet_id:
        raise RemoteProtocolError("a packet with the number 0")
    return packet_id


def check_topic(topic: str) -> None:
    """Refuse what is no name of a topic, section 4.7.

    Raises:
        RemoteProtocolError: it is empty, has wildcards or too many levels.
    """
    if not topic or "+" in topic or "#" in topic:
        raise RemoteProtocolError("a topic that is empty or has wildcards")
    if topic.count("/") >= MOST_LEVELS:
        raise RemoteProtocolError(f"a topic with more than {MOST_LEVELS} levels")


def is_filter(text: str) -> bool:
    """Whether a text is a filter of topics: wildcards stand alone in their level, `#` only in the last one."""
    levels = text.split("/")
    return (
        bool(text)
        and len(levels) <= MOST_LEVELS
        and all(level in ("+", "#") or not set(level) & {"+", "#"} for level in levels)
        and "#" not in levels[:-1]
    )


def matches(wanted: Sequence[str], topic: Sequence[str]) -> bool:
    """Whether a topic is covered by a filter; both as levels. Wildcards do not cover a first level with `$`."""
    if topic[0].startswith("$") and wanted[0] in ("+", "#"):
        return False
    for at, level in enumerate(wanted):
        if level == "#":
            return True
        if at >= len(topic) or level not in ("+", topic[at]):
            return False
    return len(wanted) == len(topic)


# What a broker writes


def _written(packet_type: PacketType, body: bytes, flags: int = 0) -> bytes:
    head, length = bytearray([packet_type << 4 | flags]), len(body)
    while True:
        length, octet = length >> 7, length & 0x7F
        head.append(octet | (0x80 if length else 0))
        if not length:
            return bytes(head) + body


def connack(code: int) -> bytes:
    """Section 3.2; 0: accepted, 1: another version of the protocol is needed, 3: no room."""
    return _written(PacketType.CONNACK, bytes([0, code]))


def publish(publication: Publication) -> bytes:
    """Section 3.3."""
    topic = publication.topic.encode()
    number = publication.packet_id.to_bytes(2, "big") if publication.qos else b""
    body = len(topic).to_bytes(2, "big") + topic + number + publication.payload
    return _written(PacketType.PUBLISH, body, publication.qos << 1 | publication.is_retained)


def answer(packet_type: PacketType, packet_id: int) -> bytes:
    """PUBACK, PUBREC, PUBCOMP, UNSUBACK."""
    return _written(packet_type, packet_id.to_bytes(2, "big"))


def suback(packet_id: int, codes: Iterable[int]) -> bytes:
    """Section 3.9: the QoS of each filter, or 0x80 for one that is refused."""
    return _written(PacketType.SUBACK, packet_id.to_bytes(2, "big") + bytes(codes))


PINGRESP = _written(PacketType.PINGRESP, b"")
