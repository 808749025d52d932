"""Explains what parts and their agent say to each other: `explain`, plus the messages on the topics in words.

The CREATEs at the beginning of a session say to which topic a writer or reader belongs, and to which service a
requester; a listener that hears them knows what the octets of each sample are. Pure; never raises, whatever it hears.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterable, Mapping
from enum import IntEnum
from functools import partial
from struct import pack, unpack
from typing import Final

from msbot.part import HelloWorld, Message
from msbot.part.calls import decode_reply
from msbot.part.join import thesis_messages
from msbot.part.join.pnp_messages import INVENTORY_SERVICE, BindingDirection, ConfigurationMessage, ProfileMessage
from msbot.part.messages.message import fields_of
from msbot.pnp.packet_words import inventory_sentence, piece_sentence, submessage_sentence
from msbot.pnp.session_seals import ObservedSeals, Read
from msbot.pnp.thesis_claims import decode_thesis_claim
from msbot.service_types import service_type
from msbot_agent.link.can.protocol import (
    DOWN,
    FOREIGN,
    UP,
    CanDecoder,
    CanIds,
    Frame,
    LegacyDecoder,
    frame_sentence,
    node_of,
)
from msbot_agent.text.sentence import Sentence, said
from msbot_xrce import decompress, explain, is_whole
from msbot_xrce.errors import CallError, RemoteProtocolError
from msbot_xrce.lazy import dataclass
from msbot_xrce.messages import (
    SESSION_NONE,
    Create,
    CreateClient,
    Data,
    Fragment,
    Header,
    ObjectKind,
    Submessage,
    WriteData,
)
from msbot_xrce.objects import Definition, ReaderDef, ReplierDef, RequesterDef, TopicDef, WriterDef, parse_variant

KNOWN_TYPES: Final[tuple[type[Message], ...]] = (ProfileMessage, HelloWorld)
"""Message classes that are understood in addition to those of the inventory."""
INDENT: Final = "    "
LARGEST_FLOAT32: Final = 3.4e38
RELATED: Final = 4
"""A reply to a requester follows the request id and the object id of the request."""
IDENTITY: Final = 24
"""A request to a replier follows the identity of its sample, and so does the reply."""
MAX_JOINED: Final = 1 << 20
"""Most octets that are kept of a message in pieces."""

_NO_HEADER: Final = bytes((SESSION_NONE, 0, 0, 0))
"""Rejoined FRAGMENTs are submessages without a header."""


@dataclass(frozen=True, slots=True)
class KnownObject:
    """What a listener that missed the beginning of a session can be told about one of its objects."""

    topic: str
    type_name: str = ""
    slot: str = ""
    """The slot that it belongs to; empty: no particular one."""
    port: str = ""


@dataclass(frozen=True, slots=True)
class PacketWords:
    """What a packet says."""

    plain: tuple[str, ...]
    """The values in it, as sentences: `knob says level 49.9 %`."""
    about: tuple[str, ...]
    """What a packet without such values is for: `knob says that it is alive`; at most one sentence."""
    protocol: tuple[str, ...]
    """Everything, in the words of the protocol."""


Know = Callable[[Hashable, int], KnownObject | None]
"""`(peer, object id)`: what the master knows of that object."""

Units = Callable[[str], Mapping[str, str]]
"""`(type name)`: units of the fields of a message type, by field."""


class SessionListener:
    """Listens to any number of sessions, one for each peer."""

    def __init__(
        self, types: Iterable[type[Message]] = KNOWN_TYPES, *, know: Know | None = None, units: Units | None = None
    ) -> None:
        """Begin to listen.

        Args:
            types: message classes to understand, by their type names.
            know: says what an object is whose CREATE was not heard.
            units: units of message fields, for sentences.
        """
        self._types = {cls.type_name: cls for cls in types}
        self._know = know or (lambda _peer, _object_id: None)
        self._units = units or (lambda _type_name: {})
        self._sessions: dict[Hashable, _Session] = {}

    @property
    def unknown(self) -> int:
        """Samples of objects that were set up before anybody listened: nobody can say what is in them."""
        return sum(session.unknown for session in self._sessions.values())

    def explain(self, packet: bytes, peer: Hashable, *, up: bool) -> list[str]:
        """Explain a packet from that peer (`up`) or to it; a message appears below the sample that carries it."""
        return list(self.explain_packet(packet, peer, up=up).protocol)

    def explain_packet(self, packet: bytes, peer: Hashable, *, up: bool) -> PacketWords:
        """What a packet says, in sentences and in the words of the protocol."""
        session = self._sessions.get(peer)
        if session is None:
            session = self._sessions[peer] = _Session(self._types, peer, partial(self._know, peer), self._units)
        session.sentences, session.about = [], []
        words = explain(packet, lambda header, submessage: session.notes(header, submessage, up=up))
        about = () if session.sentences else tuple(session.about[:1])
        return PacketWords(tuple(session.sentences), about, tuple(words))

    def part_at(self, peer: Hashable) -> str:
        """Who that peer is: its slot, if it is known."""
        session = self._sessions.get(peer)
        return nobody_in_particular(peer) if session is None else session.part


class _Session:
    def __init__(
        self, types: dict[str, type[Message]], peer: Hashable, know: Callable[[int], KnownObject | None], units: Units
    ) -> None:
        self.sentences: list[str] = []
        self.about: list[str] = []
        self.part: str = nobody_in_particular(peer)
        """Its slot, as far as it is known."""
        self._peer = peer
        self.unknown = 0
        self._types = types
        self._know = know
        self._units = units
        self._objects: dict[int, Definition] = {}
        self._configuration: ConfigurationMessage | None = None
        """What the part was told that it does in this robot, if that was heard."""
        self._pieces: dict[bool, _Pieces] = {True: _Pieces(), False: _Pieces()}
        self._seals = ObservedSeals()

    def notes(self, header: Header, submessage: Submessage, *, up: bool) -> list[str]:
        """What can be said about a submessage beyond its own contents."""
        notes = self._notes(header, submessage, up=up)
        if not self.about and (sentence := submessage_sentence(submessage, self.part, up=up)):
            self.about.append(sentence)
        return notes

    def _notes(self, header: Header, submessage: Submessage, *, up: bool) -> list[str]:
        match submessage:
            case CreateClient():
                self._objects.clear()
                self._configuration = None
                self._is_in("")
                self._seals.begin()
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
            self._objects.pop(create.object_id, None)  # `explain` has already said what is wrong with it

    def _sample(self, sample: WriteData | Data) -> list[str]:
        known = self._know(sample.object_id)
        if known is not None:
            self._is_in(known.slot)
        definition = self._objects.get(sample.object_id) or (None if known is None else _defined(sample, known))
        payload = sample.payload
        match definition:
            case WriterDef() | ReaderDef():
                topic, type_name = self._topic(definition)
                cls = self._types.get(type_name)
                hears = isinstance(sample, Data)
                known = known or self._configured(topic, hears=hears)
                if cls is None:
                    self.about.append(said("a {type}, which is not known here", type=type_name))
                    return [f"{topic}: a {type_name}"]
                return [f"{topic}: {self._read(known, payload, cls, hears=hears)}"]
            case RequesterDef():
                if isinstance(sample, Data):
                    return self._service_words(definition, "reply", payload, RELATED)
                return self._service_words(definition, "request", payload, 0)
            case ReplierDef():
                kind = "request" if isinstance(sample, Data) else "reply"
                return self._service_words(definition, kind, payload, IDENTITY)
        self.unknown += 1
        return []

    def _service_words(self, definition: RequesterDef | ReplierDef, kind: str, payload: bytes, front: int) -> list[str]:
        service, body = definition.service_name, payload[front:]
        decoders: dict[tuple[str, str], Callable[[bytes], Read[object]]] = {
            (INVENTORY_SERVICE, "request"): self._seals.request,
            (INVENTORY_SERVICE, "reply"): self._seals.reply,
            (thesis_messages.SERVICE, "request"): lambda octets: (decode_thesis_claim(octets), None),
            (thesis_messages.SERVICE, "reply"): lambda octets: (thesis_messages.decode_reply(octets), None),
        }
        decode = decoders.get((service, kind))
        if decode is None:
            return [self._call_words(definition, kind, payload, front)]
        try:
            message, seal = decode(body)
        except RemoteProtocolError as error:
            return [f"{kind} of {service}: makes no sense: {error}"]
        if isinstance(message, ConfigurationMessage):
            self._configuration = message
            self._is_in(message.slot)
        if sentence := inventory_sentence(message, self.part):
            self.about.append(sentence)
        return [f"{kind} of {service}: {_by_type_name(message)}{_seal_words(seal)}"]

    def _call_words(self, definition: RequesterDef | ReplierDef, kind: str, payload: bytes, front: int) -> str:
        """A request or reply between parts; a reply begins with its status (`msbot.part.calls`)."""
        words = f"{kind} of {definition.service_name}"
        type_name = definition.request_type if kind == "request" else definition.reply_type
        cls = self._types.get(type_name)
        if cls is None:
            if type_name:
                self.about.append(said("a {type}, which is not known here", type=type_name))
                words += f": a {type_name}"
            return words

        def decode(octets: bytes) -> Message:
            return cls.decode(decode_reply(octets[front:]) if kind == "reply" else octets[front:])

        try:
            message, seal = self._seals.sample(payload, decode)
        except CallError as error:
            return f"{words}: no reply: {error}"
        except RemoteProtocolError as error:
            return f"{words}: makes no sense: {error}"
        return f"{words}: {message}{_seal_words(seal)}"

    def _is_in(self, slot: str) -> None:
        self.part = slot or nobody_in_particular(self._peer)

    def _configured(self, topic: str, *, hears: bool) -> KnownObject | None:
        """Whose a topic is in this session, by the configuration that was heard."""
        wanted = BindingDirection.SUBSCRIBE if hears else BindingDirection.PUBLISH
        for binding in () if self._configuration is None else self._configuration.bindings:
            if binding.topic == topic and binding.direction == wanted and self._configuration is not None:
                return KnownObject(topic, binding.topic_type, self._configuration.slot, binding.port)
        return None

    def _read(self, known: KnownObject | None, payload: bytes, cls: type[Message], *, hears: bool) -> str:
        """A sample in the words of the protocol; of a known port also as a sentence."""
        try:
            message, seal = self._seals.sample(payload, cls.decode)
        except RemoteProtocolError as error:
            return f"makes no sense: {error}"
        if isinstance(message, ProfileMessage) and (sentence := inventory_sentence(message, self.part)):
            self.about.append(sentence)
        elif known is not None:
            values = message_words(message, self._units(cls.type_name))
            port = f"{known.port} " if known.port else ""
            form = "{slot} hears {port}{values}" if hears else "{slot} says {port}{values}"
            self.sentences.append(said(form, slot=known.slot or known.topic, port=port, values=values))
        return f"{message}{_seal_words(seal)}"

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
        """None: a piece was lost, wait for the end of this message."""
        self._next: int | None = None

    def add(self, fragment: Fragment, sequence_nr: int) -> bytes | None:
        """Add a piece; returns the whole message when it was the last one and none was missing."""
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


def nobody_in_particular(peer: Hashable) -> Sentence:
    """A peer whose slot is not known: a node of a CAN bus has a number."""
    return said("node {node}", node=peer) if isinstance(peer, int) and peer else said("a part")


def _defined(sample: WriteData | Data, known: KnownObject) -> Definition:
    """The definition of an object whose CREATE was not heard."""
    kind = sample.object_id & 0xF
    if kind in (ObjectKind.REQUESTER, ObjectKind.REPLIER):
        service = known.topic.removesuffix("_Request")
        make = RequesterDef if kind == ObjectKind.REQUESTER else ReplierDef
        request, reply = service_type(known.type_name) or ("", "")
        return make(service, request, reply, known.topic, "")
    # Or a writer: what is said of a sample depends on its topic alone.
    return ReaderDef(None, known.topic, known.type_name, reliable=True, transient_local=False)


MOST_SHOWN = 16
"""Elements of a list that stand in words."""


def message_words(message: Message, units: Mapping[str, str]) -> Sentence:
    """The fields of a message with their units, `x 1 m, y -2.5 m`; for a single field only its value, `49.9 %`."""
    fields = fields_of(type(message))
    forms: list[str] = []
    values: dict[str, object] = {}
    for field in fields:
        spec, values[field.name] = _shown(getattr(message, field.name))
        words = (field.name if len(fields) > 1 else "", f"{{{field.name}{spec}}}", units.get(field.name, ""))
        forms.append(" ".join(filter(None, words)))
    return Sentence(", ".join(forms), values)


def _shown(value: object) -> tuple[str, object]:
    """How to format a value, and the value itself: 49.9, not 49.900001525878906, when it came in 32 bits."""
    if isinstance(value, float):
        if not math.isfinite(value):
            return "", value
        return ":.7g" if came_in_32_bits(value) else ":.15g", value
    if isinstance(value, bool):
        return "", said("on") if value else said("off")
    if isinstance(value, list | bytes):
        more = f", ... ({len(value)} in all)" if len(value) > MOST_SHOWN else ""
        return "", f"[{', '.join(map(value_words, value[:MOST_SHOWN]))}{more}]"
    if isinstance(value, Mapping):  # a message of a recording
        return "", f"({', '.join(f'{name} {value_words(one)}' for name, one in value.items())})"
    if isinstance(value, Message):
        inside = (f"{one.name} {value_words(getattr(value, one.name))}" for one in fields_of(type(value)))
        return "", f"({', '.join(inside)})"
    if isinstance(value, IntEnum):
        return "", value.name.lower()
    return "", str(value)


def came_in_32_bits(value: float) -> bool:
    """Whether a finite number has no more digits than a 32-bit float holds."""
    return abs(value) < LARGEST_FLOAT32 and bool(unpack("<f", pack("<f", value))[0] == value)


def value_words(value: object) -> str:
    """A value in words that suit its type."""
    spec, shown = _shown(value)
    return f"{{{spec}}}".format(shown)


def _seal_words(seal: int | None) -> str:
    return "" if seal is None else f", seal {seal}"


def _by_type_name(said: object) -> str:
    """A message under its name on the wire, which is not always the name of its class."""
    return said.type_name + str(said).removeprefix(type(said).__name__) if isinstance(said, Message) else str(said)


# Says what each frame of a CAN bus means, in sentences for everybody and in the words of the protocol.
#
# For the page and for `msbot bus`, which listen to the same bus. Pure; never raises, whatever is on the bus.


@dataclass(frozen=True, slots=True)
class FrameWords:
    """What a frame says."""

    plain: tuple[str, ...]
    """The values in it, as sentences (`knob says level 49.9 %`): of a frame that completes a sample of a known part."""
    about: tuple[str, ...]
    """What a frame without such values is for, in a sentence: `knob says that it is alive`."""
    protocol: tuple[str, ...]
    """In the words of the protocol: the first line about the frame, the others about the packet it completes."""


_NOTHING = PacketWords((), (), ())


def _no_words(_: Frame) -> str:
    return ""


class FrameListener:
    """Understands the frames of one bus, one after the other."""

    def __init__(
        self,
        overhearer: SessionListener | None = None,
        *,
        ids: CanIds | None = None,
        legacy: bool = False,
        foreign: Callable[[Frame], str] = _no_words,
    ) -> None:
        """Begin to listen.

        Args:
            overhearer: what is known of the robot; None: nothing but what every robot says.
            ids: identifier bases, when the bus is shared with other equipment.
            legacy: the bus is one of the thesis' firmware.
            foreign: says what a frame of other equipment means; empty: it does not know.
        """
        self._foreign = foreign
        self._overhearer = overhearer or SessionListener()
        self._ids, self._is_legacy = ids or CanIds(), legacy
        self._heard = _NOTHING
        self._decoder = (
            LegacyDecoder(self._explain, is_whole)
            if legacy
            else CanDecoder(self._explain, decompress=decompress, ids=ids)
        )

    @property
    def unknown(self) -> int:
        """Samples whose topic was agreed upon before anybody listened."""
        return self._overhearer.unknown

    def explain_frame(self, frame: Frame, at: float) -> FrameWords:
        """What the next frame of the bus says; `at` is its time in seconds."""
        self._heard = _NOTHING
        protocol = tuple(self._decoder.decode(frame, at))
        if protocol == (FOREIGN,) and (words := self._foreign(frame)):
            return FrameWords((), (words,), (words,))
        heard = self._heard
        return FrameWords(heard.plain, heard.about or (() if heard.plain else (self._about(frame),)), protocol)

    def _explain(self, packet: bytes, peer: Hashable, *, up: bool) -> list[str]:
        self._heard = self._overhearer.explain_packet(packet, peer, up=up)
        return list(self._heard.protocol)

    def _about(self, frame: Frame) -> Sentence:
        """What a frame is for that completes no packet."""
        if self._is_legacy and not frame.extended and frame.can_id in (UP, DOWN):
            return piece_sentence(self._overhearer.part_at(0), up=frame.can_id == UP)
        node = None if self._is_legacy else node_of(frame, self._ids)
        if node is None:
            return frame_sentence(frame, self._ids)
        return piece_sentence(self._overhearer.part_at(node[0]), up=node[1])
