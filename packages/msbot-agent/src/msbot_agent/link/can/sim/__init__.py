"""The simulated CAN bus: exact to the bit, in one process or between programs."""

from msbot_agent.link.can.sim.driver import SimBusDriver, SimCanBus
from msbot_agent.link.can.sim.model.bus import SimBus
from msbot_agent.link.can.sim.names import DEFAULT_NAME, check_free, rates_words
from msbot_agent.link.can.sim.server import SimBusServer
from msbot_agent.link.can.sim.sim_address import open_sim_bus

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
