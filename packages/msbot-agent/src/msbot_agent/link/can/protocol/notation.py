"""CAN frames as text: the notation of can-utils, the lines of a candump log, and what candump shows on a terminal.

::

    123#DEADBEEF             standard frame, identifier 3 hexadecimal digits; dots between bytes are allowed
    1ABCDEF0#11.22           extended frame, 8 digits 123#R4                   remote frame that asks for 4 bytes
    123#0011223344556677_F   data length code 15 (9 to 15 mean 8 bytes in a classic frame); also 123#R8_F 123##1DEADBEEF
    CAN FD; digit of flags: 1 = bit-rate switch (BRS), 2 = error state indicator (ESI) 20000004#0008000000000000
    report of the controller about a bus error

    (1700000000.123456) can0 123#DEADBEEF                    a line of `candump -l`
     (1700000000.123456)  can0  123   [4]  DE AD BE EF       the same as `candump` shows it; with [04] it is CAN FD;
                                                             {F} is 8 bytes with the data length code 15 (candump -8)
"""

from __future__ import annotations

import re
from datetime import datetime
from typing import Final

from msbot_agent.link.can.protocol.frames import Frame, check_frame, pad_fd
from msbot_agent.link.can.protocol.ids import (
    NOBODY,
    NODES,
    CanIds,
    read_assign,
    read_beacon,
    read_join,
    read_question,
    read_stop,
)
from msbot_agent.text.sentence import Sentence, said
from msbot_xrce.errors import ConfigError, LocalProtocolError
from msbot_xrce.lazy import dataclass

PADDING: Final = b"\xcc"
"""Padding for CAN FD data of a length that no frame has (zeros would cost stuff bits)."""

HOW: Final = (
    "write 123#DEADBEEF, with 8 digits before the # for an extended frame (0000007F#01), 123#R4 for a remote frame, "
    "123##1DEADBEEF for CAN FD (1 = bit-rate switch, 2 = ESI, 3 = both, 0 = neither)"
)
"""The notation in one sentence."""

_LONGEST_SHOWN = 100
"""Of a line that is none, in characters."""
_ERROR_REPORT = 0x20000000
_FLAGS = 7
"""BRS, ESI, and 4, with which newer programs mark the frame as CAN FD once more."""

_FRAME = re.compile(
    r"([0-9A-F]+)#(?:(#)([0-9A-F])|(R)([0-9A-F]?)(?=$|_))?((?:\.?[0-9A-F]{2})*)\.?(?:_([9A-F]))?", re.IGNORECASE
)
_TIME = r"\((\d+(?:\.\d+)?|\d{4}-\d\d-\d\d \d\d:\d\d:\d\d(?:\.\d{1,9})?)\)"
_LOG = re.compile(_TIME + r"\s+(\S+)\s+(\S+#\S*)(?:\s+[RT])?")
_SHOWN = re.compile(
    rf"(?:{_TIME}\s+)?(\S+)\s+(?:[RT]X\s+([B-])\s+([E-])\s+)?([0-9A-F]{{3}}|[0-9A-F]{{8}})\s+"
    r"(?:\[(\d{1,2})\]|\{([9A-F])\})\s*((?:[0-9A-F]{2}(?:\s+|$))*|remote request)(?:'.*'|ERRORFRAME)?\s*"
)


@dataclass(frozen=True, slots=True)
class LogLine:
    """One frame of a log."""

    at: float | None
    """Seconds, since 1970 or whatever the log counts from; None = the log does not say."""
    channel: str
    """The bus, for example `can0`."""
    frame: Frame


def parse_frame(text: str) -> Frame:
    """The frame that the notation of can-utils describes; CAN FD data is padded with 0xCC to the next valid length.

    Raises:
        ConfigError: it does not describe one; the text says what would be right.
    """
    match = _FRAME.fullmatch(text)
    if match is None or len(match[1]) not in (3, 8):
        raise ConfigError(f"{text!r} is no CAN frame: {HOW}")
    digits, double, flags, remote, length, octets, code = match.groups()
    long_dlc = int(code or "0", 16)
    can_id, extended = int(digits, 16), len(digits) == 8
    error = extended and can_id >> 29 == _ERROR_REPORT >> 29
    if remote:
        asked = int(length or "0", 16)
        return _checked(text, Frame(can_id, extended=extended, remote=True, remote_length=asked, long_dlc=long_dlc))
    if double and int(flags, 16) > _FLAGS:
        raise ConfigError(f"{text!r}: the flags of a CAN FD frame are 1 = bit-rate switch and 2 = ESI, not {flags}")
    data = bytes.fromhex(octets.replace(".", ""))
    if not double:
        if error:
            return Frame(can_id & ~_ERROR_REPORT, data, extended=False, error=True)
        return _checked(text, Frame(can_id, data, extended, long_dlc=long_dlc))
    if len(data) > 64:
        raise ConfigError(f"{text!r}: a CAN FD frame carries at most 64 bytes, not {len(data)}")
    bits = int(flags, 16)
    data = pad_fd(data, PADDING)
    return _checked(text, Frame(can_id, data, extended, True, bool(bits & 1), esi=bool(bits & 2), long_dlc=long_dlc))


