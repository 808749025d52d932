"""The hash of a message type: that of ROS 2, and another one for each difference that a reader would stumble over."""

from __future__ import annotations

from enum import IntEnum
from typing import Annotated

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot import ros2
from msbot.part import Message
from msbot.part.messages.message import fields_of
from msbot.part.messages.standard import STANDARD_MESSAGES
from msbot.part.messages.type_hash import (
    Fields,
    described_types,
    fields_text,
    first_difference,
    hash_words,
    read_fields,
    type_hash,
)
from msbot.part.messages.wire_types import AtMost, Exactly, float32, uint16
from msbot_agent.space.dds.ros_type_hashes import ROS_TYPE_HASHES

PROMISE = "A part whose message class differs from the library's type is told so, and so are the people"
NAMES = st.from_regex("[a-z][a-z0-9_]{0,8}", fullmatch=True)
KINDS = st.sampled_from(["float32", "uint16", "int64", "bool", "text"])
WITH_OCTETS = (
    "std_msgs::msg::dds_::Byte_",
    "diagnostic_msgs::msg::dds_::DiagnosticStatus_",
    "diagnostic_msgs::msg::dds_::DiagnosticArray_",
    "rcl_interfaces::msg::dds_::ParameterValue_",
    "rcl_interfaces::msg::dds_::Parameter_",
    "rcl_interfaces::msg::dds_::ParameterEvent_",
)
"""They have an octet, for which there is a uint8 here."""


def hash_of(cls: type[Message]) -> bytes:
    types = described_types(cls)
    assert types is not None
    return type_hash(cls.type_name, types[cls.type_name], types.get)


FIELDS = st.lists(st.tuples(NAMES, KINDS), min_size=1, max_size=5, unique_by=lambda one: one[0])


@pytest.mark.promise(PROMISE)
def test_types_of_ros_2_have_the_hash_that_ros_2_gives_them() -> None:
    checked = 0
    for cls in vars(ros2).values():
        if not isinstance(cls, type) or not issubclass(cls, Message) or cls.type_name not in ROS_TYPE_HASHES:
            continue
        if cls.type_name in WITH_OCTETS or not fields_of(cls) or "::srv::" in cls.type_name:
            continue  # ROS 2 gives a whole service one hash
        assert hash_of(cls).hex() == ROS_TYPE_HASHES[cls.type_name][:16], cls.type_name
        checked += 1
    assert checked >= 60


def test_the_standard_messages_have_hashes_and_each_its_own() -> None:
    found = {name: hash_of(cls) for name, cls in STANDARD_MESSAGES.items()}
    assert len(set(found.values())) == len(found)
    assert hash_words(found["Level"]).startswith("RIHS01_")


class Raw(Message):
    value: uint16


class Mode(IntEnum):
    OFF = 0
    ON = 1


class Nested(Message):
    inner: Raw
    mode: Mode
    some: Annotated[list[Raw], AtMost(4)]
    name: Annotated[str, AtMost(32)]
    three: Annotated[list[float32], Exactly(3)]


class Grid(Message):
    rows: list[list[float32]]


def test_fields_inside_others_count_and_lists_of_lists_are_not_compared() -> None:
    assert described_types(Nested) == {
        "Nested": [
            ("inner", "Raw"),
            ("mode", "Mode"),
            ("some", "Raw[<=4]"),
            ("name", "text<=32"),
            ("three", "float32[3]"),
        ],
        "Raw": [("value", "uint16")],
        "Mode": [("off", "0"), ("on", "1")],
    }
    assert described_types(Grid) is None
    types = described_types(Nested) or {}
    wider = {**types, "Raw": [("value", "float32")]}
    renamed = {**types, "Mode": [("off", "0"), ("fast", "1")]}
    hashes = {type_hash("Nested", types["Nested"], one.get) for one in (types, wider, renamed)}
    assert len(hashes) == 3
    found = first_difference(types["Nested"], types["Nested"], wider.get, types.get)
    assert (found and (found.place, found.theirs, found.ours)) == (0, "float32 value in inner", "uint16 value in inner")
    found = first_difference(types["Nested"], types["Nested"], renamed.get, types.get)
    assert (found and (found.place, found.theirs, found.ours)) == (1, "fast = 1 in mode", "on = 1 in mode")


@given(FIELDS, FIELDS)
def test_other_fields_another_hash_and_the_first_difference_is_found(one: Fields, other: Fields) -> None:
    one, other = list(one), list(other)
    found = first_difference(one, other)
    place = None if found is None else found.place
    assert (type_hash("T", one) == type_hash("T", other)) == (one == other) == (place is None)
    if place is not None:
        assert one[:place] == other[:place]
        assert one[place : place + 1] != other[place : place + 1]


@given(st.dictionaries(st.from_regex("[A-Z][a-z]{0,8}", fullmatch=True), FIELDS, max_size=4))
def test_fields_travel_as_a_text(types: dict[str, Fields]) -> None:
    assert read_fields(fields_text(types) + "\n\n") == types


@given(st.text(max_size=200))
def test_any_text_is_read(text: str) -> None:
    for name, fields in read_fields(text).items():
        assert name
        assert all(len(one) == 2 for one in fields)


def test_the_name_and_the_order_count() -> None:
    fields = [("x", "float32"), ("y", "float32")]
    assert len({type_hash("T", fields), type_hash("T", fields[::-1]), type_hash("U", fields)}) == 3
