"""One definition in three languages: the Python classes, the C code and the rewritten IDL agree on every octet."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from msbot import Message
from msbot_agent.idl import read_definitions, to_c, to_idl, to_python
from msbot_agent.idl.definitions_reader import common_ros_definitions
from tests import ROOT
from tests.effort import tries
from tests.idl.generated import messages, module_from
from tests.kept import kept

HERE = Path(__file__).parent
ROBOT = read_definitions(HERE / "robot.idl")
ROS = common_ros_definitions()
TWIST, SCAN = "geometry_msgs_msg_Twist", "sensor_msgs_msg_LaserScan"


def things() -> type[Message]:
    found: type[Message] = module_from(to_python(ROBOT, "robot.idl"), "generated_robot").Thing
    return found


THING = things()


def test_the_shipped_ros_types_are_what_the_generator_writes() -> None:
    path = ROOT / "packages/msbot/src/msbot/ros2/__init__.py"
    source = "packages/msbot-agent/src/msbot_agent/idl/ros2.idl"
    assert path.read_text() == to_python(ROS, "ros2.idl"), f"msbot idl to-python {source} --ros -o {path}"


@given(st.data())
@settings(max_examples=tries(50, 2000))
def test_what_is_written_can_be_read_again(data: st.DataObject) -> None:
    message = data.draw(messages(THING))
    assert THING.decode(message.encode()) == message


def test_the_rewritten_idl_says_the_same(tmp_path: Path) -> None:
    again = tmp_path / "robot.idl"
    # A typedef and an inner bracket are resolved: what counts is what stands on the wire.
    again.write_text(to_idl(ROBOT, "robot.idl"))
    assert read_definitions(again).structs[("demo", "inner", "Thing")].members == tuple(
        member if member.comment == "" else type(member)(member.name, member.type)
        for member in ROBOT.structs[("demo", "inner", "Thing")].members
    )


HIDDEN = """
module std { struct Time { long sec; }; };
module robot {
  module std { struct Other { long x; }; };
  struct Clock { ::std::Time now; robot::std::Other other; };
  struct Watch { ::robot::Clock robot; };
};
"""


def test_a_name_that_an_inner_scope_hides_begins_at_the_outermost_one(tmp_path: Path) -> None:
    source = tmp_path / "hidden.idl"
    source.write_text(HIDDEN)
    text = to_idl(read_definitions(source), "hidden.idl")
    assert "  ::std::Time now;\n  robot::std::Other other;" in text
    assert "  ::robot::Clock robot;" in text
    again = tmp_path / "again.idl"
    again.write_text(text)
    assert read_definitions(again).structs == read_definitions(source).structs


@pytest.mark.parametrize(
    "tool",
    [("idlc", "-l", "c", "-x", "final"), ("fastddsgen", "-replace")],
    ids=["idlc of Cyclone DDS", "fastddsgen of Fast DDS"],
)
def test_the_tools_of_others_read_the_rewritten_idl(tool: tuple[str, ...]) -> None:
    if shutil.which(tool[0]) is None:
        pytest.skip(f"{tool[0]} is not installed: apt install cyclonedds-tools fastddsgen")
    texts = {"robot": to_idl(ROBOT, "robot.idl"), "ros": to_idl(ROS, "ros2.idl")}

    def make(folder: Path) -> None:
        for name, text in texts.items():
            (folder / f"{name}.idl").write_text(text)
            done = subprocess.run([*tool, f"{name}.idl"], cwd=folder, capture_output=True, text=True, check=False)
            assert done.returncode == 0, f"{name}: {done.stdout}{done.stderr}"

    made = kept(f"idl-{tool[0]}", make, tools=(tool[0],), told=(tool, *texts.values()), of=HERE / "none")
    assert len([*made.glob("robot*"), *made.glob("ros*")]) >= 2 * len(texts)


@pytest.fixture(scope="module")
def library() -> ctypes.CDLL:
    """The generated C, compiled without a warning."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler on this machine: apt-get install gcc")
    texts = {"ucdr/microcdr.h": (HERE / "microcdr.h").read_text()}
    calls = ['#include "robot.h"', '#include "ros2.h"']
    for stem, definitions in (("robot", ROBOT), ("ros2", ROS)):
        header, source = to_c(definitions, f"{stem}.idl", stem)
        texts |= {f"{stem}.h": header, f"{stem}.c": source}
    for name in ("demo_inner_Thing", TWIST, SCAN, "sensor_msgs_msg_Imu", "std_msgs_msg_Header"):
        calls.append(
            f"int there_and_back_{name}(uint8_t* in, uint32_t size, uint8_t* out, uint32_t room) {{\n"
            f"    static {name} message; ucdrBuffer b;\n    ucdr_init_buffer(&b, in, size);\n"
            f"    if (!{name}_deserialize(&b, &message)) return -1;\n    ucdr_init_buffer(&b, out, room);\n"
            f"    if (!{name}_serialize(&b, &message)) return -2;\n    return (int)(b.at - b.init);\n}}"
        )
    texts["calls.c"] = "\n".join(calls) + "\n"
    options = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-O1", "-fPIC", "-shared"]

    def make(folder: Path) -> None:
        (folder / "ucdr").mkdir()
        for name, text in texts.items():
            (folder / name).write_text(text)
        sources = [str(folder / name) for name in texts if name.endswith(".c")]
        subprocess.run([compiler, *options, "-I", str(folder), "-o", str(folder / "calls.so"), *sources], check=True)

    return ctypes.CDLL(str(kept("idl", make, tools=[compiler], told=[texts, options], of=HERE) / "calls.so"))


def through_c(library: ctypes.CDLL, name: str, octets: bytes) -> bytes:
    room = ctypes.create_string_buffer(100_000)
    size = getattr(library, f"there_and_back_{name}")(octets, len(octets), room, len(room))
    assert size >= 0, f"the C code refused the message: {size}"
    return room.raw[:size]


@given(data=st.data())
@settings(max_examples=tries(100, 2000), suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_the_c_code_reads_and_writes_the_same_octets(library: ctypes.CDLL, data: st.DataObject) -> None:
    octets = data.draw(messages(THING)).encode()
    assert through_c(library, "demo_inner_Thing", octets) == octets


@pytest.mark.parametrize("name", [TWIST, SCAN, "sensor_msgs_msg_Imu", "std_msgs_msg_Header"])
@given(data=st.data())
@settings(max_examples=tries(25, 2000))
def test_ros_types_look_the_same_in_c(library: ctypes.CDLL, name: str, data: st.DataObject) -> None:
    import msbot.ros2

    octets = data.draw(messages(getattr(msbot.ros2, name.rpartition("_")[2]))).encode()
    assert through_c(library, name, octets) == octets


@given(octets=st.binary(max_size=200))
@settings(max_examples=tries(100, 2000))
def test_whatever_octets_come_the_c_code_stays_inside_its_struct(library: ctypes.CDLL, octets: bytes) -> None:
    room = ctypes.create_string_buffer(100_000)
    size = library.there_and_back_demo_inner_Thing(octets, len(octets), room, len(room))
    if size >= 0:
        THING.decode(room.raw[:size])
