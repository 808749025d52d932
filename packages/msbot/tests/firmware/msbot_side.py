"""All that the firmware's tests need of MsBOT itself."""

from __future__ import annotations

from zlib import crc32

from msbot.config import Blueprint, Library, SlotPort, load_blueprint, load_library
from msbot.master import Master
from msbot.part import Part
from msbot.part.join.part_keys import prove
from msbot.part.join.pnp_messages import ProfileMessage
from msbot.part.messages.standard import Switch
from msbot.process.virtual_time import run_virtual
from msbot.registry import Registry, RobotRecord, open_registry
from msbot_agent.link.can import CanMasterLink, CanPartLink, Codec
from msbot_agent.link.can.protocol.frames import (
    EMPTY_FRAME,
    EMPTY_MESSAGE,
    FRAME_LOST,
    MESSAGE_LOST,
    NO_FIRST_FRAME,
    REPEATED,
    TOO_LONG,
    TOO_SLOW,
    UNFINISHED,
    WRONG_CHECK_BYTE,
    WRONG_LENGTH,
    Frame,
    FrameJoiner,
    split,
)
from msbot_agent.link.can.protocol.ids import (
    CAN_FD,
    COMPRESSION,
    Assign,
    Beacon,
    CanIds,
    assign_frame,
    beacon_frame,
    stop_frame,
)
from msbot_agent.link.can.protocol.join_part import AddressLost, ComponentEvent, ComponentJoin, ComponentState, Joined
from msbot_agent.link.can.sim import SimBus, SimBusDriver
from msbot_agent.link.can.sim.sim_bus_driver import SimCanBus
from msbot_xrce import compression as compact
from msbot_xrce.compression import DICTIONARY
from msbot_xrce.counting import Tally
from msbot_xrce.errors import MsbotError, RemoteProtocolError
from tests.agent.replay import VECTORS, load

__all__ = [
    "CAN_FD",
    "COMPRESSION",
    "DICTIONARY",
    "DROP_REASONS",
    "AddressLost",
    "Assign",
    "Beacon",
    "Blueprint",
    "CanIds",
    "CanMasterLink",
    "CanPartLink",
    "Codec",
    "ComponentEvent",
    "ComponentJoin",
    "ComponentState",
    "Frame",
    "FrameJoiner",
    "Joined",
    "Library",
    "Master",
    "MsbotError",
    "Part",
    "ProfileMessage",
    "Registry",
    "RemoteProtocolError",
    "RobotRecord",
    "SimBus",
    "SimBusDriver",
    "SimCanBus",
    "SlotPort",
    "Switch",
    "Tally",
    "assign_frame",
    "beacon_frame",
    "compact",
    "crc32",
    "load_blueprint",
    "load_library",
    "open_registry",
    "prove",
    "recorded_packets",
    "run_virtual",
    "split",
    "stop_frame",
]

DROP_REASONS = (
    EMPTY_FRAME,
    FRAME_LOST,
    MESSAGE_LOST,
    NO_FIRST_FRAME,
    UNFINISHED,
    WRONG_CHECK_BYTE,
    TOO_LONG,
    TOO_SLOW,
    WRONG_LENGTH,
    EMPTY_MESSAGE,
    REPEATED,
)
"""In the order of the firmware's MSBOT_DROP_...; behind them one for what compression cannot read."""


def recorded_packets() -> list[bytes]:
    """All packets of the dialogues between genuine peers."""
    names = [path.stem for path in sorted(VECTORS.glob("*.jsonl"))]
    return sorted({line.packet for name in names for line in load(name)})
