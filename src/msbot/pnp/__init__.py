"""Plug-and-play: who may join the robot, who is in which slot, who is alive, and who may use which topic."""

from msbot.pnp.access import RESERVED_TOPICS, Access
from msbot.pnp.inventory import Inventory
from msbot.pnp.keys import Keys
from msbot.pnp.life import TRANSITIONS
from msbot.pnp.load_forecast import Flow, Forecast, forecast
from msbot.pnp.matching import Match, Matcher
from msbot.pnp.overhear import KNOWN_TYPES, Overhearer
from msbot.pnp.parts import (
    FAST_TIMING,
    THESIS_TIMING,
    Binding,
    Claim,
    Configuration,
    Evidence,
    MemoryStore,
    PartEvent,
    PartInfo,
    PartState,
    PartStore,
    PartType,
    Refusal,
    Slot,
    Standing,
    Timing,
    Verdict,
)
from msbot.pnp.profile import PROFILE_PERIOD_S, PROFILE_TOPIC, PROFILE_TYPE, Profile
from msbot.pnp.seating import TakeOver
from msbot.pnp.services import InventoryService, MasterService

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
    "Binding",
    "Claim",
    "Configuration",
    "Evidence",
    "Flow",
    "Forecast",
    "Inventory",
    "InventoryService",
    "Keys",
    "MasterService",
    "Match",
    "Matcher",
    "MemoryStore",
    "Overhearer",
    "PartEvent",
    "PartInfo",
    "PartState",
    "PartStore",
    "PartType",
    "Profile",
    "Refusal",
    "Slot",
    "Standing",
    "TakeOver",
    "Timing",
    "Verdict",
    "forecast",
]
