"""A table of the fields of all messages, for explanation, quiz and dissector.

It lists the fields at fixed places; what follows them (the properties of a login, the description of an object, a
sample) is one field `rest`, which `explain` puts into words. Names are those of the submessages' attributes. Where a
submessage ends is left to `located_submessages`.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from typing import Final

from msbot_xrce.counting import amount
from msbot_xrce.errors import RemoteProtocolError
from msbot_xrce.lazy import dataclass
from msbot_xrce.messages.ids import (
    SESSION_NONE,
    Format,
    ObjectKind,
    Status,
    SubmessageId,
)
from msbot_xrce.messages.message import decode_header, located_submessages
from msbot_xrce.messages.objects import REPLACE, REUSE
from msbot_xrce.messages.streams import LAST_FRAGMENT
from msbot_xrce.messages.submessage import HEADER_SIZE, LITTLE_ENDIAN


class Form(Enum):
    """How the octets of a field are to be read."""

    NUMBER = "number"
    """In the byte order that the submessage's flags say."""
    LITTLE = "little"
    """Always little endian."""
    BIG = "big"
    """Octets in their order, as a number: keys and ids, which are never swapped."""
    OCTETS = "octets"
    """No number."""
    TEXT = "text"
    """One octet with the length, then UTF-8."""


@dataclass(frozen=True, slots=True)
class LaidField:
    """One field at a fixed place."""

    name: str
    size: int
    """In octets; 0: all that is left of the submessage."""
    form: Form
    words: Mapping[int, str] | None = None
    """What some values mean."""
    is_hexadecimal: bool = False


STATUS_WORDS: Final = {int(status): status.name for status in Status}
KIND_WORDS: Final = {int(kind): kind.name for kind in ObjectKind}
FORMAT_WORDS: Final = {int(form): form.name for form in Format}
SUBMESSAGE_WORDS: Final = {int(one): one.name for one in SubmessageId}

_REST: Final = LaidField("rest", 0, Form.OCTETS)
_PAYLOAD: Final = LaidField("payload", 0, Form.OCTETS)
_REQUEST: Final = LaidField("request_id", 2, Form.BIG)
_OBJECT: Final = LaidField("object_id", 2, Form.BIG, is_hexadecimal=True)
_STREAM: Final = LaidField("stream_id", 1, Form.BIG, is_hexadecimal=True)
_STATUS: Final = LaidField("status", 1, Form.BIG, STATUS_WORDS, is_hexadecimal=True)
_IMPLEMENTATION: Final = LaidField("implementation_status", 1, Form.BIG)
_LOGIN: Final = (
    LaidField("cookie", 4, Form.OCTETS),
    LaidField("version", 2, Form.OCTETS),
    LaidField("vendor", 2, Form.OCTETS),
)
_KEY: Final = LaidField("client_key", 4, Form.BIG, is_hexadecimal=True)
_SESSION: Final = LaidField("session_id", 1, Form.BIG, is_hexadecimal=True)

HEADER: Final = (_SESSION, _STREAM, LaidField("sequence_nr", 2, Form.LITTLE))
"""The first fields of a message."""
HEADER_KEY: Final = _KEY
"""Follows them where the session id is below 0x80."""
SUBMESSAGE: Final = (
    LaidField("submessage_id", 1, Form.BIG, SUBMESSAGE_WORDS, is_hexadecimal=True),
    LaidField("flags", 1, Form.BIG, is_hexadecimal=True),
    LaidField("length", 2, Form.LITTLE),
)
"""In front of every submessage."""
FLAGS: Final = (
    ("little_endian", LITTLE_ENDIAN, None),
    ("reuse", REUSE, SubmessageId.CREATE),
    ("replace", REPLACE, SubmessageId.CREATE),
    ("last", LAST_FRAGMENT, SubmessageId.FRAGMENT),
)
"""`(name, bit, submessage)`; None: of all submessages."""
BODIES: Final[Mapping[SubmessageId, tuple[LaidField, ...]]] = {
    SubmessageId.CREATE_CLIENT: (*_LOGIN, _KEY, _SESSION, _REST),
    SubmessageId.CREATE: (_REQUEST, _OBJECT, LaidField("kind", 1, Form.BIG, KIND_WORDS),
                          LaidField("format", 1, Form.BIG, FORMAT_WORDS), _REST),
    SubmessageId.GET_INFO: (_REQUEST, _OBJECT, LaidField("info_mask", 4, Form.NUMBER, is_hexadecimal=True)),
    SubmessageId.DELETE: (_REQUEST, _OBJECT),
    SubmessageId.STATUS_AGENT: (_STATUS, _IMPLEMENTATION, *_LOGIN, _REST),
    SubmessageId.STATUS: (_REQUEST, _OBJECT, _STATUS, _IMPLEMENTATION),
    SubmessageId.INFO: (_REQUEST, _OBJECT, _STATUS, _IMPLEMENTATION, _REST),
    SubmessageId.WRITE_DATA: (_REQUEST, _OBJECT, _PAYLOAD),
    SubmessageId.READ_DATA: (_REQUEST, _OBJECT, _STREAM, LaidField("data_format", 1, Form.BIG), _REST),
    SubmessageId.DATA: (_REQUEST, _OBJECT, _PAYLOAD),
    SubmessageId.ACKNACK: (LaidField("first_unacked", 2, Form.NUMBER),
                           LaidField("bitmap", 2, Form.BIG, is_hexadecimal=True), _STREAM),
    SubmessageId.HEARTBEAT: (LaidField("first", 2, Form.NUMBER), LaidField("last", 2, Form.NUMBER), _STREAM),
    SubmessageId.RESET: (),
    SubmessageId.FRAGMENT: (_PAYLOAD,),
    SubmessageId.TIMESTAMP: (LaidField("seconds", 4, Form.NUMBER), LaidField("nanoseconds", 4, Form.NUMBER)),
    SubmessageId.TIMESTAMP_REPLY: (
        LaidField("transmit_seconds", 4, Form.NUMBER), LaidField("transmit_nanoseconds", 4, Form.NUMBER),
        LaidField("receive_seconds", 4, Form.NUMBER), LaidField("receive_nanoseconds", 4, Form.NUMBER),
        LaidField("originate_seconds", 4, Form.NUMBER), LaidField("originate_nanoseconds", 4, Form.NUMBER),
    ),
}  # fmt: skip
"""The fields of each submessage, after its header."""


