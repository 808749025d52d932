"""What a DroneCAN frame says, for people who watch a bus: who sends which message. Pure; needs no library."""

from __future__ import annotations

from typing import Final

from msbot_agent.link.can.protocol import Frame

_MESSAGES: Final = {
    1: "dynamic_node_id.Allocation",
    341: "NodeStatus",
    1010: "actuator.ArrayCommand",
    1011: "actuator.Status",
    1030: "esc.RawCommand",
    1031: "esc.RPMCommand",
    1034: "esc.Status",
    1050: "range_sensor.Measurement",
    1063: "gnss.Fix2",
    1092: "power.BatteryInfo",
}
_SERVICES: Final = {
    1: "GetNodeInfo",
    5: "RestartNode",
    10: "param.ExecuteOpcode",
    11: "param.GetSet",
    40: "file.BeginFirmwareUpdate",
    48: "file.Read",
}


def words(frame: Frame) -> str:
    """What it says; empty: it is no DroneCAN frame."""
    if not frame.extended or frame.remote or frame.error or not frame.data or not _is_plausible(frame.data):
        return ""
    source, part = frame.can_id & 0x7F, _part(frame.data[-1])
    if frame.can_id & 0x80:
        number, to = frame.can_id >> 16 & 0xFF, frame.can_id >> 8 & 0x7F
        if not source or not to:
            return ""  # services have two ends
        kind = "request" if frame.can_id & 0x8000 else "answer"
        return f"DroneCAN node {source} to node {to}: {kind} {_SERVICES.get(number, f'of service {number}')}{part}"
    number = frame.can_id >> 8 & 0xFFFF
    if not source:
        return f"DroneCAN, a node without id: {_MESSAGES.get(number & 3, f'message {number & 3}')}{part}"
    return f"DroneCAN node {source}: {_MESSAGES.get(number, f'message {number}')}{part}"


def _is_plausible(data: bytes) -> bool:
    """Whether a frame of a transfer looks like this: all but the last are full, and the toggle bit begins with 0."""
    is_first, is_last, toggle = bool(data[-1] & 0x80), bool(data[-1] & 0x40), bool(data[-1] & 0x20)
    return (is_last or len(data) in (8, 64)) and not (is_first and toggle)


def _part(tail: int) -> str:
    """The last octet says where in a transfer the frame stands."""
    is_first, is_last = bool(tail & 0x80), bool(tail & 0x40)
    if is_first and is_last:
        return ""
    return ", begins" if is_first else ", ends" if is_last else ", goes on"
