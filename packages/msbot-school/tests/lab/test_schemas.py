"""Message classes as ROS 2 definitions: a foreign decoder must read from them what the class wrote."""

from typing import Annotated

import pytest
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory

from msbot import AtMost, Exactly, Message, Octets, float32, float64, int16, ros2, uint8, uint16
from msbot.part.messages.ros_names import ros_name
from msbot.part.messages.standard import STANDARD_MESSAGES
from msbot.recording.recorder.recording_file import ENCAPSULATION
from msbot.recording.recorder.schemas import ros_definition


def decoded(message: Message) -> object:
    cls = type(message)
    schema = Schema(1, ros_definition(cls).encode(), "ros2msg", ros_name(cls.type_name))
    decode = DecoderFactory().decoder_for("cdr", schema)
    assert decode is not None
    return decode(ENCAPSULATION + message.encode())


class Inner(Message):
    left: int16
    name: str


class Outer(Message):
    type_name = "lab::my_outer"
    flag: bool
    uid: Annotated[bytes, Octets(3)]
    pairs: list[Inner]
    grid: Annotated[list[float64], Exactly(2)]
    word: Annotated[str, AtMost(9)]
    some: Annotated[list[uint16], AtMost(4)]
    inside: Inner
    wheelSpeed: float32


def test_every_kind_of_field_reaches_a_foreign_reader() -> None:
    message = Outer(
        flag=True,
        uid=b"abc",
        pairs=[Inner(left=-3, name="ä"), Inner(left=4, name="")],
        grid=[1.5, -2.0],
        word="hello",
        some=[1, 2],
        inside=Inner(left=7, name="x"),
        wheelSpeed=0.25,
    )
    found = decoded(message)
    assert (found.flag, bytes(found.uid), list(found.grid)) == (True, b"abc", [1.5, -2.0])  # type: ignore[attr-defined]
    assert [(one.left, one.name) for one in found.pairs] == [(-3, "ä"), (4, "")]  # type: ignore[attr-defined]
    assert (found.word, list(found.some), found.inside.left) == ("hello", [1, 2], 7)  # type: ignore[attr-defined]
    assert found.wheel_speed == 0.25  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", sorted(STANDARD_MESSAGES))
def test_every_standard_message_has_a_definition_that_others_understand(name: str) -> None:
    decoded(STANDARD_MESSAGES[name]())


def test_a_ros_message_has_the_names_of_ros() -> None:
    assert ros_name(ros2.Imu.type_name) == "sensor_msgs/msg/Imu"
    found = decoded(
        ros2.Range(
            header=ros2.Header(stamp=ros2.Time(sec=1, nanosec=2), frame_id="here"),
            radiation_type=1,
            field_of_view=0.5,
            min_range=0.0,
            max_range=2.0,
            range=1.5,
            variance=0.0,
        )
    )
    assert (found.header.frame_id, found.header.stamp.nanosec) == ("here", 2)  # type: ignore[attr-defined]
    assert found.range == 1.5  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("type_name", "expected"),
    [
        ("Level", "msbot_msgs/msg/Level"),
        ("msbot_master", "msbot_msgs/msg/MsbotMaster"),
        ("a::b::C", "msbot_msgs/msg/ABC"),
        ("3d", "msbot_msgs/msg/Type3d"),
        ("std_msgs::msg::dds_::Float32_", "std_msgs/msg/Float32"),
    ],
)
def test_type_names_become_names_that_ros_allows(type_name: str, expected: str) -> None:
    assert ros_name(type_name) == expected


def test_octets_stay_octets() -> None:
    class Blob(Message):
        kind: uint8
        data: bytes

    found = decoded(Blob(kind=1, data=b"\0\xff"))
    assert bytes(found.data) == b"\0\xff"  # type: ignore[attr-defined]
