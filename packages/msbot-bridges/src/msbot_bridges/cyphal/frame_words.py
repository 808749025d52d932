"""What a Cyphal frame says, for people who watch a bus: who sends which subject. Pure; needs no library."""

from __future__ import annotations

from typing import Final

from msbot_agent.link.can.protocol import Frame

_SUBJECTS: Final = {
    7168: "time.Synchronization",
    7509: "Heartbeat",
    7510: "port.List",
    8164: "pnp.cluster.Discovery",
    8165: "pnp.NodeIDAllocationData.2",
    8166: "pnp.NodeIDAllocationData.1",
    8184: "diagnostic.Record",
}
_SERVICES: Final = {
    384: "register.Access",
    385: "register.List",
    405: "file.GetInfo",
    406: "file.List",
    407: "file.Modify",
    408: "file.Read",
    409: "file.Write",
    430: "GetInfo",
    434: "GetTransportStatistics",
    435: "ExecuteCommand",
}


def words(frame: Frame) -> str:
    """What it says; empty: it is no Cyphal frame."""
    if not frame.extended or frame.remote or frame.error or not frame.data or not _is_plausible(frame.data):
        return ""
    can_id, source = frame.can_id, frame.can_id & 0x7F
    if can_id & 1 << 23:
        return ""  # reserved
    begins, part = bool(frame.data[-1] & 0x80), _part(frame.data[-1])
    if can_id & 1 << 25:
        service, to = can_id >> 14 & 0x1FF, can_id >> 7 & 0x7F
        if not begins and service not in _SERVICES:
            return ""  # by its other frames alone it could be DroneCAN
        kind = "request" if can_id & 1 << 24 else "answer"
        return f"Cyphal node {source} to node {to}: {kind} {_SERVICES.get(service, f'of service {service}')}{part}"
    if can_id & 1 << 7 or can_id >> 21 & 3 != 3:
        return ""  # reserved
    subject = can_id >> 8 & 0x1FFF
    who = "Cyphal, a node without id" if can_id & 1 << 24 else f"Cyphal node {source}"
    return f"{who}: {_SUBJECTS.get(subject, f'subject {subject}')}{part}"


def _is_plausible(data: bytes) -> bool:
    """Whether a frame of a transfer looks like this: all but the last are full, and the toggle bit begins with 1."""
    is_first, is_last, toggle = bool(data[-1] & 0x80), bool(data[-1] & 0x40), bool(data[-1] & 0x20)
    return (is_last or len(data) in (8, 64)) and (toggle or not is_first)


def _part(tail: int) -> str:
    """The last octet says where in a transfer the frame stands."""
    is_first, is_last = bool(tail & 0x80), bool(tail & 0x40)
    if is_first and is_last:
        return ""
    return ", begins" if is_first else ", ends" if is_last else ", goes on"
