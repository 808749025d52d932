"""The files people write: the blueprint of a robot (`robot.toml`) and the part library."""

from msbot.config.blueprint import Blueprint, load_blueprint
from msbot.config.check import RESERVED_TOPICS, binding_faults
from msbot.config.library import (
    Category,
    Direction,
    FieldKind,
    Library,
    MessageType,
    Parameter,
    ParameterKind,
    PartType,
    Pin,
    PinKind,
    Port,
    Supply,
    load_library,
    scalar_text,
)
from msbot.config.library_messages import standard_message_types
from msbot.config.library_simulator import Control, ControlKind, Operand, Output, Reading, Simulator
from msbot.config.library_texts import format_text
from msbot.config.library_versions import Versions, split_number
from msbot.config.plan import PRESETS, Binding, Endpoint, Options, RobotProfile, Slot, Timing
from msbot.config.reader import Scalar
from msbot.config.sample import SAMPLE_ROBOT_TOML, write_sample

__all__ = [
    "PRESETS",
    "RESERVED_TOPICS",
    "SAMPLE_ROBOT_TOML",
    "Binding",
    "Blueprint",
    "Category",
    "Control",
    "ControlKind",
    "Direction",
    "Endpoint",
    "FieldKind",
    "Library",
    "MessageType",
    "Operand",
    "Options",
    "Output",
    "Parameter",
    "ParameterKind",
    "PartType",
    "Pin",
    "PinKind",
    "Port",
    "Reading",
    "RobotProfile",
    "Scalar",
    "Simulator",
    "Slot",
    "Supply",
    "Timing",
    "Versions",
    "binding_faults",
    "format_text",
    "load_blueprint",
    "load_library",
    "scalar_text",
    "split_number",
    "standard_message_types",
    "write_sample",
]
