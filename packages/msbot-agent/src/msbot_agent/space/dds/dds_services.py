"""Requests and replies of services in DDS, in the two manners of ROS 2.

Topics are `rq/<service>Request` and `rr/<service>Reply`. With Cyclone DDS (rmw_cyclonedds) 16 octets precede the body:
8 that identify the requester, and 8 with the number of its request; a reply repeats them. With all others (Fast DDS,
Connext, DDS-RPC) the identity of the request is beside the reply in RTPS. Cyclone DDS can neither write nor read that,
so these topics have a participant of their own here (`msbot_agent.space.rtps`), which serves both manners at once: a
request is answered in the manner in which it came, and a request of ours has for each service the form that it reads.
Other services stay in this process.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from hashlib import blake2b
from struct import Struct

from msbot_agent.space.contract import Guid, OwnEndpoint, Owner, Qos, Sample, Topic
from msbot_agent.space.dds.remote_endpoints import RemoteEndpoints, obstacle
from msbot_agent.space.memory import MAX_TROUBLES, MemoryWriter
from msbot_agent.space.readers import MemoryReader
from msbot_agent.space.rtps import rtps_messages
from msbot_agent.space.rtps.participant import CYCLONE, INTRODUCTION_S
from msbot_agent.space.rtps.reliable_writer import RtpsEndpoint, RtpsSample
from msbot_agent.space.rtps.rtps_driver import RtpsDriver
from msbot_agent.space.rtps.rtps_messages import Inline, RtpsData

HEADER_SIZE = 16
_HEADER = Struct("<8sq")
_ENCAPSULATIONS = tuple(bytes((0, 1, 0, padding)) for padding in range(4))
_READER_KINDS = (0x04, 0x07)

MAX_EARLY = 64
"""Replies of one writer that wait for the requester's reader to be discovered."""
MAX_REQUESTERS = 4096
"""Requesters of other programs whose identity in front of the body is remembered."""


def reply_topic(request_topic: str) -> str:
    """The topic on which a request is answered."""
    return f"rr/{request_topic.removeprefix('rq/').removesuffix('Request')}Reply"


def short(guid: Guid) -> bytes:
    """The 8 octets that identify one of our requesters."""
    return blake2b(guid, digest_size=8).digest()


def with_header(requester: bytes, number: int, body: bytes) -> bytes:
    """A request or reply as Cyclone DDS has it."""
    return _HEADER.pack(requester, number) + body


def split(octets: bytes) -> tuple[bytes, int, bytes] | None:
    """Requester, number and body of a request or reply of Cyclone DDS; None when it is too short."""
    if len(octets) < HEADER_SIZE:
        return None
    requester, number = _HEADER.unpack_from(octets)
    return requester, number, octets[HEADER_SIZE:]


def encapsulated(body: bytes) -> bytes:
    """A body of CDR as the payload of a sample."""
    padding = -len(body) & 3
    return _ENCAPSULATIONS[padding] + body + bytes(padding)


def body_of(payload: bytes) -> bytes | None:
    """The body of CDR; None where it is not little endian CDR."""
    if len(payload) < 4 or payload[:2] != b"\x00\x01":
        return None
    return payload[4 : len(payload) - (payload[3] & 3)]


class Requesters:
    """Who asks, in one domain."""

    def __init__(self) -> None:
        self.by_short: dict[bytes, Guid] = {}
        """Ours, by the 8 octets in front of the body."""
        self.by_guid: dict[Guid, Guid] = {}
        """Ours, by the GUID that others know."""
        self._headers: dict[Guid, bytes] = {}

    def met(self, writer: Guid, header: bytes) -> None:
        """A writer elsewhere identifies itself so in front of the body."""
        if writer not in self._headers and len(self._headers) >= MAX_REQUESTERS:
            del self._headers[next(iter(self._headers))]
        self._headers[writer] = header

    def header_of(self, writer: Guid) -> bytes | None:
        """How a writer elsewhere identifies itself in front of the body; None if it does not."""
        return self._headers.get(writer)


