"""A participant: finds others, tells of its writers and readers, and matches them. Pure: time is what it is told.

How it works. It announces itself to the group (and directly to whoever is new) until it leaves; who is not heard for
its lease is gone with all it had. Two reliable writers, kept for who comes later, tell of our writers and readers, two
reliable readers hear of those of others; both are of the same kind as those of the services. Only the topics of
services are remembered. What is to be sent is left in `outbox`; whoever drives it calls `tick` when `deadline` says.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Collection, Iterator

from msbot.errors import RemoteProtocolError
from msbot.runtime.lazy_dataclass import dataclass
from msbot.runtime.tally import Tally
from msbot.space.contract import Guid, Qos
from msbot.space.qos_matching import mismatch
from msbot.space.rtps import descriptions, wire
from msbot.space.rtps.descriptions import Address, EndpointDescription, ParticipantDescription
from msbot.space.rtps.reader import ReliableReader, Take, WriterProxy
from msbot.space.rtps.wire import Data, Inline, Prefix
from msbot.space.rtps.writer import Change, ReaderProxy, ReliableWriter

LEASE_S = 20.0
ANNOUNCE_S = 4.0
FIRST_ANNOUNCEMENTS = (0.0, 0.1, 0.3, 0.8, 2.0)
"""When it announces itself at first: a datagram may be lost."""
SHORTEST_LEASE_S = 1.0
LONGEST_LEASE_S = 300.0

MAX_PARTICIPANTS = 512
MAX_ENDPOINTS = 8192
"""Participants, and endpoints of services, of others that are remembered."""
LARGEST_DATAGRAM = 1400
"""Several submessages go into one datagram up to this size."""
MAX_OUTBOX = 4096
"""Datagrams that wait; more are dropped, as the network might, and are asked for again."""

INTRODUCTION_S = 1.0
"""The longest time that a request waits until the service's writer has been heard."""

CYCLONE = b"\x01\x10"
"""The vendor whose services read the identity in front of the body."""

_SPDP_WRITER, _SPDP_READER = b"\x00\x01\x00\xc2", b"\x00\x01\x00\xc7"
_PUBLICATIONS = b"\x00\x00\x03\xc2", b"\x00\x00\x03\xc7"
_SUBSCRIPTIONS = b"\x00\x00\x04\xc2", b"\x00\x00\x04\xc7"
_WRITER, _READER = 0x03, 0x04
KEPT_ENDS = 1024
"""So many ends of our endpoints are told to those that missed them."""
LEASE_CHECK_S = 1.0
_GONE = 3
"""Status of what is gone: disposed and unregistered."""


@dataclass(slots=True, eq=False)
class Peer:
    """A participant elsewhere."""

    description: ParticipantDescription
    meta: tuple[Address, ...]
    default: tuple[Address, ...]
    until: float


@dataclass(slots=True, eq=False)
class Endpoint:
    """A writer or reader of ours."""

    description: EndpointDescription
    writer: ReliableWriter | None = None
    reader: ReliableReader | None = None
    replies: str = ""
    """Of a writer of requests: the topic of their replies."""
    number: int = 0
    """In which sample of discovery it is told."""

    @property
    def guid(self) -> Guid:
        """By which others know it."""
        return self.description.guid

    @property
    def state(self) -> ReliableWriter | ReliableReader:
        """Its state machine."""
        found = self.writer or self.reader
        assert found is not None
        return found


