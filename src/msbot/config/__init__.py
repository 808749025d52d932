"""The files people write: the blueprint of a robot (`robot.toml`) and the part library."""

from msbot.config.blueprint import Blueprint, load_blueprint
from msbot.config.check import RESERVED_TOPICS
from msbot.config.library import (
    Direction,
    Library,
    Parameter,
    ParameterKind,
    PartType,
    Port,
    load_library,
    scalar_text,
)
from msbot.config.plan import PRESETS, Binding, Endpoint, Options, RobotProfile, Slot, Timing
from msbot.config.reader import Scalar
from msbot.config.sample import SAMPLE_ROBOT_TOML, write_sample

__all__ = [
    "PRESETS",
    "RESERVED_TOPICS",
    "SAMPLE_ROBOT_TOML",
    "Binding",
    "Blueprint",
    "Direction",
    "Endpoint",
    "Library",
    "Options",
    "Parameter",
    "ParameterKind",
    "PartType",
    "Port",
    "RobotProfile",
    "Scalar",
    "Slot",
    "Timing",
    "load_blueprint",
    "load_library",
    "scalar_text",
    "write_sample",
]
