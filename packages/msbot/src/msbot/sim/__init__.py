"""Simulated parts of any library type."""

from msbot.config import Control, ControlKind
from msbot.sim.model_part import Distortion, ModelPart, message_class
from msbot.sim.part_model import fit
from msbot.sim.simulated_part import SimulatedPart, make_simulator

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
