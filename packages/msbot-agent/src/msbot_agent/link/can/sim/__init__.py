"""The simulated CAN bus: exact to the bit, in one process or between programs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from msbot_xrce.lazy import lazy_face

if TYPE_CHECKING:
    from msbot_agent.link.can.sim.driver import SimBusDriver, SimCanBus
    from msbot_agent.link.can.sim.model.bus import SimBus
    from msbot_agent.link.can.sim.names import DEFAULT_NAME, check_free, rates_words
    from msbot_agent.link.can.sim.server import SimBusServer
    from msbot_agent.link.can.sim.sim_address import open_sim_bus

_NAMES = {
    "msbot_agent.link.can.sim.driver": (
        "SimBusDriver",
        "SimCanBus",
    ),
    "msbot_agent.link.can.sim.model.bus": ("SimBus",),
    "msbot_agent.link.can.sim.names": (
        "DEFAULT_NAME",
        "check_free",
        "rates_words",
    ),
    "msbot_agent.link.can.sim.server": ("SimBusServer",),
    "msbot_agent.link.can.sim.sim_address": ("open_sim_bus",),
}

__getattr__ = lazy_face(__name__, _NAMES)

__all__ = [
    "DEFAULT_NAME",
    "SimBus",
    "SimBusDriver",
    "SimBusServer",
    "SimCanBus",
    "check_free",
    "open_sim_bus",
    "rates_words",
]
