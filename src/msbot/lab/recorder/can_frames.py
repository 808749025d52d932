"""How a CAN frame is recorded."""

from __future__ import annotations

from struct import Struct
from typing import Final

FRAME: Final = Struct("<IBBBBBBBBI")
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