def format_frame(frame: Frame) -> str:
    """The frame in the notation of can-utils."""
    if frame.error:
        return f"{frame.can_id | _ERROR_REPORT:08X}#{frame.data.hex().upper()}"
    digits = f"{frame.can_id:08X}" if frame.extended else f"{frame.can_id:03X}"
    code = f"_{frame.long_dlc:X}" if frame.long_dlc else ""
    if frame.remote:
        return f"{digits}#R{frame.remote_length or ''}{code}"
    flags = f"#{frame.brs | frame.esi << 1}" if frame.fd else ""
    return f"{digits}#{flags}{frame.data.hex().upper()}{code}"


def parse_log_line(line: str) -> LogLine:
    """A line of a candump log, or one that candump shows on a terminal.

    Raises:
        ConfigError: it is neither; the text says what would be right.
    """
    line = line.strip()
    if match := _LOG.fullmatch(line):
        return LogLine(_seconds(line, match[1]), match[2], parse_frame(match[3]))
    if match := _SHOWN.fullmatch(line):
        return LogLine(_seconds(line, match[1]) if match[1] else None, match[2], _read_columns(line, match))
    shown = line if len(line) <= _LONGEST_SHOWN else f"{line[:_LONGEST_SHOWN]}..."
    raise ConfigError(f"{shown!r} is not a line of candump, such as (1700000000.123456) can0 123#DEADBEEF")


def _seconds(line: str, time: str) -> float:
    """The time of a line; one with a date (`candump -tA`) is that of this computer's zone, as candump prints it."""
    if "-" not in time:
        return float(time)
    try:
        return datetime.fromisoformat(time).timestamp()
    except (ValueError, OverflowError, OSError) as error:
        raise ConfigError(f"{line!r} has no possible time: {error}") from None


def format_log_line(line: LogLine) -> str:
    """A line as `candump -l` writes it."""
    return f"({line.at or 0:017.6f}) {line.channel} {format_frame(line.frame)}"


def show_frame(frame: Frame) -> str:
    """Identifier, length and data in columns, as candump shows them on a terminal."""
    can_id = frame.can_id | _ERROR_REPORT if frame.error else frame.can_id
    digits = f"{can_id:08X}" if frame.extended or frame.error else f"     {can_id:03X}"
    length = frame.remote_length if frame.remote else len(frame.data)
    brackets = f"[{length:02}]" if frame.fd else f" {{{frame.long_dlc:X}}}" if frame.long_dlc else f" [{length}]"
    return f"{digits}  {brackets}  {'remote request' if frame.remote else frame.data.hex(' ').upper()}".rstrip()


def _read_columns(line: str, match: re.Match[str]) -> Frame:
    brs, esi, digits, length, code, content = match.groups()[2:]
    suffix = f"_{code}" if code else ""
    length = length or "8"
    if content == "remote request":
        return parse_frame(f"{digits}#R{length}{suffix}")
    data = bytes.fromhex("".join(content.split()))  # a log may have spaces that are none of ASCII
    if len(data) != int(length):
        raise ConfigError(f"{line!r} says it has {int(length)} data bytes and shows {len(data)}")
    flags = f"#{(brs == 'B') | (esi == 'E') << 1}" if len(length) == 2 else ""
    return parse_frame(f"{digits}#{flags}{data.hex()}{suffix}")


def _checked(text: str, frame: Frame) -> Frame:
    try:
        check_frame(frame)
    except LocalProtocolError as error:
        hint = ""
        if not frame.extended and frame.can_id > 0x7FF:
            hint = f"; with 8 digits, {frame.can_id:08X}, the frame is an extended one"
        elif len(frame.data) > 8:
            hint = "; CAN FD is written with two #, as in 123##1DEADBEEF"
        raise ConfigError(f"{text!r}: {error}{hint}") from None
    return frame


# What the frames around addresses, STOP and faults say, in sentences for everybody. Pure.


def node_of(frame: Frame, ids: CanIds) -> tuple[int, bool] | None:
    """The node whose message a frame is a piece of, and whether it goes to the master; None: it is no such piece."""
    if frame.extended or frame.error or frame.remote:
        return None
    for base, up in ((ids.up, True), (ids.down, False)):
        if 0 < frame.can_id - base <= NODES:
            return frame.can_id - base, up
    return None


def frame_sentence(frame: Frame, ids: CanIds) -> Sentence:
    """What a frame says that is no piece of a message between a part and the master."""
    if frame.error:
        return said("the bus reports a fault")
    if read_stop(frame, ids) is not None:
        return said("STOP: every part goes to its safe state")
    if read_join(frame, ids):
        return said("a part asks for an address")
    if assign := read_assign(frame, ids):
        if assign.uid == NOBODY:
            return said("node {node} must ask for an address again", node=assign.node_id)
        if assign.node_id == 0:
            return said("the master has no address left for a part")
        return said("the master makes a part node {node}", node=assign.node_id)
    if read_beacon(frame, ids):
        return said("the master says that it is there")
    if read_question(frame, ids) is not None:
        return said("a master starts and asks whether there is another one")
    return said("something else that uses this bus")
