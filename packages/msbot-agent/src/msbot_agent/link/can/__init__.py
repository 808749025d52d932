"""Links over a CAN bus, and the controllers they need."""

from msbot_agent.link.can.can_address import CanSettings, CanTarget, open_can_bus, parse_target
from msbot_agent.link.can.can_link_base import CanEnd
from msbot_agent.link.can.controller import BusState, CanBus, CanBusInfo, FrameTap
from msbot_agent.link.can.eprosima_fd import CanFdEprosimaLink
from msbot_agent.link.can.legacy_link import CanLegacyLink
from msbot_agent.link.can.native_link import CanMasterLink, CanPartLink
from msbot_agent.link.can.peer_framing import Codec
from msbot_agent.link.can.selftest import CheckResult, selftest

__all__ = [
    "BusState",
    "CanBus",
    "CanBusInfo",
    "CanEnd",
    "CanFdEprosimaLink",
    "CanLegacyLink",
    "CanMasterLink",
    "CanPartLink",
    "CanSettings",
    "CanTarget",
    "CheckResult",
    "Codec",
    "FrameTap",
    "open_can_bus",
    "parse_target",
    "selftest",
]
