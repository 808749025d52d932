"""A participant: finds others, tells of its writers and readers, and matches them. Pure: time is what it is told.

How it works. It knows the participants that are there (`peers`); with one that goes, all it had is gone. Two reliable
writers, kept for who comes later, tell of our writers and readers, two
reliable readers hear of those of others; both are of the same kind as those of the services. Only the topics of
services are remembered. What is to be sent is left in `outbox`; whoever drives it calls `tick` when `deadline` says.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Collection, Iterator

from msbot_agent.space.contract import Guid, Qos
from msbot_agent.space.qos_matching import mismatch
from msbot_agent.space.rtps import descriptions, rtps_message_reader, rtps_messages
from msbot_agent.space.rtps.descriptions import Address, EndpointDescription, ParticipantDescription
from msbot_agent.space.rtps.peers import ANNOUNCER, GONE, LEASE_S, MAX_ENDPOINTS, ForeignEndpoints, Peers, RtpsOutbox
from msbot_agent.space.rtps.reliable_reader import ReliableReader, Take
from msbot_agent.space.rtps.reliable_writer import ReliableWriter, RtpsEndpoint, RtpsSample
from msbot_agent.space.rtps.rtps_messages import Inline, Prefix, RtpsData
from msbot_xrce.counting import Tally
from msbot_xrce.errors import RemoteProtocolError

INTRODUCTION_S = 1.0
"""The longest time that a request waits until the service's writer has been heard."""

CYCLONE = b"\x01\x10"
"""The vendor whose services read the identity in front of the body."""

_PUBLICATIONS = b"\x00\x00\x03\xc2", b"\x00\x00\x03\xc7"
_SUBSCRIPTIONS = b"\x00\x00\x04\xc2", b"\x00\x00\x04\xc7"
_WRITER, _READER = 0x03, 0x04
KEPT_ENDS = 1024
"""So many ends of our endpoints are told to those that missed them."""


