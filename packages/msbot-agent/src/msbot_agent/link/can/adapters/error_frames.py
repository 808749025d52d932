"""What a controller reports about its bus, in words (error frames of SocketCAN, linux/can/error.h).

An error frame is not a frame of the bus: its identifier word holds the classes of what happened, its 8 data octets the
details, octets 6 and 7 the error counters (ISO 11898-1:2015 12.1.4) where the driver gives them.
"""

from __future__ import annotations

from struct import Struct
from typing import Final

from msbot_agent.link.can.controller import BusState
from msbot_agent.link.can.protocol.frames import Frame
from msbot_xrce.lazy import dataclass

TX_TIMEOUT: Final = 0x001
LOST_ARBITRATION: Final = 0x002
CONTROLLER: Final = 0x004
PROTOCOL: Final = 0x008
TRANSCEIVER: Final = 0x010
NO_ACK: Final = 0x020
BUS_OFF: Final = 0x040
BUS_ERROR: Final = 0x080
RESTARTED: Final = 0x100
COUNTERS: Final = 0x200

RX_OVERFLOW: Final = 0x01
TX_OVERFLOW: Final = 0x02
WARNING: Final = 0x04 | 0x08
PASSIVE: Final = 0x10 | 0x20
ACTIVE: Final = 0x40

BACK_WORDS: Final = "back on the bus"
STATE_WORDS: Final = {
    BusState.ACTIVE: "all is well again",
    BusState.PASSIVE: "many frames go wrong: check that another node is on the bus, the wiring, "
    "the two terminators of 120 ohms, and that all bit rates are the same",
    BusState.OFF: "the controller has left the bus after too many errors: look for a short circuit, "
    "a wrong bit rate or two nodes with one identifier",
    BusState.GONE: "the adapter has gone: plug it in again",
}
WARNING_WORDS: Final = (
    "error-warning: some frames go wrong, check the wiring, the terminators and the bit rates before it gets worse"
)

LOST_ARBITRATION_WORDS: Final = "arbitration lost"
NO_ACK_WORDS: Final = "nobody acknowledges: no other node is on the bus, or at another bit rate"
RX_OVERFLOW_WORDS: Final = "the controller lost frames that came in too quickly"
TX_OVERFLOW_WORDS: Final = "the controller lost frames that were to be sent"
TX_TIMEOUT_WORDS: Final = "the controller could not send for a long time"
BUS_ERROR_WORDS: Final = "bus error"

_PROTOCOL: Final = (
    (0x01, "bit error"),
    (0x02, "form error"),
    (0x04, "stuff error"),
    (0x08, "dominant bit not seen on the bus: wire broken or transceiver off"),
    (0x10, "recessive bit not seen on the bus: short circuit or two nodes with one identifier"),
    (0x20, "overload frame"),
)
_PLACES: Final = {
    0x02: "identifier", 0x06: "identifier", 0x07: "identifier", 0x0F: "identifier", 0x0E: "identifier",
    0x03: "start of frame", 0x04: "SRR bit", 0x05: "IDE bit", 0x0C: "RTR bit", 0x0D: "reserved bit",
    0x09: "reserved bit", 0x0B: "length", 0x0A: "data", 0x08: "check sum", 0x18: "check sum delimiter",
    0x19: "acknowledgement", 0x1B: "acknowledgement delimiter", 0x1A: "end of frame", 0x12: "intermission",
}  # fmt: skip
_CAN_H: Final = {
    0x4: "no wire",
    0x5: "short circuit to the battery",
    0x6: "short circuit to the supply",
    0x7: "short circuit to ground",
}


@dataclass(frozen=True, slots=True)
class BusReport:
    """The meaning of an error frame."""

    state: BusState | None
    """The state the controller is in now; None = unchanged."""
    words: str
    """The state and its remedy if `state` is given, or a warning; empty if the frame only reports single events."""
    events: tuple[str, ...]
    """Single events in words, for counting."""
    transmit_errors: int | None = None
    receive_errors: int | None = None
    """Error counters of the controller, 0 to 255; None when the driver does not report them."""


def read_report(classes: int, data: bytes) -> BusReport:
    """The meaning of an error frame.

    Args:
        classes: its identifier word without the flag of error frames.
        data: its data octets; missing ones count as 0.
    """
    data = data.ljust(8, b"\0")
    state, words = _state(classes, data[1])
    counters = data[6:8] if classes & COUNTERS or any(data[6:8]) else None
    if counters is None:
        return BusReport(state, words, tuple(_events(classes, data)))
    return BusReport(state, words, tuple(_events(classes, data)), counters[0], counters[1])


def _state(classes: int, controller: int) -> tuple[BusState | None, str]:
    if classes & BUS_OFF:
        return BusState.OFF, STATE_WORDS[BusState.OFF]
    if classes & RESTARTED:
        return BusState.ACTIVE, BACK_WORDS
    if classes & CONTROLLER:
        if controller & PASSIVE:
            return BusState.PASSIVE, STATE_WORDS[BusState.PASSIVE]
        if controller & WARNING:
            return BusState.ACTIVE, WARNING_WORDS
        if controller & ACTIVE:
            return BusState.ACTIVE, STATE_WORDS[BusState.ACTIVE]
    return None, ""


def _events(classes: int, data: bytes) -> list[str]:
    events = []
    if classes & TX_TIMEOUT:
        events.append(TX_TIMEOUT_WORDS)
    if classes & LOST_ARBITRATION:
        events.append(LOST_ARBITRATION_WORDS)
    if classes & CONTROLLER:
        if data[1] & RX_OVERFLOW:
            events.append(RX_OVERFLOW_WORDS)
        if data[1] & TX_OVERFLOW:
            events.append(TX_OVERFLOW_WORDS)
    if classes & NO_ACK:
        events.append(NO_ACK_WORDS)
    if classes & PROTOCOL:
        place = _PLACES.get(data[3])
        kinds = [words for bit, words in _PROTOCOL if data[2] & bit] or [BUS_ERROR_WORDS]
        events += [f"{words} in the {place}" if place else words for words in kinds]
    elif classes & BUS_ERROR and not classes & NO_ACK:
        events.append(BUS_ERROR_WORDS)
    if classes & TRANSCEIVER:
        events += _wires(data[4])
    return events


def _wires(status: int) -> list[str]:
    wires = (("CAN high", status & 0x0F), ("CAN low", status >> 4 & 0x07))
    events = [f"{wire}: {_CAN_H[code]}" for wire, code in wires if code in _CAN_H]
    if status & 0x80:
        events.append("CAN low: short circuit to CAN high")
    return events or ["the transceiver reports an error"]


# CAN frames as Linux hands them over: `struct can_frame` and `struct canfd_frame` (linux/can.h).


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
