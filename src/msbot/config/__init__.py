"""The files people write: the blueprint of a robot (`robot.toml`) and the part library."""

from msbot.config.blueprint import Blueprint, load_blueprint, parse_blueprint
from msbot.config.check import RESERVED_TOPICS, binding_faults
from msbot.config.differences import Difference, differences
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
from msbot.config.library_versions import Versions, parse_versions, split_number
from msbot.config.plan import PRESETS, Binding, Endpoint, Options, RobotProfile, Slot, Timing
from msbot.config.problems import FoundProblems, path_words
from msbot.config.reader import Scalar
from msbot.config.sample import SAMPLE_ROBOT_TOML, SAMPLES, write_sample
from msbot.config.writer import blueprint_toml, preset_of

__all__ = [
    "PRESETS",
    "RESERVED_TOPICS",
    "SAMPLES",
    "SAMPLE_ROBOT_TOML",
    "Binding",
    "Blueprint",
    "Category",
    "Control",
    "ControlKind",
    "Difference",
    "Direction",
    "Endpoint",
    "FieldKind",
    "FoundProblems",
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
    "blueprint_toml",
    "differences",
    "format_text",
    "load_blueprint",
    "load_library",
    "parse_blueprint",
    "parse_versions",
    "path_words",
    "preset_of",
    "scalar_text",
    "split_number",
    "standard_message_types",
    "write_sample",
]