class ServiceEnd:
    """A writer or reader of requests or replies, towards other programs."""

    REFUSED = "samples of DDS peers made no sense"

    def __init__(
        self, driver: RtpsDriver, neighbours: RemoteEndpoints, requesters: Requesters, owner: Owner, domain: int
    ) -> None:
        self.endpoint: RtpsEndpoint
        self.domain = domain
        self.lost = self.refused = 0
        self._driver = driver
        self._neighbours = neighbours
        self._requesters = requesters
        self._owner = owner

    def as_endpoint(self) -> OwnEndpoint:
        """It as the peers discover it."""
        told = self.endpoint.description
        is_writer = self.endpoint.writer is not None
        return OwnEndpoint(self._owner, self.domain, told.topic, told.type_name, told.guid, is_writer)

    def troubles(self) -> list[str]:
        """Which endpoints in other programs should match it and cannot, and what was lost."""
        told = self.endpoint.description
        found: dict[str, None] = {}
        for other in self._neighbours.on_topic(told.topic):
            reason = obstacle(told.type_name, told.qos, other, writes=self.endpoint.writer is not None)
            if reason is not None:
                found[f"{told.topic}: {reason}"] = None
        if self.refused:
            found[f"{told.topic}: {self.refused} {self.REFUSED}"] = None
        lost = self.lost + (self.endpoint.writer.lost if self.endpoint.writer is not None else 0)
        if lost:
            found[f"{told.topic}: {lost} samples were lost: a DDS peer does not acknowledge in time"] = None
        return list(found)[:MAX_TROUBLES]

    @property
    def readers(self) -> int:
        """Readers of other programs that match it, if it writes."""
        return 0 if self.endpoint.writer is None else len(self.endpoint.writer.proxies)

    def close(self) -> None:
        """Leave DDS."""
        self._driver.participant.close_endpoint(self.endpoint, self._driver.now())
        self._driver.flush()

    def changed(self) -> None:
        """An endpoint of another program has come or gone."""


class RequestsOut(ServiceEnd):
    """Sends the requests of one of our requesters."""

    def __init__(self, *common: object, guid: Guid, name: str, type_name: str, qos: Qos, user_data: bytes) -> None:
        super().__init__(*common)  # type: ignore[arg-type]
        self._short, self._guid = short(guid), guid
        self.endpoint = self._driver.participant.open_writer(name, type_name, qos, user_data, replies=reply_topic(name))
        self._requesters.by_short[self._short] = guid
        self._requesters.by_guid[self.endpoint.guid] = guid
        self._driver.flush()

    def write(self, body: bytes, number: int) -> None:
        """Send a request to every service that is known."""
        plain = encapsulated(with_header(self._short, number, body))
        change = RtpsSample(encapsulated(body), rtps_messages.NOTHING, plain=plain)
        self._driver.participant.write(self.endpoint, number, change, self._driver.now())
        self._driver.flush()

    def close(self) -> None:
        """Leave DDS."""
        self._requesters.by_short.pop(self._short, None)
        self._requesters.by_guid.pop(self.endpoint.guid, None)
        super().close()


class ServiceSampleReader(ServiceEnd):
    """Takes requests or replies of other programs."""

    def __init__(
        self, *common: object, reader: MemoryReader, name: str, type_name: str, qos: Qos, user_data: bytes
    ) -> None:
        super().__init__(*common)  # type: ignore[arg-type]
        self._accept = reader.accept
        self.endpoint = self._driver.participant.open_reader(name, type_name, qos, self._take, user_data)
        self._driver.flush()

    def _take(self, writer: Guid, data: RtpsData) -> None:
        body = body_of(data.payload)
        if body is None or not self._took(writer, data, body):
            self.refused += 1

    def _took(self, writer: Guid, data: RtpsData, body: bytes) -> bool:
        """Take a sample with this body; False: it makes no sense."""
        raise NotImplementedError


class ReplyReader(ServiceSampleReader):
    """Takes the replies to requests of ours."""

    def _took(self, writer: Guid, data: RtpsData, body: bytes) -> bool:
        related = data.inline.related
        if related is not None:
            asker, number = self._requesters.by_guid.get(related[0]), related[1]
        else:
            parts = split(body)
            if parts is None:
                return False
            requester, number, body = parts
            asker = self._requesters.by_short.get(requester)
        if asker is not None:
            self._accept(Sample(body, writer, data.number, (asker, number)))
        return True


class RequestReader(ServiceSampleReader):
    """Takes the requests of other programs."""

    def _took(self, writer: Guid, data: RtpsData, body: bytes) -> bool:
        if self._driver.participant.vendor(writer) == CYCLONE:
            parts = split(body)
            if parts is None:
                return False
            requester, number, body = parts
            self._requesters.met(writer, requester)
            self._accept(Sample(body, writer, number))
        else:
            # Fast DDS says which reader awaits the reply; the reply is then to that reader, with its GUID.
            related = data.inline.related
            awaits = related is not None and related[0][15] & 0x3F in _READER_KINDS and related[0][:12] == writer[:12]
            self._accept(Sample(body, related[0] if related is not None and awaits else writer, data.number))
        return True


