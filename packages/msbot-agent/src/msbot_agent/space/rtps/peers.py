"""Participants elsewhere: how ours announces itself to them, and which of them are there (DDSI-RTPS 2.3 §8.5.3). Pure.

It announces itself to the group (and directly to whoever is new) until it leaves; who is not heard for its lease is
gone.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator

from msbot_agent.space.contract import Guid
from msbot_agent.space.rtps import descriptions, rtps_messages
from msbot_agent.space.rtps.descriptions import Address, EndpointDescription, ParticipantDescription
from msbot_agent.space.rtps.reliable_reader import WriterProxy
from msbot_agent.space.rtps.reliable_writer import ReaderProxy
from msbot_agent.space.rtps.rtps_messages import Inline, Prefix, RtpsData
from msbot_xrce.counting import Tally
from msbot_xrce.lazy import dataclass

# The endpoints of services in other programs, as their participants tell of them.


MAX_ENDPOINTS = 8192
"""Endpoints that are remembered."""


class ForeignEndpoints:
    """What is known of them, by GUID and by topic."""

    def __init__(self) -> None:
        self._known: dict[Guid, EndpointDescription] = {}
        self._by_topic: dict[str, dict[Guid, EndpointDescription]] = {}

    def __len__(self) -> int:
        return len(self._known)

    def get(self, guid: Guid) -> EndpointDescription | None:
        """What was told of it."""
        return self._known.get(guid)

    def on_topic(self, topic: str) -> Iterator[EndpointDescription]:
        """All on a topic."""
        return iter(self._by_topic.get(topic, {}).values())

    def of(self, prefix: Prefix) -> list[Guid]:
        """All of a participant."""
        return [guid for guid in self._known if guid[:12] == prefix]

    def add(self, told: EndpointDescription) -> bool:
        """Remember one; False when there is no room."""
        if len(self._known) >= MAX_ENDPOINTS:
            return False
        self._known[told.guid] = told
        self._by_topic.setdefault(told.topic, {})[told.guid] = told
        return True

    def remove(self, guid: Guid) -> EndpointDescription | None:
        """Forget one; what was known of it."""
        told = self._known.pop(guid, None)
        if told is not None:
            namesakes = self._by_topic[told.topic]
            del namesakes[guid]
            if not namesakes:
                del self._by_topic[told.topic]
        return told


# What a participant has to send: submessages, packed into as few datagrams as fit.


LARGEST_DATAGRAM = 1400
"""Several submessages go into one datagram up to this size."""
MAX_OUTBOX = 4096
"""Datagrams that wait; more are dropped, as the network might, and are asked for again."""


class RtpsOutbox:
    """Datagrams on their way out."""

    def __init__(self, prefix: Prefix, dropped: Tally, epoch_ns: Callable[[], int]) -> None:
        self.datagrams: list[tuple[bytes, Address]] = []
        self._dropped = dropped
        self._header = rtps_messages.header(prefix)
        self._epoch_ns = epoch_ns

    def to_reader(self, proxy: ReaderProxy, said: list[bytes]) -> None:
        """For a reader elsewhere: samples, and what is to be said of them."""
        self._send(proxy.guid, proxy.locators, said, rtps_messages.info_ts(self._epoch_ns()))

    def to_writer(self, proxy: WriterProxy, said: list[bytes]) -> None:
        """For a writer elsewhere: what is there and what is missing."""
        self._send(proxy.guid, proxy.locators, said, b"")

    def post(self, said: list[bytes], address: Address, front: Collection[bytes] = ()) -> None:
        """Pack submessages into datagrams, each with the same front."""
        begin = self._header + b"".join(front)
        datagram = begin
        for submessage in said:
            if len(datagram) + len(submessage) > LARGEST_DATAGRAM and len(datagram) > len(begin):
                self._leave(datagram, address)
                datagram = begin
            datagram += submessage
        if len(datagram) > len(begin):
            self._leave(datagram, address)

    def _send(self, guid: Guid, locators: tuple[Address, ...], said: list[bytes], stamp: bytes) -> None:
        for address in locators:
            self.post(said, address, (rtps_messages.info_dst(guid[:12]), stamp))

    def _leave(self, datagram: bytes, address: Address) -> None:
        if len(self.datagrams) >= MAX_OUTBOX:
            self._dropped.count(f"more than {MAX_OUTBOX} datagrams wait")
        else:
            self.datagrams.append((datagram, address))


LEASE_S = 20.0
ANNOUNCE_S = 4.0
FIRST_ANNOUNCEMENTS = (0.0, 0.1, 0.3, 0.8, 2.0)
"""When it announces itself at first: a datagram may be lost."""
LEASE_CHECK_S = 1.0
SHORTEST_LEASE_S = 1.0
LONGEST_LEASE_S = 300.0
MAX_PARTICIPANTS = 512
"""Participants that are remembered."""

ANNOUNCER = b"\x00\x01\x00\xc2"
"""The writer by which participants announce themselves."""
GONE = 3
"""Status of what is gone: disposed and unregistered."""


@dataclass(slots=True, eq=False)
class Peer:
    """A participant elsewhere."""

    vendor: bytes
    meta: tuple[Address, ...]
    """Where it hears discovery."""
    default: tuple[Address, ...]
    """Where it hears samples."""
    until: float


class Peers:
    """The participants that are there."""

    def __init__(
        self, me: ParticipantDescription, to: tuple[Address, ...], outbox: RtpsOutbox, dropped: Tally, now: float
    ) -> None:
        """`to`: where it announces itself."""
        self._me, self._to = me, to
        self._outbox = outbox
        self._dropped = dropped
        self._begin = self._next_announcement = now
        self._next_check = now + LEASE_CHECK_S
        self._announced = 0
        self._there: dict[Prefix, Peer] = {}

    def __len__(self) -> int:
        return len(self._there)

    def __contains__(self, prefix: object) -> bool:
        return prefix in self._there

    def get(self, prefix: Prefix) -> Peer | None:
        """One that is there."""
        return self._there.get(prefix)

    def handle_announcement(self, sender: Prefix, data: RtpsData, source: Address, now: float) -> Peer | None:
        """An announcement; the participant if it is new.

        Raises:
            RemoteProtocolError: it makes no sense.
        """
        told = descriptions.read_participant(data.payload)
        if told.prefix != sender:
            return None
        until = now + min(max(told.lease_s, SHORTEST_LEASE_S), LONGEST_LEASE_S)
        known = self._there.get(sender)
        if known is not None:
            known.until = until
            return None
        if len(self._there) >= MAX_PARTICIPANTS:
            self._dropped.count(f"more than {MAX_PARTICIPANTS} participants")
            return None
        peer = Peer(told.vendor, _best(told.meta, source), _best(told.default, source), until)
        if not peer.meta or not peer.default:
            self._dropped.count("a participant without an address of UDP over IPv4")
            return None
        self._there[sender] = peer
        self._announce(peer.meta)
        return peer

    def remove(self, prefix: Prefix) -> bool:
        """It is gone; whether it was there."""
        return self._there.pop(prefix, None) is not None

    def deadline(self) -> float:
        """When `tick` has something to do."""
        return min(self._next_announcement, self._next_check)

    def tick(self, now: float) -> list[Prefix]:
        """Announce it if that is due; who has not been heard for its lease."""
        if self._next_announcement <= now:
            self._announce(self._to)
            while (
                self._announced < len(FIRST_ANNOUNCEMENTS) and self._begin + FIRST_ANNOUNCEMENTS[self._announced] <= now
            ):
                self._announced += 1
            rest = FIRST_ANNOUNCEMENTS[self._announced :]
            self._next_announcement = self._begin + rest[0] if rest else now + ANNOUNCE_S
        if self._next_check > now:
            return []
        self._next_check = now + LEASE_CHECK_S
        return [prefix for prefix, peer in self._there.items() if peer.until <= now]

    def leave(self) -> None:
        """Tell everybody that it is gone."""
        key = descriptions.write_participant_key(self._me.prefix)
        inline = Inline(None, GONE, self._me.prefix + b"\x00\x00\x01\xc1")
        said = list(rtps_messages.data(rtps_messages.NOBODY, ANNOUNCER, 2, inline, key))
        for address in (*self._to, *(address for peer in self._there.values() for address in peer.meta)):
            self._outbox.post(said, address)

    def _announce(self, addresses: tuple[Address, ...]) -> None:
        payload = descriptions.write_participant(self._me)
        said = list(rtps_messages.data(rtps_messages.NOBODY, ANNOUNCER, 1, rtps_messages.NOTHING, payload))
        for address in addresses:
            self._outbox.post(said, address)


def _best(told: tuple[Address, ...], source: Address) -> tuple[Address, ...]:
    """The address that a participant speaks from, if it hears there; else all that it told."""
    same = tuple(address for address in told if address[0] == source[0])
    return same[:1] or told
