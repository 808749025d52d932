"""Why a claim got no lease: the reason codes of plug-and-play, and their words."""

from __future__ import annotations

from enum import IntEnum
from struct import Struct
from typing import Annotated

from msbot.part.messages.message import Message
from msbot.part.messages.wire_types import Octets, uint8, uint32
from msbot_xrce.errors import RemoteProtocolError


class Refusal(IntEnum):
    """Why a claim got no lease; the numbers are the reason codes on the wire."""

    UNKNOWN_PART = 1
    BLOCKED = 2
    DUPLICATE = 3
    NO_SLOT = 4
    WRONG_ROBOT = 5
    BAD_CLAIM = 6
    NOT_READY = 7
    WRONG_KEY = 8
    KEY_NEEDED = 9
    NO_KEY = 10
    REPLAYED = 11

    @property
    def words(self) -> str:
        """The reason in plain words, without naming the part; the same at the part and at the master."""
        return _REFUSALS[self]


STANDBY = "standby"
"""What the master calls a part that was refused because no slot is free: it waits, and takes over when one is."""


def displayed_state(state: str, reason: str) -> str:
    """How a part calls its state when it tells people: refused with that reason, it may be a spare that waits."""
    return STANDBY if state == "refused" and reason == Refusal.NO_SLOT.words else state


_REFUSALS = {
    Refusal.UNKNOWN_PART: "this part number is not in the library",
    Refusal.BLOCKED: "this part is blocked",
    Refusal.DUPLICATE: "another part with the same UID is active",
    Refusal.NO_SLOT: "every fitting slot is taken, or it is not clear which one is meant",
    Refusal.WRONG_ROBOT: "this robot has no slot for this part number",
    Refusal.BAD_CLAIM: "the claim makes no sense",
    Refusal.NOT_READY: "the inventory cannot read its registry",
    Refusal.WRONG_KEY: "the part's key is not the one on file for its UID",
    Refusal.KEY_NEEDED: "this robot asks for keys, and the part proves none",
    Refusal.NO_KEY: "this robot asks for keys, and has none for this part",
    Refusal.REPLAYED: "an old proof was shown again, or one that nobody asked for",
}


# What a part says is wrong with its hardware before it ends: a sentence in pieces.
#
# The length of a request says what it is, so no text of any length can travel at once.


TROUBLE_PIECE_OCTETS = 17
"""A length that no other request has, with a seal or without."""
TROUBLE_OCTETS = 12
TROUBLE_PIECES = 15
"""Most pieces of one text: they fit into the window of a reliable stream."""
TROUBLE_ENDS = 0x80


class TroublePiece(Message):
    """A part says what is wrong with its hardware before it ends: pieces of a text, in order; not answered."""

    lease: uint32
    place: uint8
    """Counted from 0; the last piece has bit 7 set."""
    text: Annotated[bytes, Octets(TROUBLE_OCTETS)]
    """UTF-8; NUL fills up the last one."""


def trouble_pieces(lease: int, sentence: str) -> list[TroublePiece]:
    """A sentence in pieces; what is too long is cut off."""
    text = sentence.encode()[: TROUBLE_PIECES * TROUBLE_OCTETS]
    pieces = [text[at : at + TROUBLE_OCTETS].ljust(TROUBLE_OCTETS, b"\0") for at in range(0, len(text), TROUBLE_OCTETS)]
    last = len(pieces) - 1
    return [
        TroublePiece(lease=lease, place=place | (TROUBLE_ENDS if place == last else 0), text=piece)
        for place, piece in enumerate(pieces)
    ]


# How a part finds out that it has found the master of the thesis' own programs.
#
# That master publishes the same profile as one of MsBOT, but knows neither leases nor configurations: on a service of
# its own it answers every request of 96 octets with the part number in it, and gives nobody a place (thesis 3.12.2). So
# a part whose claims nobody answers asks there, too, to be able to say what it has found. It asks as the thesis' parts
# do, with a mark in the octets that they leave free, so that an inventory of MsBOT, which serves those parts as well,
# drops it.


BUFFER_BYTES = 96

SERVICE = "service_name"
REQUEST_TYPE = "request_type"
REPLY_TYPE = "reply_type"

DOES_NOT_JOIN = (
    "this is the master of the thesis' own programs, which gives no part a place or a configuration: a part of MsBOT "
    "does not join it; run `msbot master` in its place, which serves the thesis' parts, too"
)

_MARK = b"?MsBOT"
_LENGTH = Struct("<I")


def probe_request(part_number: str, local_name: str) -> bytes | None:
    """The request; None if the names are too long for a request of the thesis."""
    content = _string(part_number) + _string(local_name)
    if len(content) + len(_MARK) > BUFFER_BYTES:
        return None
    return content.ljust(BUFFER_BYTES - len(_MARK), b"\0") + _MARK


def is_probe_request(request: bytes) -> bool:
    """Whether a request in the thesis' layout is one that only asks who answers."""
    return len(request) == BUFFER_BYTES and request.endswith(_MARK)


def encode_request(part_number: str, local_name: str) -> bytes:
    """A request as the thesis' parts make it.

    Raises:
        ValueError: the two strings do not fit.
    """
    return _filled(_string(part_number) + _string(local_name))


def encode_reply(part_number: str) -> bytes:
    """The reply to it.

    Raises:
        ValueError: the part number does not fit.
    """
    return _filled(_string(part_number))


def read_string(body: bytes, offset: int) -> tuple[str, int]:
    """A string and where the next one begins.

    Raises:
        RemoteProtocolError: there is none.
    """
    if offset + 4 > len(body):
        raise RemoteProtocolError("no room for a string")
    (length,) = _LENGTH.unpack_from(body, offset)
    end = offset + 4 + length
    if length == 0 or end > len(body):
        raise RemoteProtocolError(f"string of {length} octets at offset {offset}")
    raw = body[offset + 4 : end]
    if raw[-1] != 0:
        raise RemoteProtocolError("string without its final NUL")
    try:
        text = raw[:-1].decode()
    except UnicodeDecodeError as error:
        raise RemoteProtocolError("string is not UTF-8") from error
    return text, -(-end // 4) * 4


def _string(text: str) -> bytes:
    raw = text.encode() + b"\0"
    padding = -len(raw) % 4
    return _LENGTH.pack(len(raw)) + raw + bytes(padding)


def _filled(content: bytes) -> bytes:
    if len(content) > BUFFER_BYTES:
        raise ValueError(f"{len(content)} octets do not fit into {BUFFER_BYTES}")
    return content.ljust(BUFFER_BYTES, b"\0")
