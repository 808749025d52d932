"""Files that people write: the blueprint (`robot.toml`) and the part library."""

from msbot.config.blueprint.blueprint_file_reader import (
    ADOPTED,
    library_folders,
    load_blueprint,
    open_blueprint,
    parse_blueprint,
)
from msbot.config.blueprint.blueprint_file_writer import blueprint_mark, blueprint_toml, preset_of, slot_toml
from msbot.config.blueprint.blueprint_model import (
    NOBODY,
    PRESETS,
    Binding,
    Blueprint,
    InDds,
    Options,
    RobotProfile,
    RosOptions,
    Slot,
    SlotPort,
    Timing,
)
from msbot.config.blueprint.check import RESERVED_TOPICS, binding_faults
from msbot.config.blueprint.class_robot import GROUP_ROBOT_TOML, for_groups, groups_by_slots
from msbot.config.blueprint.differences import Difference, compare_text, differences
from msbot.config.blueprint.samples import SAMPLE_ROBOT_TOML, SAMPLES, write_new, write_sample
from msbot.config.library.board_document import board_documents
from msbot.config.library.board_drivers import BOARD_DRIVERS
from msbot.config.library.board_wiring import WiredPart, part_number_and_name, wired_part, wired_parts
from msbot.config.library.description_reader import Described, read_description
from msbot.config.library.message_types import standard_message_types
from msbot.config.library.part_library import (
    SHIPPED,
    BusKind,
    Category,
    Direction,
    DriverPin,
    DriverSpec,
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
from msbot.config.library.simulator import DRIVES, SENSES, Control, ControlKind, Operand, Output, Reading, Simulator
from msbot.config.library.simulator_reader import format_text
from msbot.config.library.versions import VersionRange, parse_versions, split_number
from msbot_agent.toml.problems import InvalidFileError, problems_json
from msbot_agent.toml.table import Scalar

__all__ = [
    "ADOPTED",
    "BOARD_DRIVERS",
    "DRIVES",
    "GROUP_ROBOT_TOML",
    "NOBODY",
    "PRESETS",
    "RESERVED_TOPICS",
    "SAMPLES",
    "SAMPLE_ROBOT_TOML",
    "SENSES",
    "SHIPPED",
    "Binding",
    "Blueprint",
    "BusKind",
    "Category",
    "Control",
    "ControlKind",
    "Described",
    "Difference",
    "Direction",
    "DriverPin",
    "DriverSpec",
    "FieldKind",
    "InDds",
    "InvalidFileError",
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
    "RosOptions",
    "Scalar",
    "Simulator",
    "Slot",
    "SlotPort",
    "Supply",
    "Timing",
    "VersionRange",
    "WiredPart",
    "binding_faults",
    "blueprint_mark",
    "blueprint_toml",
    "board_documents",
    "compare_text",
    "differences",
    "for_groups",
    "format_text",
    "groups_by_slots",
    "library_folders",
    "load_blueprint",
    "load_library",
    "open_blueprint",
    "parse_blueprint",
    "parse_versions",
    "part_number_and_name",
    "preset_of",
    "problems_json",
    "read_description",
    "scalar_text",
    "slot_toml",
    "split_number",
    "standard_message_types",
    "wired_part",
    "wired_parts",
    "write_new",
    "write_sample",
]
