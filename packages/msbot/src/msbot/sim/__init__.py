"""Simulated parts of any library type, for robots without hardware: `msbot part`, the web page, classes, tests."""

from msbot.config import Control, ControlKind
from msbot.sim.model_part import Distortion, ModelPart, message_class
from msbot.sim.simulated_part import SimulatedPart, make_simulator
from msbot.sim.simulated_world import fit

__all__ = [
    "Control",
    "ControlKind",
    "Distortion",
    "ModelPart",
    "SimulatedPart",
    "fit",
    "make_simulator",
    "message_class",
]
