"""The protocol on a CAN bus, without I/O: frames, addresses, costs, and their form for people."""

from __future__ import annotations

from typing import TYPE_CHECKING

from msbot_xrce.lazy import lazy_face

if TYPE_CHECKING:
    from msbot_agent.link.can.protocol.bits import FrameBits, WireBit, busy_seconds, frame_bits, phase_bits, wire_bits
    from msbot_agent.link.can.protocol.cost import BEACONS_HZ, Cost, Framing, beacon_cost, message_cost
    from msbot_agent.link.can.protocol.decoder import FOREIGN, CanDecoder, LegacyDecoder
    from msbot_agent.link.can.protocol.frames import Frame, check_frame
    from msbot_agent.link.can.protocol.ids import NODES, CanIds, MemoryNodeIds, NodeIds, is_joining, read_beacon
    from msbot_agent.link.can.protocol.legacy_frames import DOWN, UP
    from msbot_agent.link.can.protocol.notation import (
        LogLine,
        format_frame,
        format_log_line,
        frame_sentence,
        node_of,
        parse_frame,
        parse_log_line,
        show_frame,
    )

_NAMES = {
    "msbot_agent.link.can.protocol.bits": (
        "FrameBits",
        "WireBit",
        "busy_seconds",
        "frame_bits",
        "phase_bits",
        "wire_bits",
    ),
    "msbot_agent.link.can.protocol.cost": (
        "BEACONS_HZ",
        "Cost",
        "Framing",
        "beacon_cost",
        "message_cost",
    ),
    "msbot_agent.link.can.protocol.decoder": (
        "FOREIGN",
        "CanDecoder",
        "FOREIGN",
        "LegacyDecoder",
    ),
    "msbot_agent.link.can.protocol.frames": (
        "Frame",
        "check_frame",
    ),
    "msbot_agent.link.can.protocol.ids": (
        "CanIds",
        "MemoryNodeIds",
        "NODES",
        "NodeIds",
        "is_joining",
        "read_beacon",
    ),
    "msbot_agent.link.can.protocol.legacy_frames": (
        "DOWN",
        "UP",
    ),
    "msbot_agent.link.can.protocol.notation": (
        "LogLine",
        "format_frame",
        "format_log_line",
        "frame_sentence",
        "node_of",
        "parse_frame",
        "parse_log_line",
        "show_frame",
    ),
}

__getattr__ = lazy_face(__name__, _NAMES)

__all__ = [
    "BEACONS_HZ",
    "DOWN",
    "FOREIGN",
    "NODES",
    "UP",
    "CanDecoder",
    "CanIds",
    "Cost",
    "Frame",
    "FrameBits",
    "Framing",
    "LegacyDecoder",
    "LogLine",
    "MemoryNodeIds",
    "NodeIds",
    "WireBit",
    "beacon_cost",
    "busy_seconds",
    "check_frame",
    "format_frame",
    "format_log_line",
    "frame_bits",
    "frame_sentence",
    "is_joining",
    "message_cost",
    "node_of",
    "parse_frame",
    "parse_log_line",
    "phase_bits",
    "read_beacon",
    "show_frame",
    "wire_bits",
]
