"""Who is connected to a broker, what they have subscribed to, and what is retained. Without I/O.

A client that is gone is forgotten: there are no persistent sessions, so each CONNACK says that there was none. The
highest QoS for those who listen is 1; what comes with QoS 2 is taken once. Packets are handed over to a connection,
which delivers them in order or ends, so nothing is sent again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import field

from msbot_bridges.mqtt.own_broker.packets import (
    LEVEL,
    PINGRESP,
    Connect,
    MqttPacket,
    PacketType,
    Publication,
    answer,
    connack,
    is_filter,
    matches,
    publish,
    read_connect,
    read_packet_id,
    read_publish,
    read_subscribe,
    read_unsubscribe,
    suback,
)
from msbot_xrce.errors import RemoteProtocolError
from msbot_xrce.lazy import dataclass

MOST_CLIENTS = 100
MOST_FILTERS = 5000
"""Of a client; further ones are refused."""
MOST_FILTERS_IN_ALL = 10_000
"""Of all clients: each message is compared with each of them."""
MOST_RETAINED = 5000
"""Messages that are retained; beyond, further ones are only delivered."""
MOST_RETAINED_OCTETS = 16 * 1024 * 1024
"""Octets of their topics and payloads."""
MOST_UNRELEASED = 1000
"""Messages with QoS 2 of a client that it has not released."""
HIGHEST_QOS = 1
CONNECT_S = 10.0
"""Longest time until a connection has said who it is."""
_REFUSED = 0x80
_OTHER_LEVEL, _NO_ROOM = 1, 3


@dataclass(eq=False, slots=True)
class BrokerClient:
    """One connection.

    Args:
        send: hands octets to it.
        close: ends it.
    """

    send: Callable[[bytes], None]
    close: Callable[[], None]
    heard_at: float
    said: Connect | None = None
    """None: not yet connected."""
    filters: dict[str, tuple[tuple[str, ...], int]] = field(default_factory=dict)
    """By filter: its levels, and its QoS."""
    unreleased: set[int] = field(default_factory=set)
    number: int = 0
    """Of the newest packet to it."""

    def quiet_until(self) -> float | None:
        """When it has been silent for too long; None: never."""
        if self.said is None:
            return self.heard_at + CONNECT_S
        return self.heard_at + 1.5 * self.said.keep_alive_s if self.said.keep_alive_s else None


class BrokerCore:
    """The broker."""

    def __init__(self) -> None:
        self.dropped = 0
        """Messages that could not be retained."""
        self._clients: list[BrokerClient] = []
        self._by_id: dict[str, BrokerClient] = {}
        self._retained: dict[str, Publication] = {}
        self._retained_octets = 0

    @property
    def clients(self) -> tuple[BrokerClient, ...]:
        """Those that are connected."""
        return tuple(self._clients)

    def joined(self, client: BrokerClient) -> bool:
        """A connection has come; False: there is no room for it."""
        if len(self._clients) >= MOST_CLIENTS:
            client.send(connack(_NO_ROOM))
            return False
        self._clients.append(client)
        return True

    def left(self, client: BrokerClient) -> None:
        """A connection is gone; unless its client has said goodbye, its will is done."""
        if client not in self._clients:
            return
        self._clients.remove(client)
        said, client.said = client.said, None
        if said is None:
            return
        if self._by_id.get(said.client_id) is client:
            del self._by_id[said.client_id]
        if said.will is not None:
            self._publish(said.will)

    def hear(self, client: BrokerClient, packet: MqttPacket, now: float) -> None:
        """Take a packet.

        Raises:
            RemoteProtocolError: it is malformed, or not allowed there; the connection must end.
        """
        client.heard_at = now
        if client.said is None:
            if packet.type != PacketType.CONNECT:
                raise RemoteProtocolError("something else before CONNECT")
            self._connect(client, read_connect(packet))
            return
        match packet.type:
            case PacketType.PUBLISH:
                self._take(client, read_publish(packet))
            case PacketType.PUBREL:
                packet_id = read_packet_id(packet)
                client.unreleased.discard(packet_id)
                client.send(answer(PacketType.PUBCOMP, packet_id))
            case PacketType.PUBACK:
                read_packet_id(packet)
            case PacketType.SUBSCRIBE:
                self._subscribe(client, *read_subscribe(packet))
            case PacketType.UNSUBSCRIBE:
                packet_id, filters = read_unsubscribe(packet)
                for one in filters:
                    client.filters.pop(one, None)
                client.send(answer(PacketType.UNSUBACK, packet_id))
            case PacketType.PINGREQ:
                client.send(PINGRESP)
            case PacketType.DISCONNECT:
                client.said = Connect(LEVEL, client.said.client_id, 0, None, is_clean=True)  # its will is void
                client.close()
            case _:
                raise RemoteProtocolError(f"a packet of type {packet.type}, which no client sends then")

    def silent(self, now: float) -> list[BrokerClient]:
        """Clients that have said nothing for one and a half of their keep-alive, section 3.1.2.10."""
        return [one for one in self._clients if (until := one.quiet_until()) is not None and now >= until]

    def next_silent(self) -> float | None:
        """When `silent` may have somebody."""
        return min((until for one in self._clients if (until := one.quiet_until()) is not None), default=None)

    def _connect(self, client: BrokerClient, said: Connect) -> None:
        if said.level != LEVEL:
            client.send(connack(_OTHER_LEVEL))
            raise RemoteProtocolError(f"protocol level {said.level}; here is MQTT 3.1.1")
        client.said = said
        if said.client_id:
            other = self._by_id.pop(said.client_id, None)
            self._by_id[said.client_id] = client
            if other is not None:
                other.close()
                self.left(other)
        client.send(connack(0))

    def _take(self, client: BrokerClient, publication: Publication) -> None:
        if publication.qos == 2:
            is_new = publication.packet_id not in client.unreleased
            if is_new and len(client.unreleased) >= MOST_UNRELEASED:
                raise RemoteProtocolError(f"{MOST_UNRELEASED} messages with QoS 2 that were not released")
            client.unreleased.add(publication.packet_id)
            client.send(answer(PacketType.PUBREC, publication.packet_id))
            if not is_new:
                return
        self._publish(publication)
        if publication.qos == 1:
            client.send(answer(PacketType.PUBACK, publication.packet_id))

    def _publish(self, publication: Publication) -> None:
        if publication.is_retained:
            self._retain(publication)
        levels = publication.topic.split("/")
        for client in self.clients:
            granted = [qos for wanted, qos in client.filters.values() if matches(wanted, levels)]
            if granted:
                self._deliver(client, publication, max(granted), is_old=False)

    def _retain(self, publication: Publication) -> None:
        """Keep a message in place of the one before; one for which there is no room leaves none."""
        before = self._retained.pop(publication.topic, None)
        if before is not None:
            self._retained_octets -= _octets(before)
        if not publication.payload:
            return
        size = _octets(publication)
        if len(self._retained) >= MOST_RETAINED or self._retained_octets + size > MOST_RETAINED_OCTETS:
            self.dropped += 1
            return
        self._retained[publication.topic] = publication
        self._retained_octets += size

    def _deliver(self, client: BrokerClient, publication: Publication, granted: int, *, is_old: bool) -> None:
        qos = min(publication.qos, granted)
        if qos:
            client.number = client.number % 0xFFFF + 1
        client.send(
            publish(Publication(publication.topic, publication.payload, qos, is_old, client.number if qos else 0))
        )

    def _subscribe(self, client: BrokerClient, packet_id: int, wanted: list[tuple[str, int]]) -> None:
        codes, taken = [], dict[tuple[str, ...], int]()
        in_all = sum(len(one.filters) for one in self._clients)
        for one, qos in wanted:
            is_new = one not in client.filters
            has_room = not is_new or (len(client.filters) < MOST_FILTERS and in_all < MOST_FILTERS_IN_ALL)
            if not is_filter(one) or not has_room:
                codes.append(_REFUSED)
                continue
            levels, granted = tuple(one.split("/")), min(qos, HIGHEST_QOS)
            in_all += is_new
            client.filters[one] = levels, granted
            codes.append(granted)
            taken[levels] = granted  # the retained messages come once for each filter, however often it is there
        client.send(suback(packet_id, codes))
        for levels, granted in taken.items():
            for publication in self._kept(levels):
                self._deliver(client, publication, granted, is_old=True)

    def _kept(self, levels: tuple[str, ...]) -> Iterator[Publication]:
        """What is retained for a filter; also when it was subscribed to before, section 3.8.4."""
        if not {"+", "#"} & set(levels):
            one = self._retained.get("/".join(levels))
            return iter(() if one is None else (one,))
        return (one for topic, one in list(self._retained.items()) if matches(levels, topic.split("/")))


def _octets(publication: Publication) -> int:
    return len(publication.topic.encode()) + len(publication.payload)
