"""Links over a CAN bus, and the controllers they need."""

from __future__ import annotations

from typing import TYPE_CHECKING

from msbot_xrce.lazy import lazy_face

if TYPE_CHECKING:
    from msbot_agent.link.can.can_address import CanSettings, CanTarget, open_can_bus, parse_target
    from msbot_agent.link.can.can_link_base import CanEnd
    from msbot_agent.link.can.controller import BusState, CanBus, CanBusInfo, FrameTap
    from msbot_agent.link.can.eprosima_fd import CanFdEprosimaLink
    from msbot_agent.link.can.legacy_link import CanLegacyLink, Codec
    from msbot_agent.link.can.native_link import CanMasterLink, CanPartLink
    from msbot_agent.link.can.self_test import CheckResult, selftest

_NAMES = {
    "msbot_agent.link.can.can_address": (
        "CanSettings",
        "CanTarget",
        "open_can_bus",
        "parse_target",
    ),
    "msbot_agent.link.can.can_link_base": ("CanEnd",),
    "msbot_agent.link.can.controller": (
        "BusState",
        "CanBus",
        "CanBusInfo",
        "FrameTap",
    ),
    "msbot_agent.link.can.eprosima_fd": ("CanFdEprosimaLink",),
    "msbot_agent.link.can.legacy_link": (
        "CanLegacyLink",
        "Codec",
    ),
    "msbot_agent.link.can.native_link": (
        "CanMasterLink",
        "CanPartLink",
    ),
    "msbot_agent.link.can.self_test": (
        "CheckResult",
        "selftest",
    ),
}

__getattr__ = lazy_face(__name__, _NAMES)

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