class RepliesOut(ServiceEnd):
    """Answers the requests of other programs, each to the program that asked.

    A reply may be ready before the requester's reader has been discovered; it waits for that, `INTRODUCTION_S` at most.
    """

    def __init__(self, *common: object, name: str, type_name: str, qos: Qos, user_data: bytes) -> None:
        super().__init__(*common)  # type: ignore[arg-type]
        self.endpoint = self._driver.participant.open_writer(name, type_name, qos, user_data)
        self._early: deque[tuple[float, bytes, tuple[Guid, int]]] = deque()
        self._number = 0
        self._driver.flush()

    def write(self, body: bytes, related: tuple[Guid, int]) -> None:
        """Answer a request."""
        if self._put(body, related):
            self._driver.flush()
        elif self._driver.participant.knows(related[0]):
            if len(self._early) >= MAX_EARLY:
                self._early.popleft()
                self.lost += 1
            self._early.append((self._driver.now() + INTRODUCTION_S, body, related))

    def changed(self) -> None:
        """Perhaps a reader is there now that replies wait for."""
        early, now = self._early, self._driver.now()
        for _ in range(len(early)):
            until, body, related = early.popleft()
            if not self._put(body, related):
                if until > now:
                    early.append((until, body, related))
                else:
                    self.lost += 1

    def _put(self, body: bytes, related: tuple[Guid, int]) -> bool:
        requester, number = related
        assert self.endpoint.writer is not None
        proxies = self.endpoint.writer.proxies
        if requester[15] & 0x3F in _READER_KINDS:
            readers = frozenset([requester] if requester in proxies else [])
        else:
            readers = frozenset(guid for guid in proxies if guid[:12] == requester[:12])
        if not readers:
            return False
        header = self._requesters.header_of(requester)
        plain = None if header is None else encapsulated(with_header(header, number, body))
        self._number += 1
        change = RtpsSample(encapsulated(body), Inline(related), readers, plain)
        self._driver.participant.write(self.endpoint, self._number, change, self._driver.now())
        return True


class ServiceWriter:
    """Satisfies `Writer`: requests or replies, for this process and for others."""

    __slots__ = ("_close", "_ends", "_memory", "guid", "topic")

    def __init__(
        self,
        memory: MemoryWriter,
        ends: tuple[RequestsOut | RepliesOut, ...],
        close: Callable[[tuple[ServiceEnd, ...]], None],
    ) -> None:
        self.guid = memory.guid
        self.topic: Topic = memory.topic
        self._memory = memory
        self._ends = ends
        self._close: Callable[[tuple[ServiceEnd, ...]], None] | None = close

    @property
    def published(self) -> int:
        """Samples written since it was made."""
        return self._memory.published

    @property
    def readers(self) -> int:
        """Who gets its requests or replies now, here and elsewhere."""
        return self._memory.readers + sum(end.readers for end in self._ends)

    def write(self, payload: bytes, related: tuple[Guid, int] | None = None) -> int:
        """Send a request, or answer one; returns its sequence number."""
        number = self._memory.write(payload, related)
        for end in self._ends:
            if isinstance(end, RequestsOut):
                end.write(payload, number)
            elif related is not None:
                end.write(payload, related)
        return number

    def troubles(self) -> tuple[str, ...]:
        """Which readers should hear it and cannot, here and elsewhere."""
        return (*self._memory.troubles(), *(words for end in self._ends for words in end.troubles()))

    def close(self) -> None:
        """Leave the space. Closing twice does nothing."""
        if self._close is not None:
            self._close(self._ends)
            self._close = None
            self._memory.close()


class ServiceReader:
    """Satisfies `Reader`: requests or replies, from this process and from others."""

    __slots__ = ("_close", "_ends", "_memory", "topic")

    def __init__(
        self,
        memory: MemoryReader,
        ends: tuple[RequestReader | ReplyReader, ...],
        close: Callable[[tuple[ServiceEnd, ...]], None],
    ) -> None:
        self.topic: Topic = memory.topic
        self._memory = memory
        self._ends = ends
        self._close: Callable[[tuple[ServiceEnd, ...]], None] | None = close

    @property
    def delivered(self) -> int:
        """Samples taken since it was made."""
        return self._memory.delivered

    @property
    def lost(self) -> int:
        """Samples pushed out of the history before they were taken."""
        return self._memory.lost

    def take(self) -> Sample | None:
        """The oldest sample not yet taken, or None."""
        return self._memory.take()

    def troubles(self) -> tuple[str, ...]:
        """Which writers should be heard and cannot, here and elsewhere."""
        return (*self._memory.troubles(), *(words for end in self._ends for words in end.troubles()))

    def close(self) -> None:
        """Leave the space. Closing twice does nothing."""
        if self._close is not None:
            self._close(self._ends)
            self._close = None
            self._memory.close()
