"""Plug-and-play: who may join the robot, who is in which slot, who is alive, and who may use which topic."""

from msbot.part.join.plug import Refusal
from msbot.pnp.access import RESERVED_TOPICS, Access
from msbot.pnp.emergency_stop import StopConfirmation, StopRecord, StopStatus
from msbot.pnp.explain_samples import KNOWN_TYPES, KnownObject, Overhearer
from msbot.pnp.hand_control import HandControl, HeldPort
from msbot.pnp.inventory import Inventory
from msbot.pnp.key_proof import Keys
from msbot.pnp.life import TRANSITIONS
from msbot.pnp.load_forecast import Flow, Forecast, forecast
from msbot.pnp.model import (
    FAST_TIMING,
    THESIS_TIMING,
    Claim,
    Configuration,
    Evidence,
    LifeTiming,
    MemoryStore,
    PartEvent,
    PartInfo,
    PartState,
    PartStore,
    SlotBinding,
    Standing,
    Verdict,
)
from msbot.pnp.profile import PROFILE_PERIOD_S, PROFILE_TOPIC, PROFILE_TYPE, Profile
from msbot.pnp.services import InventoryService, MasterService
from msbot.pnp.slot_assignment import TakeOver
from msbot.pnp.slot_matching import Match, Matcher

__all__ = [
    "FAST_TIMING",
    "KNOWN_TYPES",
    "PROFILE_PERIOD_S",
    "PROFILE_TOPIC",
    "PROFILE_TYPE",
    "RESERVED_TOPICS",
    "THESIS_TIMING",
    "TRANSITIONS",
    "Access",
    "Claim",
    "Configuration",
    "Evidence",
    "Flow",
    "Forecast",
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
    "Overhearer",
    "PartEvent",
    "PartInfo",
    "PartState",
    "PartStore",
    "Profile",
    "Refusal",
    "SlotBinding",
    "Standing",
    "StopConfirmation",
    "StopRecord",
    "StopStatus",
    "TakeOver",
    "Verdict",
    "forecast",
]
