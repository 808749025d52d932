"""Simulated parts of any library type, for robots without hardware: `msbot part`, the web page, classes, tests."""

from msbot.config import Control, ControlKind
from msbot.sim.classes import message_class
from msbot.sim.simulated import SimulatedPart, make_simulator

__all__ = [
    "Control",
    "ControlKind",
    "SimulatedPart",
    "make_simulator",
    "message_class",
]
