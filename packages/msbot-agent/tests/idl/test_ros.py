"""ROS 2 interface files: names, defaults, services, and the octets that another DDS implementation writes."""

from __future__ import annotations

import importlib
import math
from pathlib import Path
from typing import Any

import pytest

from msbot import Message, ros2
from msbot_agent.idl import read_definitions, to_c, to_python
from msbot_xrce.errors import ConfigError
from tests.idl.generated import module_from


def package(tmp_path: Path, **files: str) -> Path:
    for name, text in files.items():
        kind, _, stem = name.partition("_")
        path = tmp_path / "my_robot" / kind / f"{stem}.{kind}"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return tmp_path / "my_robot"


def test_a_message_with_everything(tmp_path: Path) -> None:
    folder = package(
        tmp_path,
        msg_Wheel="float32 radius 0.5  # in m\nstring<=8 name 'left'\n",
        msg_Base=(
            "# What drives the robot.\nuint8 STOPPED=0\nuint8 MOVING=1\nstd_msgs/Header header\nWheel[2] wheels\n"
            "int32[] counts [1, 2]\nbool[<=3] flags\ngeometry_msgs/Twist[] wanted\nbyte[4] raw\n"
        ),
    )
    module = module_from(to_python(read_definitions(folder / "msg/Base.msg"), "Base.msg"), "generated_base")
    base: Message = module.Base()
    assert module.Base.type_name == "my_robot::msg::dds_::Base_"
    assert (module.Base.STOPPED, module.Base.MOVING) == (0, 1)
    assert [wheel.name for wheel in module.Base().wheels] == ["left", "left"]
    assert module.Base().counts == [1, 2]
    assert module.Base.decode(base.encode()) == base


def test_a_service_is_a_request_and_a_response(tmp_path: Path) -> None:
    folder = package(tmp_path, srv_AddTwoInts="int64 a\nint64 b\n---\nint64 sum\n")
    module = module_from(to_python(read_definitions(folder / "srv/AddTwoInts.srv"), "AddTwoInts.srv"), "generated_add")
    assert module.AddTwoInts_Request.type_name == "my_robot::srv::dds_::AddTwoInts_Request_"
    assert module.AddTwoInts_Response(sum=3).encode() == (3).to_bytes(8, "little")


def test_a_message_without_fields_has_the_one_that_ros_puts_there(tmp_path: Path) -> None:
    folder = package(tmp_path, msg_Nothing="# nothing to say\n")
    module = module_from(to_python(read_definitions(folder / "msg/Nothing.msg"), "Nothing.msg"), "generated_nothing")
    assert module.Nothing().encode() == b"\0"


def test_values_are_written_as_the_language_has_them(tmp_path: Path) -> None:
    folder = package(
        tmp_path,
        msg_Lamp=(
            "byte[3] colour [255, 128, 0]\nbyte[] more [1, 2]\nuint8[<=4] some [9]\nfloat32 limit inf\n"
            "float64 last nan\nfloat32 NEVER=-inf\nfloat64[2] ends [1.5, 2]\nbool[] flags [true, false]\n"
            "string NAME='a \"b\" \\ c'\n"
        ),
    )
    found = read_definitions(folder / "msg/Lamp.msg")
    module = module_from(to_python(found, "Lamp.msg"), "generated_lamp")
    lamp: Any = module.Lamp()
    assert (lamp.colour, lamp.more, lamp.some) == (b"\xff\x80\x00", b"\x01\x02", b"\t")
    assert (lamp.limit, lamp.NEVER, lamp.ends, lamp.flags) == (math.inf, -math.inf, [1.5, 2.0], [True, False])
    assert math.isnan(lamp.last)
    assert lamp.NAME == 'a "b" \\ c'
    header, _ = to_c(found, "Lamp.msg", "lamp")
    assert "#define my_robot_msg_Lamp_NEVER (-INFINITY)\n" in header
    assert "#include <math.h>\n" in header
    assert '#define my_robot_msg_Lamp_NAME "a \\042b\\042 \\134 c"\n' in header


def test_a_number_that_its_type_does_not_have_is_refused(tmp_path: Path) -> None:
    folder = package(tmp_path, msg_Lamp="byte[2] colour [255, 256]\n")
    with pytest.raises(ConfigError, match=r"Lamp\.msg:1:1: uint8 goes from 0 to 255, so it cannot be 256"):
        read_definitions(folder / "msg/Lamp.msg")