@dataclass(frozen=True, slots=True)
class Envelope:
    """Messages of another protocol that travel beside those of DDS-XRCE, and may carry one of them."""

    name: str
    mark: bytes
    """How each begins; no message of DDS-XRCE does."""
    kinds: Mapping[int, tuple[str, tuple[LaidField, ...]]]
    """By the octet after the mark: name and fields."""
    carriers: frozenset[int]
    """The kinds whose fields a message of DDS-XRCE follows."""


@dataclass(frozen=True, slots=True)
class FoundField:
    """A field in the octets of a message."""

    part: str
    """`header`, or the submessage it belongs to: `WRITE_DATA`."""
    name: str
    start: int
    octets: bytes
    value: int | None
    """None: it is no number."""
    words: str
    """The value for people: `0x0015`, `OK`."""


def read_fields(packet: bytes) -> tuple[list[FoundField], str]:
    """The fields of a message in their order, and what is wrong with the rest; empty: nothing."""
    found: list[FoundField] = []
    try:
        header = decode_header(packet)
    except RemoteProtocolError as error:
        return found, str(error)
    fields = (*HEADER, HEADER_KEY) if header.session_id < SESSION_NONE else HEADER
    _read(found, "header", fields, packet, start=0, end=header.size, little=True)
    start = header.size + HEADER_SIZE
    try:
        for _, end in located_submessages(packet, header.size):
            _submessage(found, packet, start, min(end, len(packet)))
            start = (end + 7) & ~3
    except RemoteProtocolError as error:
        return found, str(error)
    return found, ""


def _submessage(found: list[FoundField], packet: bytes, start: int, end: int) -> None:
    kind, flags = packet[start - HEADER_SIZE], packet[start - HEADER_SIZE + 1]
    known = kind in SUBMESSAGE_WORDS
    part = SUBMESSAGE_WORDS[kind] if known else f"0x{kind:02X}"
    _read(found, part, SUBMESSAGE, packet, start=start - HEADER_SIZE, end=start, little=True)
    body = BODIES[SubmessageId(kind)] if known else (_REST,)
    _read(found, part, body, packet, start=start, end=end, little=bool(flags & LITTLE_ENDIAN))


def _read(
    found: list[FoundField],
    part: str,
    fields: tuple[LaidField, ...],
    packet: bytes,
    *,
    start: int,
    end: int,
    little: bool,
) -> None:
    for field in fields:
        size = field.size or end - start
        if size <= 0 or start + size > end:
            return
        octets = packet[start : start + size]
        found.append(FoundField(part, field.name, start, octets, *_value(field, octets, little=little)))
        start += size


def _value(field: LaidField, octets: bytes, *, little: bool) -> tuple[int | None, str]:
    if field.form is Form.OCTETS:
        return None, amount(len(octets), "byte")
    is_little = field.form is Form.LITTLE or (field.form is Form.NUMBER and little)
    value = int.from_bytes(octets, "little" if is_little else "big")
    words = f"0x{value:0{2 * len(octets)}X}" if field.is_hexadecimal else str(value)
    meaning = (field.words or {}).get(value)
    return value, words if meaning is None else f"{words} {meaning}"
