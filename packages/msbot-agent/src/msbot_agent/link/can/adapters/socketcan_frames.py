"""CAN frames as Linux hands them over: `struct can_frame` and `struct canfd_frame` (linux/can.h)."""

from __future__ import annotations

from struct import Struct
from typing import Final

from msbot_agent.link.can.protocol.frames import Frame

CLASSIC_SIZE: Final = 16
"""Octets of a `struct can_frame` (CAN_MTU)."""
FD_SIZE: Final = 72
"""Octets of a `struct canfd_frame` (CANFD_MTU)."""

EXTENDED: Final = 0x80000000
REMOTE: Final = 0x40000000
ERROR: Final = 0x20000000
ID_MASK: Final = 0x1FFFFFFF
"""Flags in the identifier word, and what is left: 29 bits of identifier, or the classes of an error frame."""

BRS: Final = 0x01
ESI: Final = 0x02
FDF: Final = 0x04
"""Flags of a CAN FD frame; FDF is set by newer kernels and by us, older ones tell FD by the size alone."""

_CLASSIC: Final = Struct("=IBxxB8s")
_FD: Final = Struct("=IBBxx64s")
_CLASSIC_HEAD: Final = Struct("=IBxxB")
_FD_HEAD: Final = Struct("=IBB")


def pack_frame(frame: Frame) -> bytes:
    """A frame as octets for a CAN_RAW socket; `check_frame` says which frames can be sent."""
    can_id = frame.can_id | EXTENDED if frame.extended else frame.can_id
    if frame.fd:
        data = frame.data
        return _FD.pack(can_id, len(data), FDF | (BRS if frame.brs else 0) | (ESI if frame.esi else 0), data)
    if frame.remote:
        return _CLASSIC.pack(can_id | REMOTE, frame.remote_length, frame.long_dlc, b"")
    return _CLASSIC.pack(can_id | ERROR if frame.error else can_id, len(frame.data), frame.long_dlc, frame.data)


def unpack_frame(raw: bytes) -> Frame | None:
    """The frame in what one read of a CAN_RAW socket gave; None when it holds none we know (CAN XL, or cut short)."""
    size = len(raw)
    if size == CLASSIC_SIZE:
        can_id, length, dlc = _CLASSIC_HEAD.unpack_from(raw)
        if can_id <= 0x7FF and length <= 8 and not dlc:
            return Frame(can_id, raw[8 : 8 + length])
        return _unpack_rare(can_id, length, dlc if length == 8 and 9 <= dlc <= 15 else 0, raw)
    if size != FD_SIZE:
        return None
    can_id, length, flags = _FD_HEAD.unpack_from(raw)
    if length > 64 or can_id & (REMOTE | ERROR):
        return None
    extended = bool(can_id & EXTENDED)
    can_id &= ID_MASK if extended else 0x7FF
    return Frame(can_id, raw[8 : 8 + length], extended, True, bool(flags & BRS), esi=bool(flags & ESI))


def _unpack_rare(can_id: int, length: int, long_dlc: int, raw: bytes) -> Frame | None:
    if length > 8:
        return None
    if can_id & ERROR:
        return Frame(can_id & ID_MASK, raw[8 : 8 + length], error=True)
    extended = bool(can_id & EXTENDED)
    number = can_id & (ID_MASK if extended else 0x7FF)
    if can_id & REMOTE:
        return Frame(number, extended=extended, remote=True, remote_length=length, long_dlc=long_dlc)
    return Frame(number, raw[8 : 8 + length], extended, long_dlc=long_dlc)
