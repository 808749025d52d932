"""What a CANopen frame says, for people who watch a bus: by the predefined connection set of CiA 301. Pure."""

from __future__ import annotations

from typing import Final

from msbot_agent.link.can.protocol import Frame
from msbot_bridges.canopen.emergency_words import emergency_words, is_reset

_COMMANDS: Final = {
    1: "start",
    2: "stop",
    128: "enter PRE-OPERATIONAL",
    129: "reset node",
    130: "reset communication",
}
_STATES: Final = {0: "boot-up", 4: "STOPPED", 5: "OPERATIONAL", 127: "PRE-OPERATIONAL"}
_SERVICES: Final = {
    0x180: "TPDO 1 of",
    0x200: "RPDO 1 to",
    0x280: "TPDO 2 of",
    0x300: "RPDO 2 to",
    0x380: "TPDO 3 of",
    0x400: "RPDO 3 to",
    0x480: "TPDO 4 of",
    0x500: "RPDO 4 to",
    0x580: "SDO answer of",
    0x600: "SDO request to",
}
_LSS: Final = {0x7E4: "answer", 0x7E5: "request"}
_LSS_COMMANDS: Final = {
    0x04: "switch state",
    0x11: "node id",
    0x13: "bit timing",
    0x15: "activate bit timing",
    0x17: "store",
    0x4F: "it is me",
    0x51: "fastscan",
    0x5E: "which node id",
}
_SDO: Final = {0x20: "writes", 0x40: "reads", 0x60: "has written", 0x80: "abort", 0xC0: "block"}


def words(frame: Frame) -> str:
    """What it says; empty: it is no CANopen frame."""
    if frame.extended or frame.fd or frame.error:
        return ""
    service, node, data = frame.can_id & 0x780, frame.can_id & 0x7F, frame.data
    if frame.can_id == 0:
        if len(data) != 2:
            return ""
        whom = f"node {data[1]}" if data[1] else "all nodes"
        return f"CANopen NMT: {_COMMANDS.get(data[0], f'command {data[0]}')}, {whom}"
    if frame.can_id == 0x080:
        return "CANopen SYNC"
    if frame.can_id == 0x100:
        return "CANopen TIME"
    if frame.can_id in _LSS and len(data) == 8:
        return f"CANopen LSS {_LSS[frame.can_id]}: {_LSS_COMMANDS.get(data[0], f'command {data[0]}')}"
    if node == 0:
        return ""
    if service == 0x080 and len(data) == 8:
        code = int.from_bytes(data[:2], "little")
        return f"CANopen node {node}: " + ("error reset" if is_reset(code) else emergency_words(code, data[2]))
    if service == 0x700:
        if frame.remote:
            return f"CANopen: node {node} is asked for its state"
        if len(data) == 1:
            state = data[0] & 0x7F
            return f"CANopen heartbeat of node {node}: {_STATES.get(state, f'state {state}')}"
        return ""
    if service not in _SERVICES:
        return ""
    said = f"CANopen {_SERVICES[service]} node {node}"
    return said + _sdo(data, is_answer=service == 0x580) if service in (0x580, 0x600) and len(data) == 8 else said


def _sdo(data: bytes, *, is_answer: bool) -> str:
    kind, index = data[0] & 0xE0, int.from_bytes(data[1:3], "little")
    if kind == 0x00 or (is_answer and kind == 0x20 and not index):
        return ", a segment"
    verb = "has read" if is_answer and kind == 0x40 else _SDO.get(kind, "a segment")
    code = f" (0x{int.from_bytes(data[4:], 'little'):08X})" if kind == 0x80 else ""
    return f": {verb} 0x{index:04X}:{data[3]:02X}{code}"
