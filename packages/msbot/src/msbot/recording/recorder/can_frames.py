"""How a CAN frame is recorded."""

from __future__ import annotations

from struct import Struct
from typing import Final

from msbot.recording.recorder.batch import HEAD_FORMAT
from msbot_agent.link.can.protocol import Frame

FRAME: Final = Struct("<IBBBBBBBBI")
FRAME_OCTETS: Final = FRAME.size
"""Octets of a recorded frame without its data."""
PLAIN_FRAMES: Final = tuple(Struct(f"{HEAD_FORMAT}IQI{size}s").pack for size in range(9))
"""By number of octets of data: `(what the head takes ..., identifier, 0 or SENT, octets of data, data)` as the whole
record of a classic data frame with 11 bits of identifier and no flag. It has the same octets as `frame_octets` gives,
in half the time: the eight small fields between identifier and data are one number here."""
SENT: Final = 1 << 48
FRAME_TYPE: Final = "msbot_msgs/msg/CanFrame"
FRAME_DEFINITION: Final = """\
uint32 can_id
bool extended
bool fd
bool brs
bool esi
bool remote
bool error
bool sent
uint8 dlc
uint8[] data"""
"""`sent`: by the master itself. `dlc`: of a remote frame the length asked for, of a classic frame with a data length
code over 8 that code, else 0."""


def frame_octets(frame: Frame, *, is_sent: bool) -> bytes:
    """A frame as a sample of `FRAME_TYPE`."""
    data = frame.data
    fixed = FRAME.pack(
        frame.can_id, frame.extended, frame.fd, frame.brs, frame.esi, frame.remote, frame.error,
        is_sent, frame.remote_length or frame.long_dlc, len(data),
    )  # fmt: skip
    return fixed + data
