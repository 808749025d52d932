"""DDS-XRCE messages in words. Never raises."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime

from msbot_xrce.counting import amount
from msbot_xrce.errors import RemoteProtocolError
from msbot_xrce.messages.ids import (
    OBJECT_AGENT,
    OBJECT_CLIENT,
    SESSION_NONE,
    STREAM_NONE,
    STREAM_RELIABLE,
    Format,
    ObjectKind,
    kind_of,
    status_words,
)
from msbot_xrce.messages.message import (
    Acknack,
    Create,
    CreateClient,
    Data,
    Delete,
    Fragment,
    GetInfo,
    Header,
    Heartbeat,
    Info,
    ObjectVariant,
    ReadData,
    Reset,
    StatusAgent,
    StatusReply,
    Submessage,
    Timestamp,
    TimestampReply,
    WriteData,
    decode_header,
    iter_submessages,
)
from msbot_xrce.objects.definitions import (
    Definition,
    ParticipantDef,
    PublisherDef,
    ReaderDef,
    ReplierDef,
    RequesterDef,
    SubscriberDef,
    TopicDef,
    WriterDef,
)
from msbot_xrce.objects.parse import parse_variant

SHOWN_OCTETS = 16
SHOWN_TEXT = 60

_SPECIAL_OBJECTS = {OBJECT_AGENT: "the agent", OBJECT_CLIENT: "the client"}
_KIND_WORDS = {int(kind): kind.name.lower() for kind in ObjectKind}
_HEADERLESS_ANSWER = 12


def explain(packet: bytes, notes: Callable[[Header, Submessage], list[str]] | None = None) -> list[str]:
    """The message in words: one line for its header, one for each submessage, and one for what could not be read.

    Args:
        packet: the octets.
        notes: gives further lines about a submessage, from a caller who knows more; they are shown below it.
    """
    try:
        header = decode_header(packet)
    except RemoteProtocolError as error:
        return [f"not a message: {error}"]
    lines = [header_words(header)]
    try:
        for submessage in iter_submessages(packet, header.size):
            lines.append(submessage_words(submessage))
            if notes is not None:
                lines += notes(header, submessage)
    except RemoteProtocolError as error:
        if header.size == 4 and len(packet) == _HEADERLESS_ANSWER and not any(packet[6:]):
            lines.append("a C client's answer to GET_INFO, which has no submessage header")
        else:
            lines.append(f"the rest makes no sense: {error}")
    return lines


def header_words(header: Header) -> str:
    """The header: session, key, stream, number."""
    words = "no session" if header.session_id in (0, SESSION_NONE) else f"session 0x{header.session_id:02X}"
    if header.client_key is not None:
        words += f" of client {header.client_key:08X}"
    if header.stream_id == STREAM_NONE:
        return words
    return f"{words}, {_stream(header.stream_id)}, message {header.sequence_nr}"


def submessage_words(submessage: Submessage) -> str:
    """One submessage."""
    match submessage:
        case WriteData() | Data():
            verb = "WRITE_DATA to" if isinstance(submessage, WriteData) else "DATA from"
            words = f"{verb} {_object(submessage.object_id)}, request {submessage.request_id}"
            return f"{words}: {_octets(submessage.payload)}"
        case Acknack():
            return f"ACKNACK of {_stream(submessage.stream_id)}: {_acknack(submessage)}"
        case Heartbeat(first, last, stream_id):
            return f"HEARTBEAT of {_stream(stream_id)}: messages {first} to {last} are kept"
        case Fragment():
            return f"FRAGMENT{', the last' if submessage.last else ''}: {_octets(submessage.payload)}"
        case Create():
            return _create(submessage)
        case ReadData():
            return _read(submessage)
        case Delete():
            return f"DELETE {_object(submessage.object_id)}, request {submessage.request_id}"
        case StatusReply():
            words = status_words(submessage.status)
            return f"STATUS of {_object(submessage.object_id)}, request {submessage.request_id}: {words}"
    return _about_the_session(submessage)


def definition_words(definition: Definition) -> str:
    """The requested object."""
    match definition:
        case ParticipantDef():
            return f"named {_short(definition.name)!r}"
        case TopicDef():
            return f"{_short(definition.name)!r} of type {_short(definition.type_name)!r}"
        case PublisherDef() | SubscriberDef():
            return f"named {_short(definition.name)!r}" if definition.name else "without a name"
        case WriterDef() | ReaderDef():
            named = definition.topic_name
            topic = f"0x{definition.topic_id or 0:04X}" if named is None else repr(_short(named))
            words = f"topic {topic}, {'reliable' if definition.reliable else 'best effort'}"
            words += ", for late readers too" if definition.transient_local else ""
            depth = "all" if definition.keep_all else definition.depth
            return words if depth is None else f"{words}, keeps {depth}"
        case RequesterDef() | ReplierDef():
            topics = f"{_short(definition.request_topic)!r} and {_short(definition.reply_topic)!r}"
            return f"service {_short(definition.service_name)!r}, topics {topics}"


def _about_the_session(
    submessage: CreateClient | StatusAgent | GetInfo | Info | Reset | Timestamp | TimestampReply,
) -> str:
    match submessage:
        case CreateClient():
            words = f"CREATE_CLIENT {submessage.client_key:08X}: wants session 0x{submessage.session_id:02X}"
            words += f", messages of at most {submessage.mtu} bytes"
            settings = ", ".join(f"{name}={value}" for name, value in submessage.properties or ())
            return f"{words}, {_short(settings)}" if settings else words
        case StatusAgent():
            return f"STATUS_AGENT: {status_words(submessage.status)}"
        case GetInfo():
            return f"GET_INFO about {_object(submessage.object_id)}, request {submessage.request_id}"
        case Info():
            return _info(submessage)
        case Timestamp():
            return f"TIMESTAMP: {_time(submessage.transmit_ns)}"
        case TimestampReply():
            work = submessage.transmit_ns - submessage.receive_ns
            return f"TIMESTAMP_REPLY: {_time(submessage.transmit_ns)}, {work} ns after it was asked for"
        case Reset():
            return "RESET: all streams start over"


def _create(create: Create) -> str:
    variant = create.variant
    words = f"CREATE {_KIND_WORDS.get(variant.kind, f'kind {variant.kind}')} 0x{create.object_id:04X}"
    words += f", request {create.request_id}, {_description(variant, little_endian=create.little_endian)}"
    if variant.kind == ObjectKind.PARTICIPANT:
        words += f", domain {variant.domain_id}"
    elif ObjectKind.TOPIC <= variant.kind <= ObjectKind.REPLIER:
        words += f", of 0x{variant.parent_id:04X}"
    return words + (", reuse" if create.reuse else "") + (", replace" if create.replace else "")


def _description(variant: ObjectVariant, *, little_endian: bool) -> str:
    match variant.format:
        case Format.REFERENCE:
            return f"by reference {_short(variant.text or '')!r}"
        case Format.XML:
            return f"by XML {_short(variant.text or '')!r}"
        case Format.BINARY:
            try:
                return f"in binary form, {definition_words(parse_variant(variant, little_endian=little_endian))}"
            except RemoteProtocolError as error:
                return f"in a binary form that makes no sense ({error})"
    return f"in the unknown form {variant.format}"


def _read(read: ReadData) -> str:
    words = f"READ_DATA of {_object(read.object_id)}, request {read.request_id}, on {_stream(read.stream_id)}: "
    control = read.delivery
    if control is None:
        return words + "one sample"
    if control.max_samples == 0:
        return words + "stop"
    words += "without end" if control.max_samples == 0xFFFF else f"{control.max_samples} samples"
    if control.max_elapsed_s:
        words += f", for {control.max_elapsed_s} s"
    if control.max_bytes_per_second:
        words += f", {control.max_bytes_per_second} bytes a second"
    if control.min_pace_ms:
        words += f", {control.min_pace_ms} ms apart"
    return words


def _info(info: Info) -> str:
    words = f"INFO about {_object(info.object_id)}, request {info.request_id}"
    if info.availability is not None:
        words += ": takes clients" if info.availability > 0 else ": takes no clients"
        words += ", knows your session" if info.implementation_status == 1 else ", does not know you"
    for locator in info.locators:
        words += f", at {locator.describe}"
    return words


def _acknack(acknack: Acknack) -> str:
    first = acknack.first_unacked
    missing = [str((first + bit) & 0xFFFF) for bit in range(16) if acknack.bitmap >> bit & 1]
    if not missing:
        return f"all below {first} has arrived"
    return f"all below {first} has arrived, missing: {', '.join(missing)}"


def _object(object_id: int) -> str:
    special = _SPECIAL_OBJECTS.get(object_id)
    return special or f"{_KIND_WORDS.get(kind_of(object_id), 'object')} 0x{object_id:04X}"


def _stream(stream_id: int) -> str:
    if stream_id == STREAM_NONE:
        return "no stream"
    return f"{'reliable' if stream_id >= STREAM_RELIABLE else 'best-effort'} stream 0x{stream_id:02X}"


def _octets(octets: bytes) -> str:
    shown = octets[:SHOWN_OCTETS].hex(" ")
    more = " ..." if len(octets) > SHOWN_OCTETS else ""
    return f"{amount(len(octets), 'byte')} {shown}{more}".rstrip()


def _short(text: str) -> str:
    return text if len(text) <= SHOWN_TEXT else f"{text[:SHOWN_TEXT]}..."


def _time(time_ns: int) -> str:
    seconds, nanoseconds = divmod(time_ns, 1_000_000_000)
    return f"{datetime.fromtimestamp(seconds, UTC):%Y-%m-%d %H:%M:%S}.{nanoseconds:09d}"