class RtpsParticipant:
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
        self.dropped = Tally()
        """Datagrams and samples that made no sense, or for which there was no room."""
        self.changed: Callable[[], object] = lambda: None
        """Called when an endpoint of another program comes or goes."""
        self._outbox = RtpsOutbox(prefix, self.dropped, epoch_ns)
        self.outbox = self._outbox.datagrams
        """What is to be sent, with the addresses; who sends it clears it."""
        self._strangers = frozenset(strangers)
        me = ParticipantDescription(prefix, rtps_messages.VENDOR, addresses, addresses, LEASE_S, name)
        self._peers = Peers(me, (group, *peers), self._outbox, self.dropped, now)
        self._others = ForeignEndpoints()
        self._ours: dict[Guid, RtpsEndpoint] = {}
        self._ours_by_topic: dict[str, dict[Guid, RtpsEndpoint]] = {}
        self._entities = 0
        self._asking: dict[str, dict[Guid, RtpsEndpoint]] = {}
        """Writers of requests by the topic of their replies."""
        self._ends: dict[ReliableWriter, deque[int]] = {}
        self._busy: set[ReliableWriter | ReliableReader] = set()
        """Those that may wait for a time."""
        self._has_left = False
        self._tellers: dict[bytes, ReliableWriter] = {}
        self._hearers: dict[bytes, ReliableReader] = {}
        for writer, reader in (_PUBLICATIONS, _SUBSCRIPTIONS):
            self._tellers[writer] = ReliableWriter(prefix + writer, self._outbox.to_reader, depth=0, durable=True)
            self._hearers[reader] = ReliableReader(prefix + reader, self._outbox.to_writer, self._discovered)
            self._ends[self._tellers[writer]] = deque()
        self._now = now

    # Endpoints of ours.

    def open_writer(
        self, topic: str, type_name: str, qos: Qos, user_data: bytes = b"", *, replies: str = ""
    ) -> RtpsEndpoint:
        """Make a writer; `replies` is the topic of what answers its requests."""
        guid = self._new_guid(_WRITER)
        endpoint = RtpsEndpoint(EndpointDescription(guid, topic, type_name, qos, (), user_data), replies=replies)
        endpoint.writer = ReliableWriter(guid, self._outbox.to_reader, depth=qos.depth)
        if replies:
            self._asking.setdefault(replies, {})[guid] = endpoint
        self._open(endpoint)
        return endpoint

    def open_reader(self, topic: str, type_name: str, qos: Qos, take: Take, user_data: bytes = b"") -> RtpsEndpoint:
        """Make a reader."""
        guid = self._new_guid(_READER)
        endpoint = RtpsEndpoint(EndpointDescription(guid, topic, type_name, qos, (), user_data))
        endpoint.reader = ReliableReader(guid, self._outbox.to_writer, take)
        self._open(endpoint)
        return endpoint

    def close_endpoint(self, endpoint: RtpsEndpoint, now: float) -> None:
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
        teller.write(teller.last + 1, RtpsSample(key, Inline(None, GONE, endpoint.guid)), now)
        self._busy.add(teller)
        ends = self._ends[teller]
        ends.append(teller.last)
        if len(ends) > KEPT_ENDS:
            teller.forget(ends.popleft())

    def write(self, endpoint: RtpsEndpoint, number: int, change: RtpsSample, now: float) -> None:
        """Send a sample."""
        self._now = now
        assert endpoint.writer is not None
        endpoint.writer.write(number, change, now)
        self._busy.add(endpoint.writer)

    def leave(self) -> None:
        """Tell everybody that it is gone; it hears and does nothing more."""
        self._has_left = True
        self._peers.leave()

    # Others.

    def vendor(self, guid: Guid) -> bytes:
        """Who made the program that an endpoint elsewhere belongs to."""
        peer = self._peers.get(guid[:12])
        return bytes(2) if peer is None else peer.vendor

    def knows(self, guid: Guid) -> bool:
        """Whether the participant of that endpoint is there."""
        return guid[:12] in self._peers

    def on_topic(self, topic: str) -> Iterator[EndpointDescription]:
        """The endpoints of others on a topic."""
        return self._others.on_topic(topic)

    @property
    def peers(self) -> int:
        """Number of participants known now."""
        return len(self._peers)

    @property
    def known(self) -> int:
        """Number of endpoints of others that are remembered."""
        return len(self._others)

    # Driving.

    def receive(self, datagram: bytes, source: Address, now: float) -> None:
        """A datagram has come."""
        if self._has_left:
            return
        self._now = now
        try:
            sender, found = rtps_message_reader.read(datagram)
            if sender == self.prefix or sender in self._strangers:
                return
            for behalf, target, submessage in found:
                if target in (self.prefix, rtps_messages.ANYBODY):
                    self._hear(behalf, submessage, source, now)
        except RemoteProtocolError as error:
            self.dropped.count(str(error))

    def deadline(self) -> float:
        """When `tick` has something to do."""
        if self._has_left:
            return math.inf
        found = self._peers.deadline()
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
        for prefix in self._peers.tick(now):
            self._lose(prefix)
        for state in tuple(self._busy):
            state.tick(now)

    # What comes.

    def _hear(self, sender: Prefix, said: rtps_messages.Submessage, source: Address, now: float) -> None:
        if isinstance(said, RtpsData) and said.writer == ANNOUNCER:
            self._hear_participant(sender, said, source, now)
            return
        if sender not in self._peers:
            return
        if isinstance(said, rtps_messages.AckNack | rtps_messages.NackFrag):
            writer = self._writer(said.writer)
            if writer is not None:
                self._busy.add(writer)
            if writer is not None and isinstance(said, rtps_messages.AckNack):
                writer.handle_acknack(sender + said.reader, said, now)
            elif writer is not None and isinstance(said, rtps_messages.NackFrag):
                writer.heard_fragments(sender + said.reader, said)
            return
        guid = sender + said.writer
        for reader in self._readers(said.reader, guid):
            self._busy.add(reader)
            if isinstance(said, RtpsData):
                reader.heard_data(guid, said, now)
            elif isinstance(said, rtps_messages.RtpsHeartbeat):
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
        if entity != rtps_messages.NOBODY:
            named = self._hearers.get(entity)
            if named is None:
                endpoint = self._ours.get(self.prefix + entity)
                named = None if endpoint is None else endpoint.reader
            return [] if named is None else [named]
        for told, hearing in (_PUBLICATIONS, _SUBSCRIPTIONS):
            if writer[12:] == told:
                return [self._hearers[hearing]]
        known = self._others.get(writer)
        namesakes = {} if known is None else self._ours_by_topic.get(known.topic, {})
        return [one.reader for one in namesakes.values() if one.reader is not None and writer in one.reader.proxies]

    def _hear_participant(self, sender: Prefix, data: RtpsData, source: Address, now: float) -> None:
        if data.inline.status or data.is_key:
            self._lose(sender)
            return
        peer = self._peers.handle_announcement(sender, data, source, now)
        if peer is None:
            return
        for (writer, reader), teller in zip((_PUBLICATIONS, _SUBSCRIPTIONS), self._tellers.values(), strict=True):
            teller.match(sender + reader, peer.meta, now)
            self._hearers[reader].match(sender + writer, peer.meta, now)
        self._busy.update(self._tellers.values(), self._hearers.values())

    def _lose(self, prefix: Prefix) -> None:
        if not self._peers.remove(prefix):
            return
        for writer, reader in (_PUBLICATIONS, _SUBSCRIPTIONS):
            self._tellers[writer].unmatch(prefix + reader)
            self._hearers[reader].unmatch(prefix + writer)
        for guid in self._others.of(prefix):
            self._forget(guid)

    def _discovered(self, writer: Guid, data: RtpsData) -> None:
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
        if not self._others.add(told):
            self.dropped.count(f"more than {MAX_ENDPOINTS} endpoints")
            return
        for ours in tuple(self._ours_by_topic.get(told.topic, {}).values()):
            self._match(ours, told)
        self.changed()

    def _forget(self, guid: Guid) -> None:
        told = self._others.remove(guid)
        if told is None:
            return
        for ours in self._ours_by_topic.get(told.topic, {}).values():
            if ours.writer is not None:
                ours.writer.unmatch(guid)
            elif ours.reader is not None:
                ours.reader.unmatch(guid)
        self.changed()

    # Matching.

    def _open(self, endpoint: RtpsEndpoint) -> None:
        told = endpoint.description
        self._ours[endpoint.guid] = endpoint
        self._ours_by_topic.setdefault(told.topic, {})[endpoint.guid] = endpoint
        teller = self._teller(endpoint)
        endpoint.number = teller.last + 1
        teller.write(endpoint.number, RtpsSample(descriptions.write_endpoint(told), rtps_messages.NOTHING), self._now)
        self._busy.add(teller)
        for other in tuple(self.on_topic(told.topic)):
            self._match(endpoint, other)

    def _match(self, ours: RtpsEndpoint, other: EndpointDescription) -> None:
        mine = ours.description
        writes = ours.writer is not None
        if descriptions.is_writer(other.guid) is writes or other.type_name != mine.type_name:
            return
        offered, asked = (mine.qos, other.qos) if writes else (other.qos, mine.qos)
        if mismatch(offered, asked) is not None:
            return
        peer = self._peers.get(other.guid[:12])
        if peer is None:
            return
        self._busy.add(ours.state)
        if ours.writer is not None:
            held = None
            if ours.replies and not self._is_introduced(ours.replies, other.guid[:12]):
                held = self._now + INTRODUCTION_S
            ours.writer.match(
                other.guid,
                peer.default,
                self._now,
                plain=peer.vendor == CYCLONE,
                reliable=other.qos.reliable,
                held_until=held,
            )
        elif ours.reader is not None:
            ours.reader.match(other.guid, peer.default, self._now, reliable=other.qos.reliable)

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

    def _teller(self, endpoint: RtpsEndpoint) -> ReliableWriter:
        return self._tellers[(_PUBLICATIONS if endpoint.writer is not None else _SUBSCRIPTIONS)[0]]
