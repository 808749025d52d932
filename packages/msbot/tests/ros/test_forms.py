"""Messages of MsBOT as messages of ROS 2: the usual forms, forms of a binding, and what is wrong with one."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot import HelloWorld, Message, ros2
from msbot.part.messages import standard
from msbot.part.messages.standard import STANDARD_MESSAGES
from msbot.part.messages.wire_types import float32, uint8
from msbot.ros2.forms import USUAL, RosForm, form_of, ros_class, topic_name
from msbot.ros2.known_types import ROS_TYPES
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
        (lambda: form_of(Own), "Own has no usual type in ROS 2: say ros_type and ros_fields, or ros_type = "),
        (
            lambda: form_of(Own, "Float32"),
            "'Float32' is not a message type of ROS 2: write it like std_msgs/msg/Float32",
        ),
        (lambda: form_of(Own, "std_msgs/Thing"), "'std_msgs/Thing' is not among the message types of ROS 2 that MsBOT"),
        (
            lambda: form_of(Own, "my_msgs/Thing", {"a": "data"}),
            "my_msgs/Thing is not among the message types that MsBOT knows: its fields must be those of Own; remove",
        ),
        (
            lambda: form_of(Own, "msbot_msgs/msg/Thing"),
            "msbot_msgs has the types of the library (msbot library ros-package), and Own is msbot_msgs/msg/Own there",
        ),
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


def image_of(**values: Any) -> ros2.Image:
    """One without a header."""
    return ros2.Image(**values)


def test_a_scan_is_a_laser_scan_and_back() -> None:
    scan = standard.Scan(angle_min=-90.0, angle_step=45.0, reach=4.0, metres=[0.5, 1.0, 9.0])
    form = form_of(standard.Scan)
    theirs = ros2.LaserScan.decode(form.outward(scan.encode()))
    assert theirs.angle_max == pytest.approx(0.0, abs=1e-6)
    assert (theirs.range_max, list(theirs.ranges)) == (4.0, [0.5, 1.0, 9.0])
    back = standard.Scan.decode(form.inward(theirs.encode()))
    assert back.metres == scan.metres
    assert back.angle_step == pytest.approx(45.0)


def test_a_strip_is_an_image_of_one_row_and_a_picture_an_image() -> None:
    strip = standard.Strip(colours=[standard.Colour(red=255, green=1, blue=2), standard.Colour(red=0, green=0, blue=0)])
    form = form_of(standard.Strip)
    image = ros2.Image.decode(form.outward(strip.encode()))
    assert (image.width, image.height, image.step, image.encoding, image.data) == (2, 1, 6, "rgb8", b"\xff\1\2\0\0\0")
    assert standard.Strip.decode(form.inward(image.encode())) == strip
    picture = standard.Picture(width=2, height=2, format=standard.PixelFormat.MONO8, pixels=b"abcd")
    form = form_of(standard.Picture)
    image = ros2.Image.decode(form.outward(picture.encode()))
    assert (image.width, image.height, image.step, image.encoding, image.data) == (2, 2, 2, "mono8", b"abcd")
    assert standard.Picture.decode(form.inward(image.encode())) == picture


@pytest.mark.parametrize(
    ("image", "words"),
    [
        (image_of(width=2, height=1, step=4, encoding="16UC1", data=b"abcd"), "an image of '16UC1', where mono8 or"),
        (image_of(width=2, height=1, step=4, encoding="mono8", data=b"abcd"), "whose rows are not 2 pixels of 1"),
        (image_of(width=80, height=80, step=80, encoding="mono8", data=bytes(6400)), "at most 3072"),
    ],
)
def test_an_image_of_another_kind_is_refused(image: ros2.Image, words: str) -> None:
    with pytest.raises(RemoteProtocolError, match=re.escape(words)):
        form_of(standard.Picture).inward(image.encode())
