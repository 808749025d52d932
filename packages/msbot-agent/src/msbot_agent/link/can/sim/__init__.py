"""The simulated CAN bus: exact to the bit, in one process or between programs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from msbot_xrce.lazy import lazy_face

if TYPE_CHECKING:
    from msbot_agent.link.can.sim.bus_names import DEFAULT_NAME, check_free, rates_words
    from msbot_agent.link.can.sim.model.sim_bus import SimBus
    from msbot_agent.link.can.sim.sim_address import open_sim_bus
    from msbot_agent.link.can.sim.sim_bus_driver import SimBusDriver, SimCanBus
    from msbot_agent.link.can.sim.sim_bus_server import SimBusServer

_NAMES = {
    "msbot_agent.link.can.sim.sim_bus_driver": (
        "SimBusDriver",
        "SimCanBus",
    ),
    "msbot_agent.link.can.sim.model.sim_bus": ("SimBus",),
    "msbot_agent.link.can.sim.bus_names": (
        "DEFAULT_NAME",
        "check_free",
        "rates_words",
    ),
    "msbot_agent.link.can.sim.sim_bus_server": ("SimBusServer",),
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
