"""Links carry whole packets between this process and its peers (`contract.py`)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from msbot_xrce.lazy import lazy_face

if TYPE_CHECKING:
    from msbot_agent.link.base import BaseLink
    from msbot_agent.link.contract import (
        BacklogLink,
        ConnectionUser,
        Link,
        LinkCounters,
        LinkInfo,
        PacketHandler,
        Peer,
        PeerDirectory,
        PriorityLink,
        RoomHandler,
        Signal,
        SignalHandler,
        Tap,
        pupil_of_connection,
        user_of_connection,
    )
    from msbot_agent.link.disturbed_link import Disturbance, DisturbedLink, LossyLink, Treatment
    from msbot_agent.link.in_process import InprocEnd, InprocHub, inproc_pair
    from msbot_agent.link.link_schemes import Scheme, bound_name, link_kinds, open_link, parse_host_and_port

_NAMES = {
    "msbot_agent.link.base": ("BaseLink",),
    "msbot_agent.link.contract": (
        "BacklogLink",
        "PriorityLink",
        "PeerDirectory",
        "Link",
        "LinkCounters",
        "LinkInfo",
        "PacketHandler",
        "Peer",
        "RoomHandler",
        "Signal",
        "SignalHandler",
        "Tap",
        "ConnectionUser",
        "pupil_of_connection",
        "user_of_connection",
    ),
    "msbot_agent.link.disturbed_link": (
        "Disturbance",
        "DisturbedLink",
        "LossyLink",
        "Treatment",
    ),
    "msbot_agent.link.in_process": (
        "InprocEnd",
        "InprocHub",
        "inproc_pair",
    ),
    "msbot_agent.link.link_schemes": (
        "Scheme",
        "bound_name",
        "link_kinds",
        "open_link",
        "parse_host_and_port",
    ),
}

__getattr__ = lazy_face(__name__, _NAMES)

__all__ = [
    "BacklogLink",
    "BaseLink",
    "ConnectionUser",
    "Disturbance",
    "DisturbedLink",
    "InprocEnd",
    "InprocHub",
    "Link",
    "LinkCounters",
    "LinkInfo",
    "LossyLink",
    "PacketHandler",
    "Peer",
    "PeerDirectory",
    "PriorityLink",
    "RoomHandler",
    "Scheme",
    "Signal",
    "SignalHandler",
    "Tap",
    "Treatment",
    "bound_name",
    "inproc_pair",
    "link_kinds",
    "open_link",
    "parse_host_and_port",
    "pupil_of_connection",
    "user_of_connection",
]
