"""The hash of a message type: that of ROS 2, and another one for each difference that a reader would stumble over."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot import ros2
from msbot.part import Message
from msbot.part.messages.standard import STANDARD_MESSAGES
from msbot.part.messages.type_hash import (
    Fields,
    described_fields,
    fields_text,
    first_difference,
    hash_words,
    read_fields,
    type_hash,
)
from msbot.part.messages.wire_types import uint16
from msbot_agent.space.dds.ros_type_hashes import ROS_TYPE_HASHES

PROMISE = "A part whose message class differs from the library's type is told so, and so are the people"
NAMES = st.from_regex("[a-z][a-z0-9_]{0,8}", fullmatch=True)
KINDS = st.sampled_from(["float32", "uint16", "int64", "bool", "text"])
FIELDS = st.lists(st.tuples(NAMES, KINDS), min_size=1, max_size=5, unique_by=lambda one: one[0])


@pytest.mark.promise(PROMISE)
def test_types_of_ros_2_have_the_hash_that_ros_2_gives_them() -> None:
    checked = 0
    for cls in vars(ros2).values():
        if not isinstance(cls, type) or not issubclass(cls, Message) or cls.type_name not in ROS_TYPE_HASHES:
            continue
        if "::srv::" in cls.type_name:
            continue  # ROS 2 gives the whole service one hash
        fields = described_fields(cls)
        if fields is not None and cls.type_name != "std_msgs::msg::dds_::Byte_":  # an octet there, a uint8 here
            assert type_hash(cls.type_name, fields).hex() == ROS_TYPE_HASHES[cls.type_name][:16], cls.type_name
            checked += 1
    assert checked >= 29


def test_the_standard_messages_have_hashes_and_each_its_own() -> None:
    found = {name: type_hash(name, described_fields(cls) or ()) for name, cls in STANDARD_MESSAGES.items()}
    assert all(described_fields(cls) for cls in STANDARD_MESSAGES.values())
    assert len(set(found.values())) == len(found)
    assert hash_words(found["Level"]).startswith("RIHS01_")


class Raw(Message):
    value: uint16


class Nested(Message):
    inner: Raw


def test_classes_with_other_classes_inside_are_not_compared() -> None:
    assert described_fields(Raw) == [("value", "uint16")]
    assert described_fields(Nested) is None


@given(FIELDS, FIELDS)
def test_other_fields_another_hash_and_the_first_difference_is_found(one: Fields, other: Fields) -> None:
    one, other = list(one), list(other)
    place = first_difference(one, other)
    assert (type_hash("T", one) == type_hash("T", other)) == (one == other) == (place is None)
    if place is not None:
        assert one[:place] == other[:place]
        assert one[place : place + 1] != other[place : place + 1]


@given(st.dictionaries(st.from_regex("[A-Z][a-z]{0,8}", fullmatch=True), FIELDS, max_size=4))
def test_fields_travel_as_a_text(types: dict[str, Fields]) -> None:
    assert read_fields(fields_text(types.items()) + "\n\n") == types


@given(st.text(max_size=200))
def test_any_text_is_read(text: str) -> None:
    for name, fields in read_fields(text).items():
        assert name
        assert all(len(one) == 2 for one in fields)


def test_the_name_and_the_order_count() -> None:
    fields = [("x", "float32"), ("y", "float32")]
    assert len({type_hash("T", fields), type_hash("T", fields[::-1]), type_hash("U", fields)}) == 3