def test_a_package_is_named_by_its_manifest_and_not_by_its_folder(tmp_path: Path) -> None:
    package(tmp_path, msg_Wheel="uint64 timestamp\n").rename(tmp_path / "my_robot-main")
    wheel = tmp_path / "my_robot-main/msg/Wheel.msg"
    with pytest.raises(ConfigError, match=r"'my_robot-main' is no name of a ROS package, .*: say --package NAME"):
        read_definitions(wheel)
    (tmp_path / "my_robot-main/package.xml").write_text(
        '<?xml version="1.0"?><package format="3"><!-- <name>old</name> --><name>my_robot</name></package>'
    )
    assert [one.type_name for one in read_definitions(wheel).structs.values()] == ["my_robot::msg::dds_::Wheel_"]
    other = tmp_path / "elsewhere/Cart.msg"
    other.parent.mkdir()
    other.write_text("my_robot/Wheel wheel\n")
    assert ("my_robot", "msg", "Wheel") in read_definitions(other, package="cart", include=[tmp_path]).structs


def test_another_dds_implementation_writes_the_same_octets() -> None:
    pytest.importorskip("cyclonedds", reason="the Python package cyclonedds is not installed: pip install cyclonedds")
    theirs: Any = importlib.import_module("tests.idl.cyclone_types")

    header = ros2.Header(stamp=ros2.Time(sec=7, nanosec=8), frame_id="base_link")
    their_header = theirs.Header(stamp=theirs.Time(sec=7, nanosec=8), frame_id="base_link")
    pairs = [
        (
            ros2.Twist(linear=ros2.Vector3(x=1.0, y=2.0, z=3.0), angular=ros2.Vector3(x=4.0, y=5.0, z=-6.5)),
            theirs.Twist(linear=theirs.Vector3(x=1.0, y=2.0, z=3.0), angular=theirs.Vector3(x=4.0, y=5.0, z=-6.5)),
        ),
        (
            ros2.LaserScan(
                header=header,
                angle_min=-1.5,
                angle_max=1.5,
                angle_increment=0.5,
                time_increment=0.25,
                scan_time=0.5,
                range_min=0.125,
                range_max=8.0,
                ranges=[1.0, 2.0, 0.5],
                intensities=[],
            ),
            theirs.LaserScan(
                header=their_header,
                angle_min=-1.5,
                angle_max=1.5,
                angle_increment=0.5,
                time_increment=0.25,
                scan_time=0.5,
                range_min=0.125,
                range_max=8.0,
                ranges=[1.0, 2.0, 0.5],
                intensities=[],
            ),
        ),
        (
            ros2.Imu(
                header=header,
                orientation=ros2.Quaternion(x=0.0, y=0.0, z=0.5, w=1.0),
                orientation_covariance=[float(i) for i in range(9)],
                angular_velocity=ros2.Vector3(x=1.0, y=0.0, z=0.0),
                angular_velocity_covariance=[0.0] * 9,
                linear_acceleration=ros2.Vector3(x=0.0, y=0.0, z=9.81),
                linear_acceleration_covariance=[-1.0] * 9,
            ),
            theirs.Imu(
                header=their_header,
                orientation=theirs.Quaternion(x=0.0, y=0.0, z=0.5, w=1.0),
                orientation_covariance=[float(i) for i in range(9)],
                angular_velocity=theirs.Vector3(x=1.0, y=0.0, z=0.0),
                angular_velocity_covariance=[0.0] * 9,
                linear_acceleration=theirs.Vector3(x=0.0, y=0.0, z=9.81),
                linear_acceleration_covariance=[-1.0] * 9,
            ),
        ),
        (
            ros2.Image(
                header=header, height=2, width=3, encoding="mono8", is_bigendian=0, step=3, data=bytes(range(6))
            ),
            theirs.Image(
                header=their_header, height=2, width=3, encoding="mono8", is_bigendian=0, step=3, data=list(range(6))
            ),
        ),
    ]
    for ours, their in pairs:
        octets = their.serialize(use_version_2=False)[4:]
        assert ours.encode().ljust(len(octets), b"\0") == octets, type(ours).__name__
        assert type(ours).decode(octets) == ours
