"""Understands what parts and their agent say to each other: `explain`, with the messages on the topics in words.

Which topic a writer or a reader belongs to, and which service a requester, stands in the CREATEs at the beginning of
a session; who listens from then on knows what the octets of each sample are. Pure; never raises, whatever is said.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable
from typing import Final

from msbot.errors import RemoteProtocolError
from msbot.part import INVENTORY_SERVICE, HelloWorld, Message, ProfileMessage, decode_reply, decode_request
from msbot.pnp import compat
from msbot.xrce import (
    SESSION_NONE,
    Create,
    CreateClient,
    Data,
    Definition,
    Fragment,
    Header,
    ReaderDef,
    ReplierDef,
    RequesterDef,
    Submessage,
    TopicDef,
    WriteData,
    WriterDef,
    explain,
    parse_variant,
)

KNOWN_TYPES: Final[tuple[type[Message], ...]] = (ProfileMessage, HelloWorld)
"""Message classes that are understood besides those of the inventory."""
INDENT: Final = "    "
RELATED: Final = 4
"""A reply comes to its requester behind the request id and the object id of the request."""
IDENTITY: Final = 24
"""A request comes to its replier behind the identity of its sample, and the reply goes out behind the same."""
MAX_JOINED: Final = 1 << 20
"""Octets of a message in pieces that are kept."""

_NO_HEADER: Final = bytes((SESSION_NONE, 0, 0, 0))
"""Rejoined FRAGMENTs are submessages without a header."""


class Overhearer:
    """One listener for any number of sessions, one for each peer."""

    def __init__(self, types: Iterable[type[Message]] = KNOWN_TYPES) -> None:
        """Know these message classes by their type names."""
        self._types = {cls.type_name: cls for cls in types}
        self._sessions: dict[Hashable, _Session] = {}

    def explain(self, packet: bytes, peer: Hashable, *, up: bool) -> list[str]:
        """A packet from that peer (`up`) or to it in words; a message stands below the sample that carries it."""
        session = self._sessions.get(peer)
        if session is None:
            session = self._sessions[peer] = _Session(self._types)
        return explain(packet, lambda header, submessage: session.notes(header, submessage, up=up))


class _Session:
    def __init__(self, types: dict[str, type[Message]]) -> None:
        self._types = types
        self._objects: dict[int, Definition] = {}
        self._pieces: dict[bool, _Pieces] = {True: _Pieces(), False: _Pieces()}

    def notes(self, header: Header, submessage: Submessage, *, up: bool) -> list[str]:
        """What can be said about a submessage besides what stands in it."""
        match submessage:
            case CreateClient():
                self._objects.clear()
                self._pieces = {True: _Pieces(), False: _Pieces()}
            case Create():
                self._created(submessage)
            case WriteData() | Data():
                return [INDENT + line for line in self._sample(submessage)]
            case Fragment():
                return self._fragment(header, submessage, up=up)
        return []

    def _created(self, create: Create) -> None:
        try:
            self._objects[create.object_id] = parse_variant(create.variant, little_endian=create.little_endian)
        except RemoteProtocolError:
            self._objects.pop(create.object_id, None)  # `explain` has said what is wrong with it

    def _sample(self, sample: WriteData | Data) -> list[str]:
        definition = self._objects.get(sample.object_id)
        payload = sample.payload
        match definition:
            case WriterDef() | ReaderDef():
                topic, type_name = self._topic(definition)
                cls = self._types.get(type_name)
                return [f"{topic}: {_words(payload, cls.decode)}"] if cls else [f"{topic}: a {type_name}"]
            case RequesterDef():
                if isinstance(sample, Data):
                    return _service_words(definition.service_name, "reply", payload[RELATED:])
                return _service_words(definition.service_name, "request", payload)
            case ReplierDef():
                kind = "request" if isinstance(sample, Data) else "reply"
                return _service_words(definition.service_name, kind, payload[IDENTITY:])
        return []

    def _topic(self, definition: WriterDef | ReaderDef) -> tuple[str, str]:
        if definition.topic_name is not None:
            return definition.topic_name, definition.type_name or "message"
        topic = self._objects.get(definition.topic_id or 0)
        return (topic.name, topic.type_name) if isinstance(topic, TopicDef) else ("unknown topic", "message")

    def _fragment(self, header: Header, fragment: Fragment, *, up: bool) -> list[str]:
        whole = self._pieces[up].add(fragment, header.sequence_nr)
        if whole is None:
            return []
        lines = explain(_NO_HEADER + whole, lambda _, submessage: self.notes(header, submessage, up=up))[1:]
        return [f"{INDENT}together: {line}" for line in lines]


class _Pieces:
    """The FRAGMENTs of one direction, as long as none is missing."""

    def __init__(self) -> None:
        self._joined: bytearray | None = bytearray()
        """None: a piece was missed, wait for the end of this message."""
        self._next: int | None = None

    def add(self, fragment: Fragment, sequence_nr: int) -> bytes | None:
        """Take a piece; the whole when it was the last one and none was missing."""
        ahead = 0 if self._next is None else (sequence_nr - self._next) & 0xFFFF
        if ahead >= 0x8000:
            return None  # a repetition
        if ahead:
            self._joined = None
        self._next = (sequence_nr + 1) & 0xFFFF
        if self._joined is not None:
            self._joined += fragment.payload
            if len(self._joined) > MAX_JOINED:
                self._joined = None
        if not fragment.last:
            return None
        whole = None if self._joined is None else bytes(self._joined)
        self._joined, self._next = bytearray(), None
        return whole


def _words(payload: bytes, decode: Callable[[bytes], object]) -> str:
    try:
        return str(decode(payload))
    except RemoteProtocolError as error:
        return f"makes no sense: {error}"


def _service_words(service: str, kind: str, body: bytes) -> list[str]:
    decoders: dict[tuple[str, str], Callable[[bytes], object]] = {
        (INVENTORY_SERVICE, "request"): decode_request,
        (INVENTORY_SERVICE, "reply"): decode_reply,
        (compat.SERVICE, "request"): compat.decode_request,
        (compat.SERVICE, "reply"): compat.decode_reply,
    }
    decode = decoders.get((service, kind))
    return [f"{kind} of {service}" + (f": {_words(body, decode)}" if decode is not None else "")]