class Participant:
    """The state of one participant."""

    def __init__(
        self,
        prefix: Prefix,
        *,
        addresses: tuple[Address, ...],
        group: Address,
        peers: tuple[Address, ...] = (),
        now: float,
        strangers: Collection[Prefix] = (),
        name: str = "msbot",
        epoch_ns: Callable[[], int] = lambda: 0,
    ) -> None:
        """Begin to announce it.

        Args:
            prefix: 12 octets that nobody else has.
            addresses: where it hears.
            group: where participants announce themselves.
            peers: addresses that are told, too.
            now: the time.
            strangers: participants that it does not listen to: they are in this process.
            name: what tools show.
            epoch_ns: the time of the samples.
        """
        self.prefix = prefix
        self.outbox: list[tuple[bytes, Address]] = []
        self.dropped = Tally()
        """Datagrams and samples that made no sense, or for which there was no room."""
        self.changed: Callable[[], object] = lambda: None
        """Called when an endpoint of another program comes or goes."""
        self._me = ParticipantDescription(prefix, wire.VENDOR, addresses, addresses, LEASE_S, name)
        self._group, self._initial = group, peers
        self._header = wire.header(prefix)
        self._strangers = frozenset(strangers)
        self._epoch_ns = epoch_ns
        self._peers: dict[Prefix, Peer] = {}
        self._known: dict[Guid, EndpointDescription] = {}
        self._by_topic: dict[str, dict[Guid, EndpointDescription]] = {}
        self._ours: dict[Guid, Endpoint] = {}
        self._ours_by_topic: dict[str, dict[Guid, Endpoint]] = {}
        self._entities = self._announced = 0
        self._asking: dict[str, dict[Guid, Endpoint]] = {}
        """Writers of requests by the topic of their replies."""
        self._ends: dict[ReliableWriter, deque[int]] = {}
        self._busy: set[ReliableWriter | ReliableReader] = set()
        """Those that may wait for a time."""
        self._next_check = now + LEASE_CHECK_S
        self._has_left = False
        self._begin = now
        self._next_announcement = now
        self._tellers: dict[bytes, ReliableWriter] = {}
        self._hearers: dict[bytes, ReliableReader] = {}
        for writer, reader in (_PUBLICATIONS, _SUBSCRIPTIONS):
            self._tellers[writer] = ReliableWriter(prefix + writer, self._to_reader, depth=0, durable=True)
            self._hearers[reader] = ReliableReader(prefix + reader, self._to_writer, self._discovered)
            self._ends[self._tellers[writer]] = deque()
        self._now = now

    # Endpoints of ours.

    def open_writer(
        self, topic: str, type_name: str, qos: Qos, user_data: bytes = b"", *, replies: str = ""
    ) -> Endpoint:
        """Make a writer; `replies` is the topic of what answers its requests."""
        guid = self._new_guid(_WRITER)
        endpoint = Endpoint(EndpointDescription(guid, topic, type_name, qos, (), user_data), replies=replies)
        endpoint.writer = ReliableWriter(guid, self._to_reader, depth=qos.depth)
        if replies:
            self._asking.setdefault(replies, {})[guid] = endpoint
        self._open(endpoint)
        return endpoint

    def open_reader(self, topic: str, type_name: str, qos: Qos, take: Take, user_data: bytes = b"") -> Endpoint:
        """Make a reader."""
        guid = self._new_guid(_READER)
        endpoint = Endpoint(EndpointDescription(guid, topic, type_name, qos, (), user_data))
        endpoint.reader = ReliableReader(guid, self._to_writer, take)
        self._open(endpoint)
        return endpoint

    def close_endpoint(self, endpoint: Endpoint, now: float) -> None:
        """It is gone: tell everybody."""
        self._now = now
        if self._ours.pop(endpoint.guid, None) is None:
            return
        namesakes = self._ours_by_topic[endpoint.description.topic]
        del namesakes[endpoint.guid]
        if not namesakes:
            del self._ours_by_topic[endpoint.description.topic]
        if endpoint.replies:
            asking = self._asking[endpoint.replies]
            del asking[endpoint.guid]
            if not asking:
                del self._asking[endpoint.replies]
        self._busy.discard(endpoint.state)
        teller = self._teller(endpoint)
        teller.forget(endpoint.number)
        key = descriptions.write_endpoint_key(endpoint.guid)
        teller.write(teller.last + 1, Change(key, Inline(None, _GONE, endpoint.guid)), now)
        self._busy.add(teller)
        ends = self._ends[teller]
        ends.append(teller.last)
        if len(ends) > KEPT_ENDS:
            teller.forget(ends.popleft())

    def write(self, endpoint: Endpoint, number: int, change: Change, now: float) -> None:
        """Send a sample."""
        self._now = now
        assert endpoint.writer is not None
        endpoint.writer.write(number, change, now)
        self._busy.add(endpoint.writer)

    def leave(self) -> None:
        """Tell everybody that it is gone; it hears and does nothing more."""
        self._has_left = True
        key = descriptions.write_participant_key(self.prefix)
        inline = Inline(None, _GONE, self.prefix + b"\x00\x00\x01\xc1")
        said = list(wire.data(wire.NOBODY, _SPDP_WRITER, 2, inline, key))
        for address in (self._group, *self._initial, *(at for peer in self._peers.values() for at in peer.meta)):
            self._post(said, address)

    # Others.

    def vendor(self, guid: Guid) -> bytes:
        """Who made the program that an endpoint elsewhere belongs to."""
        peer = self._peers.get(guid[:12])
        return bytes(2) if peer is None else peer.description.vendor

    def knows(self, guid: Guid) -> bool:
        """Whether the participant of that endpoint is there."""
        return guid[:12] in self._peers

    def on_topic(self, topic: str) -> Iterator[EndpointDescription]:
        """The endpoints of others on a topic."""
        return iter(self._by_topic.get(topic, {}).values())

    @property
    def peers(self) -> int:
        """Number of participants known now."""
        return len(self._peers)

    @property
    def known(self) -> int:
        """Number of endpoints of others that are remembered."""
        return len(self._known)

    # Driving.

    def receive(self, datagram: bytes, source: Address, now: float) -> None:
        """A datagram has come."""
        if self._has_left:
            return
        self._now = now
        try:
            sender, found = wire.read(datagram)
            if sender == self.prefix or sender in self._strangers:
                return
            for behalf, target, submessage in found:
                if target in (self.prefix, wire.ANYBODY):
                    self._hear(behalf, submessage, source, now)
        except RemoteProtocolError as error:
            self.dropped.count(str(error))

    def deadline(self) -> float:
        """When `tick` has something to do."""
        if self._has_left:
            return math.inf
        found = min(self._next_announcement, self._next_check)
        for state in tuple(self._busy):
            time = state.deadline()
            if time is None:
                self._busy.discard(state)
            elif time < found:
                found = time
        return found

    def tick(self, now: float) -> None:
        """Do what is due."""
        if self._has_left:
            return
        self._now = now
        if self._next_announcement <= now:
            self._announce()
            while self._announced < len(FIRST_ANNOUNCEMENTS) and (
                self._begin + FIRST_ANNOUNCEMENTS[self._announced] <= now
            ):
                self._announced += 1
            rest = FIRST_ANNOUNCEMENTS[self._announced :]
            self._next_announcement = self._begin + rest[0] if rest else now + ANNOUNCE_S
        if self._next_check <= now:
            self._next_check = now + LEASE_CHECK_S
            for prefix in [prefix for prefix, peer in self._peers.items() if peer.until <= now]:
                self._lose(prefix)
        for state in tuple(self._busy):
            state.tick(now)

    # What comes.

    def _hear(self, sender: Prefix, said: wire.Submessage, source: Address, now: float) -> None:
        if isinstance(said, Data) and said.writer == _SPDP_WRITER:
            self._hear_participant(sender, said, source, now)
            return
        if sender not in self._peers:
            return
        if isinstance(said, wire.AckNack | wire.NackFrag):
            writer = self._writer(said.writer)
            if writer is not None:
                self._busy.add(writer)
            if writer is not None and isinstance(said, wire.AckNack):
                writer.heard(sender + said.reader, said, now)
            elif writer is not None and isinstance(said, wire.NackFrag):
                writer.heard_fragments(sender + said.reader, said)
            return
        guid = sender + said.writer
        for reader in self._readers(said.reader, guid):
            self._busy.add(reader)
            if isinstance(said, Data):
                reader.heard_data(guid, said, now)
            elif isinstance(said, wire.Heartbeat):
                reader.heard_beat(guid, said, now)
                self._introduced(reader, sender, now)
            else:
                reader.heard_gap(guid, said)

    def _writer(self, entity: bytes) -> ReliableWriter | None:
        found = self._tellers.get(entity)
        if found is None:
            endpoint = self._ours.get(self.prefix + entity)
            found = None if endpoint is None else endpoint.writer
        return found

    def _readers(self, entity: bytes, writer: Guid) -> list[ReliableReader]:
        """The reader that is named; or all that hear that writer."""
        if entity != wire.NOBODY:
            named = self._hearers.get(entity)
            if named is None:
                endpoint = self._ours.get(self.prefix + entity)
                named = None if endpoint is None else endpoint.reader
            return [] if named is None else [named]
        for told, hearing in (_PUBLICATIONS, _SUBSCRIPTIONS):
            if writer[12:] == told:
                return [self._hearers[hearing]]
        known = self._known.get(writer)
        namesakes = {} if known is None else self._ours_by_topic.get(known.topic, {})
        return [one.reader for one in namesakes.values() if one.reader is not None and writer in one.reader.proxies]

    def _hear_participant(self, sender: Prefix, data: Data, source: Address, now: float) -> None:
        if data.inline.status or data.is_key:
            self._lose(sender)
            return
        told = descriptions.read_participant(data.payload)
        if told.prefix != sender or sender == self.prefix or sender in self._strangers:
            return
        until = now + min(max(told.lease_s, SHORTEST_LEASE_S), LONGEST_LEASE_S)
        peer = self._peers.get(sender)
        if peer is not None:
            peer.until = until
            return
        if len(self._peers) >= MAX_PARTICIPANTS:
            self.dropped.count(f"more than {MAX_PARTICIPANTS} participants")
            return
        meta, default = _best(told.meta, source), _best(told.default, source)
        if not meta or not default:
            self.dropped.count("a participant without an address of UDP over IPv4")
            return
        self._peers[sender] = Peer(told, meta, default, until)
        self._announce_to(meta)
        for (writer, reader), teller in zip((_PUBLICATIONS, _SUBSCRIPTIONS), self._tellers.values(), strict=True):
            teller.match(sender + reader, meta, now)
            self._hearers[reader].match(sender + writer, meta, now)
        self._busy.update(self._tellers.values(), self._hearers.values())

    def _lose(self, prefix: Prefix) -> None:
        if self._peers.pop(prefix, None) is None:
            return
        for writer, reader in (_PUBLICATIONS, _SUBSCRIPTIONS):
            self._tellers[writer].unmatch(prefix + reader)
            self._hearers[reader].unmatch(prefix + writer)
        for guid in [guid for guid in self._known if guid[:12] == prefix]:
            self._forget(guid)

    def _discovered(self, writer: Guid, data: Data) -> None:
        """A participant tells of one of its endpoints."""
        prefix = writer[:12]
        try:
            if data.inline.status or data.is_key:
                guid = data.inline.key or (
                    descriptions.read_key(data.payload, descriptions.ENDPOINT_GUID) if data.payload else None
                )
                if guid is not None and guid[:12] == prefix:
                    self._forget(guid)
                return
            told = descriptions.read_endpoint(data.payload)
        except RemoteProtocolError as error:
            self.dropped.count(str(error))
            return
        if told.guid[:12] != prefix or not told.topic.startswith(("rq/", "rr/")):
            return
        self._forget(told.guid)
        if len(self._known) >= MAX_ENDPOINTS:
            self.dropped.count(f"more than {MAX_ENDPOINTS} endpoints")
            return
        self._known[told.guid] = told
        self._by_topic.setdefault(told.topic, {})[told.guid] = told
        for ours in tuple(self._ours_by_topic.get(told.topic, {}).values()):
            self._match(ours, told)
        self.changed()

    def _forget(self, guid: Guid) -> None:
        told = self._known.pop(guid, None)
        if told is None:
            return
        namesakes = self._by_topic[told.topic]
        del namesakes[guid]
        if not namesakes:
            del self._by_topic[told.topic]
        for ours in self._ours_by_topic.get(told.topic, {}).values():
            if ours.writer is not None:
                ours.writer.unmatch(guid)
            elif ours.reader is not None:
                ours.reader.unmatch(guid)
        self.changed()

    # Matching.

    def _open(self, endpoint: Endpoint) -> None:
        told = endpoint.description
        self._ours[endpoint.guid] = endpoint
        self._ours_by_topic.setdefault(told.topic, {})[endpoint.guid] = endpoint
        teller = self._teller(endpoint)
        endpoint.number = teller.last + 1
        teller.write(endpoint.number, Change(descriptions.write_endpoint(told), wire.NOTHING), self._now)
        self._busy.add(teller)
        for other in tuple(self.on_topic(told.topic)):
            self._match(endpoint, other)

    def _match(self, ours: Endpoint, other: EndpointDescription) -> None:
        mine = ours.description
        writes = ours.writer is not None
        if descriptions.is_writer(other.guid) is writes or other.type_name != mine.type_name:
            return
        offered, asked = (mine.qos, other.qos) if writes else (other.qos, mine.qos)
        if mismatch(offered, asked) is not None:
            return
        self._busy.add(ours.state)
        locators = self._peers[other.guid[:12]].default
        if ours.writer is not None:
            held = None
            if ours.replies and not self._is_introduced(ours.replies, other.guid[:12]):
                held = self._now + INTRODUCTION_S
            ours.writer.match(
                other.guid,
                locators,
                self._now,
                plain=self.vendor(other.guid) == CYCLONE,
                reliable=other.qos.reliable,
                held_until=held,
            )
        elif ours.reader is not None:
            ours.reader.match(other.guid, locators, self._now, reliable=other.qos.reliable)

    def _is_introduced(self, replies: str, prefix: Prefix) -> bool:
        """Whether a participant is known to know our reader of replies: its writer has spoken to it."""
        return any(
            guid[:12] == prefix and proxy.beats >= 0
            for ours in self._ours_by_topic.get(replies, {}).values()
            if ours.reader is not None
            for guid, proxy in ours.reader.proxies.items()
        )

    def _introduced(self, reader: ReliableReader, prefix: Prefix, now: float) -> None:
        ours = self._ours.get(reader.guid)
        asking = {} if ours is None else self._asking.get(ours.description.topic, {})
        for writer in (endpoint.writer for endpoint in asking.values()):
            assert writer is not None
            for guid, proxy in writer.proxies.items():
                if guid[:12] == prefix and proxy.held_until is not None:
                    self._busy.add(writer)
                    writer.release(proxy, now)

    def _new_guid(self, kind: int) -> Guid:
        self._entities = self._entities % 0xFFFFFF + 1
        return self.prefix + self._entities.to_bytes(3, "big") + bytes((kind,))

    def _teller(self, endpoint: Endpoint) -> ReliableWriter:
        return self._tellers[(_PUBLICATIONS if endpoint.writer is not None else _SUBSCRIPTIONS)[0]]

    # What goes.

    def _announce(self) -> None:
        self._announce_to((self._group, *self._initial))

    def _announce_to(self, addresses: tuple[Address, ...]) -> None:
        payload = descriptions.write_participant(self._me)
        said = list(wire.data(wire.NOBODY, _SPDP_WRITER, 1, wire.NOTHING, payload))
        for address in addresses:
            self._post(said, address)

    def _to_reader(self, proxy: ReaderProxy, said: list[bytes]) -> None:
        self._send(proxy.guid, proxy.locators, said, wire.info_ts(self._epoch_ns()))

    def _to_writer(self, proxy: WriterProxy, said: list[bytes]) -> None:
        self._send(proxy.guid, proxy.locators, said)

    def _send(self, guid: Guid, locators: tuple[Address, ...], said: list[bytes], stamp: bytes = b"") -> None:
        front = [wire.info_dst(guid[:12]) + stamp]
        for address in locators:
            self._post(said, address, front)

    def _post(self, said: list[bytes], address: Address, front: Collection[bytes] = ()) -> None:
        """Pack submessages into as few datagrams as fit."""
        begin = self._header + b"".join(front)
        datagram = begin
        for submessage in said:
            if len(datagram) + len(submessage) > LARGEST_DATAGRAM and len(datagram) > len(begin):
                self._leave_in_outbox(datagram, address)
                datagram = begin
            datagram += submessage
        if len(datagram) > len(begin):
            self._leave_in_outbox(datagram, address)

    def _leave_in_outbox(self, datagram: bytes, address: Address) -> None:
        if len(self.outbox) >= MAX_OUTBOX:
            self.dropped.count(f"more than {MAX_OUTBOX} datagrams wait")
        else:
            self.outbox.append((datagram, address))


def _best(told: tuple[Address, ...], source: Address) -> tuple[Address, ...]:
    """The address that a participant speaks from, if it hears there; else all that it told."""
    same = tuple(address for address in told if address[0] == source[0])
    return same[:1] or told
