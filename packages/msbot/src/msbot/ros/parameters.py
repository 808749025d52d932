"""The parameters of a slot in the words of ROS 2 (rcl_interfaces), and back."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from msbot.config import Scalar, scalar_text
from msbot.registry import ValueRecord
from msbot.ros2 import FloatingPointRange, IntegerRange, ListParametersResult, ParameterDescriptor, ParameterValue
from msbot_xrce.errors import ConfigError

NOT_SET, BOOL, INTEGER, DOUBLE, STRING = range(5)
ARRAYS = range(5, 10)
"""Kinds of lists, which no parameter of a slot is."""

TYPES = {"bool": BOOL, "int": INTEGER, "float": DOUBLE, "text": STRING, "part": STRING}
"""Our kind of parameter -> its type in ROS 2."""
WORDS = {NOT_SET: "nothing", BOOL: "a bool", INTEGER: "an integer", DOUBLE: "a double", STRING: "a string"}

LEAST_INTEGER, MOST_INTEGER = -(1 << 63), (1 << 63) - 1


def parameter_value(value: Scalar | None) -> ParameterValue:
    """The value as ROS 2 has it; None: the parameter does not exist."""
    is_truth = isinstance(value, bool)
    kind = NOT_SET
    if value is not None:
        kind = BOOL if is_truth else {int: INTEGER, float: DOUBLE, str: STRING}[type(value)]
    return ParameterValue(
        type=kind,
        bool_value=value if isinstance(value, bool) else False,
        integer_value=value if kind == INTEGER and isinstance(value, int) else 0,
        double_value=value if isinstance(value, float) else 0.0,
        string_value=value if isinstance(value, str) else "",
        byte_array_value=b"",
        bool_array_value=[],
        integer_array_value=[],
        double_array_value=[],
        string_array_value=[],
    )


def value_of(record: ValueRecord) -> ParameterValue:
    """The value in force of a parameter, always in the parameter's own type."""
    value = record.value
    return parameter_value(float(value) if record.kind == "float" and isinstance(value, int | float) else value)


def wanted_text(record: ValueRecord, value: ParameterValue) -> str | None:
    """What a person would type to set this value; None: take back what was set by hand (`ros2 param delete`).

    Raises:
        ConfigError: a parameter of this type cannot have it; the text is for whoever wants to set it.
    """
    if value.type == NOT_SET:
        return None
    wanted = TYPES[record.kind]
    if value.type != wanted and (value.type, wanted) != (INTEGER, DOUBLE):
        given = WORDS.get(value.type, "a list" if value.type in ARRAYS else f"of the unknown type {value.type}")
        raise ConfigError(f"{record.name} is {WORDS[wanted]}, not {given}")
    found: dict[int, Scalar] = {
        BOOL: value.bool_value,
        INTEGER: value.integer_value,
        DOUBLE: value.double_value,
        STRING: value.string_value,
    }
    return scalar_text(found[value.type])


def descriptor_of(record: ValueRecord) -> ParameterDescriptor:
    """What may be known about a parameter before setting it."""
    doubles, integers = [], []
    if record.least is not None or record.most is not None:
        least = -math.inf if record.least is None else record.least
        most = math.inf if record.most is None else record.most
        if record.kind == "float":
            doubles.append(FloatingPointRange(from_value=least, to_value=most, step=0.0))
        else:
            low = LEAST_INTEGER if record.least is None else math.ceil(record.least)
            high = MOST_INTEGER if record.most is None else math.floor(record.most)
            integers.append(IntegerRange(from_value=max(low, LEAST_INTEGER), to_value=min(high, MOST_INTEGER), step=1))
    return ParameterDescriptor(
        name=record.name,
        type=TYPES[record.kind],
        description=record.description,
        additional_constraints=f"unit: {record.unit}" if record.unit else "",
        read_only=False,
        dynamic_typing=False,
        floating_point_range=doubles,
        integer_range=integers,
    )


def no_descriptor(name: str) -> ParameterDescriptor:
    """The descriptor of a parameter that does not exist, as rclpy answers it."""
    return ParameterDescriptor(
        name=name,
        type=NOT_SET,
        description="",
        additional_constraints="",
        read_only=False,
        dynamic_typing=False,
        floating_point_range=[],
        integer_range=[],
    )


def list_parameters(names: Iterable[str], prefixes: Sequence[str], depth: int) -> ListParametersResult:
    """The names below the prefixes, not deeper than `depth` levels (0: all), and the prefixes that they have.

    Levels are separated by dots; without prefixes it is about all names.
    """
    found: list[str] = []
    above: dict[str, None] = {}
    for name in names:
        if any(_is_below(name, prefix, depth) for prefix in prefixes) or (
            not prefixes and (depth == 0 or name.count(".") < depth)
        ):
            found.append(name)
            if "." in name:
                above[name.rpartition(".")[0]] = None
    return ListParametersResult(names=found, prefixes=list(above))


def _is_below(name: str, prefix: str, depth: int) -> bool:
    if name == prefix:
        return True
    if not name.startswith(f"{prefix}."):
        return False
    return depth == 0 or name[len(prefix) + 1 :].count(".") < depth
