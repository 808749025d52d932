"""What a part says is wrong with its hardware before it ends: a sentence in pieces.

The length of a request says what it is, so no text of any length can travel at once.
"""

from __future__ import annotations

from typing import Annotated

from msbot.part.messages.message import Message
from msbot.part.messages.wire_types import Octets, uint8, uint32

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
