"""Plug-and-play: which part may join, holds which slot, is alive, and may use which topic."""

from __future__ import annotations

from typing import TYPE_CHECKING

from msbot_xrce.lazy import lazy_face

if TYPE_CHECKING:
    from msbot.part.join.refusal import Refusal
    from msbot.pnp.emergency_stop import StopConfirmation, StopRecord, StopStatus
    from msbot.pnp.explain_samples import (
        KNOWN_TYPES,
        FrameListener,
        FrameWords,
        KnownObject,
        SessionListener,
        came_in_32_bits,
        message_words,
        value_words,
    )
    from msbot.pnp.inventory import Inventory
    from msbot.pnp.inventory_record import runs_in_words, versions_in_words
    from msbot.pnp.inventory_service import InventoryService
    from msbot.pnp.key_proof import Keys
    from msbot.pnp.life_status import TRANSITIONS
    from msbot.pnp.load_forecast import Flow, Forecast, forecast
    from msbot.pnp.master_service import MasterService
    from msbot.pnp.model import (
        FAST_TIMING,
        THESIS_TIMING,
        Claim,
        Configuration,
        LifeTiming,
        MemoryStore,
        PartInfo,
        PartStore,
        SelfDescription,
        SessionStatus,
        SlotBinding,
        Verdict,
    )
    from msbot.pnp.part_events import Evidence, PartEvent, PartState
    from msbot.pnp.profile import PROFILE_PERIOD_S, PROFILE_TOPIC, PROFILE_TYPE, Profile
    from msbot.pnp.pupils import Freeze, Group, Pupils, TakeOverByTeacher
    from msbot.pnp.robot_gate import RESERVED_TOPICS, RobotGate
    from msbot.pnp.slot_assignment import TakeOver
    from msbot.pnp.slot_matching import Match, Matcher
    from msbot.pnp.state_changes import HandControl, HeldPort

_NAMES = {
    "msbot.part.join.refusal": ("Refusal",),
    "msbot.pnp.robot_gate": (
        "RobotGate",
        "RESERVED_TOPICS",
    ),
    "msbot.pnp.emergency_stop": (
        "StopConfirmation",
        "StopRecord",
        "StopStatus",
    ),
    "msbot.pnp.explain_samples": (
        "FrameListener",
        "FrameWords",
        "KNOWN_TYPES",
        "KnownObject",
        "SessionListener",
        "came_in_32_bits",
        "message_words",
        "value_words",
    ),
    "msbot.pnp.state_changes": (
        "HandControl",
        "HeldPort",
    ),
    "msbot.pnp.inventory": ("Inventory",),
    "msbot.pnp.inventory_record": ("runs_in_words", "versions_in_words"),
    "msbot.pnp.key_proof": ("Keys",),
    "msbot.pnp.life_status": ("TRANSITIONS",),
    "msbot.pnp.load_forecast": (
        "Flow",
        "Forecast",
        "forecast",
    ),
    "msbot.pnp.model": (
        "Claim",
        "Configuration",
        "FAST_TIMING",
        "LifeTiming",
        "MemoryStore",
        "PartInfo",
        "PartStore",
        "SelfDescription",
        "SlotBinding",
        "SessionStatus",
        "THESIS_TIMING",
        "Verdict",
    ),
    "msbot.pnp.part_events": (
        "Evidence",
        "PartEvent",
        "PartState",
    ),
    "msbot.pnp.master_service": ("MasterService",),
    "msbot.pnp.profile": (
        "PROFILE_PERIOD_S",
        "PROFILE_TOPIC",
        "PROFILE_TYPE",
        "Profile",
    ),
    "msbot.pnp.pupils": (
        "Freeze",
        "Group",
        "Pupils",
        "TakeOverByTeacher",
    ),
    "msbot.pnp.inventory_service": ("InventoryService",),
    "msbot.pnp.slot_assignment": ("TakeOver",),
    "msbot.pnp.slot_matching": (
        "Match",
        "Matcher",
    ),
}

__getattr__ = lazy_face(__name__, _NAMES)

__all__ = [
    "FAST_TIMING",
    "KNOWN_TYPES",
    "PROFILE_PERIOD_S",
    "PROFILE_TOPIC",
    "PROFILE_TYPE",
    "RESERVED_TOPICS",
    "THESIS_TIMING",
    "TRANSITIONS",
    "Claim",
    "Configuration",
    "Evidence",
    "Flow",
    "Forecast",
    "FrameListener",
    "FrameWords",
    "Freeze",
    "Group",
    "HandControl",
    "HeldPort",
    "Inventory",
    "InventoryService",
    "Keys",
    "KnownObject",
    "LifeTiming",
    "MasterService",
    "Match",
    "Matcher",
    "MemoryStore",
    "PartEvent",
    "PartInfo",
    "PartState",
    "PartStore",
    "Profile",
    "Pupils",
    "Refusal",
    "RobotGate",
    "SelfDescription",
    "SessionListener",
    "SessionStatus",
    "SlotBinding",
    "StopConfirmation",
    "StopRecord",
    "StopStatus",
    "TakeOver",
    "TakeOverByTeacher",
    "Verdict",
    "came_in_32_bits",
    "forecast",
    "message_words",
    "runs_in_words",
    "value_words",
    "versions_in_words",
]
