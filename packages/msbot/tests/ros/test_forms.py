"""Messages of MsBOT as messages of ROS 2: the usual forms, forms of a binding, and what is wrong with one."""

from __future__ import annotations

import math
import re
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot import HelloWorld, Message, ros2
from msbot.part.messages import standard
from msbot.part.messages.standard import STANDARD_MESSAGES
from msbot.part.messages.wire_types import float32, uint8
from msbot.ros2.forms import ROS_TYPES, USUAL, RosForm, form_of, ros_class, topic_name
from msbot_xrce.errors import ConfigError, RemoteProtocolError
from tests.damage import damaged, read_or_refused


def test_every_standard_message_has_a_usual_form_but_those_that_are_like_nothing_in_ros() -> None:
    assert set(STANDARD_MESSAGES) - set(USUAL) == {"Stick"}
    for name in USUAL:
        form_of(STANDARD_MESSAGES[name])


def test_a_level_is_a_float32_and_back() -> None:
    form = form_of(standard.Level)
    octets = form.outward(standard.Level(percent=42.5).encode())
    assert ros2.Float32.decode(octets).data == 42.5
    assert standard.Level.decode(form.inward(octets)).percent == 42.5


def test_units_are_changed() -> None:
    pressure = form_of(standard.Pressure)
    theirs = ros2.FluidPressure.decode(pressure.outward(standard.Pressure(hectopascal=1013.25).encode()))
    assert theirs.fluid_pressure == pytest.approx(101_325)
    colour = form_of(standard.Colour)
    rgb = ros2.ColorRGBA.decode(colour.outward(standard.Colour(red=255, green=51, blue=0).encode()))
    assert [rgb.r, rgb.g, rgb.b] == pytest.approx([1.0, 0.2, 0.0])
    assert standard.Colour.decode(colour.inward(rgb.encode())) == standard.Colour(red=255, green=51, blue=0)


def test_a_message_to_ros_is_stamped() -> None:
    form = RosForm(standard.Light, ros2.Illuminance, {"lux": "illuminance"}, epoch_ns=lambda: 5_000_000_007)
    stamp = ros2.Illuminance.decode(form.outward(standard.Light(lux=3).encode())).header.stamp
    assert (stamp.sec, stamp.nanosec) == (5, 7)


@given(st.floats(width=32, allow_nan=False, allow_infinity=False))
def test_what_goes_out_comes_back(value: float) -> None:
    for ours, field in ((standard.Level, "percent"), (standard.Temperature, "celsius"), (standard.Light, "lux")):
        form = form_of(ours)
        octets = ours(**{field: value}).encode()
        assert form.inward(form.outward(octets)) == octets


@given(st.sampled_from(sorted(USUAL)), st.data())
def test_octets_that_make_no_sense_are_refused_and_never_worse(name: str, data: st.DataObject) -> None:
    ours = STANDARD_MESSAGES[name]
    form = form_of(ours)
    octets = data.draw(damaged(st.just(ours().encode())) | st.binary(max_size=40))
    theirs = read_or_refused(form.outward, octets)
    if theirs is not None:
        assert ours.decode(octets)
    back = read_or_refused(form.inward, data.draw(damaged(st.just(form.outward(ours().encode())))))
    if back is not None:
        ours.decode(back)


def test_a_value_that_does_not_fit_is_refused() -> None:
    form = form_of(standard.Colour)
    with pytest.raises(RemoteProtocolError, match=r"Colour\.red cannot be 510"):
        form.inward(ros2.ColorRGBA(r=2.0, g=0.0, b=0.0, a=1.0).encode())
    with pytest.raises(RemoteProtocolError, match=r"cannot be Colour\.red"):
        form.inward(ros2.ColorRGBA(r=math.nan, g=0.0, b=0.0, a=1.0).encode())


def test_a_binding_says_another_type_and_fields() -> None:
    form = form_of(standard.Vector, "geometry_msgs/Twist", {"x": "linear.x", "z": "angular.z * 2"})
    twist = ros2.Twist.decode(form.outward(standard.Vector(x=1, y=5, z=3).encode()))
    assert (twist.linear.x, twist.linear.y, twist.angular.z) == (1, 0, 6)
    assert standard.Vector.decode(form.inward(twist.encode())) == standard.Vector(x=1, y=0, z=3)
    assert form_of(HelloWorld, "std_msgs/msg/String", {"message": "data"}).theirs is ros2.String
    assert form_of(standard.Speed, "std_msgs/Float64").theirs is ros2.Float64  # the only field of each


class Own(Message):
    """A type of a library."""

    a: float32
    b: uint8


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: form_of(Own), "Own has no usual type in ROS 2: say ros_type and ros_fields"),
        (
            lambda: form_of(Own, "Float32"),
            "'Float32' is not a message type of ROS 2: write it like std_msgs/msg/Float32",
        ),
        (lambda: form_of(Own, "my_msgs/Thing"), "'my_msgs/Thing' is not among the known message types of ROS 2"),
        (
            lambda: form_of(Own, "std_msgs/Float32"),
            "Own and std_msgs::msg::dds_::Float32_ have no field of the same name: say ros_fields, for example",
        ),
        (lambda: form_of(Own, "std_msgs/Float32", {"c": "data"}), "Own has no field 'c'; it has a, b"),
        (lambda: form_of(Own, "std_msgs/Float32", {"a": "date"}), "has no field 'date'; it has data"),
        (lambda: form_of(Own, "std_msgs/Float32", {"a": "data.x"}), "std_msgs::msg::dds_::Float32_.data has no fields"),
        (
            lambda: form_of(Own, "std_msgs/Float32", {"a": "data / 2"}),
            "'data / 2' is not a field of ROS 2: write it like",
        ),
        (lambda: form_of(Own, "std_msgs/Float32", {"a": "data * 0"}), "'data * 0': a factor of 0 leaves nothing"),
        (lambda: form_of(Own, "std_msgs/String", {"a": "data"}), "a number goes with a number and a text with a text"),
        (
            lambda: topic_name("ROVER", "my light"),
            "topic 'my light' cannot be in ROS 2: names consist of letters, digits, _ and",
        ),
    ],
)
def test_what_is_wrong_is_said(call: Callable[[], object], words: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(words)):
        call()


def test_names() -> None:
    assert topic_name("ROVER", "arm/light_1") == "rt/ROVER/arm/light_1"
    assert topic_name("rover 2", "/arm/light_1") == "rt/arm/light_1"
    assert topic_name("2 rovers", "light") == "rt/_2_rovers/light"
    assert ros_class("std_msgs/Bool") is ros_class("std_msgs/msg/Bool") is ROS_TYPES["std_msgs::msg::dds_::Bool_"]


def test_what_fast_dds_leaves_behind_a_message_is_not_looked_at() -> None:
    """Its `serialize_message` appends a few octets for each empty list."""
    form = form_of(standard.Text)
    message = ros2.String(data="hello").encode()
    assert standard.Text.decode(form.inward(message + b"\xfe" * 12)) == standard.Text(text="hello")
    with pytest.raises(RemoteProtocolError, match="bytes left over"):
        form.inward(message + bytes(2000))
