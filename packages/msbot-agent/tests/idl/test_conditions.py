"""Which lines of an IDL file count, and where included files are found."""

from __future__ import annotations

from itertools import count
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from msbot_agent.cli.idl import command
from msbot_agent.idl import read_definitions, to_python
from msbot_agent.idl.model import Array, Basic, Definitions, Sequence, StringType
from msbot_agent.idl.omg_reader import read_idl
from msbot_xrce.errors import ConfigError
from tests.idl.generated import module_from

TWO_BOARDS = """#ifndef MOTOR_IDL  // read once
#define MOTOR_IDL
#if defined(LARGE)
const long COUNT = 8;
typedef sequence<octet, 99> Raw;
#elif !defined(SMALL)
const long COUNT = 4; /* what \\ cannot be read @ here matters not */
typedef sequence<octet, 50> Raw;
#else
const long COUNT = 1; typedef sequence<octet, 1> Raw;
#endif
#if 0
this is $ no IDL "at all
#endif
struct Motor { float speeds[COUNT]; Raw raw; };
#endif
"""


def lengths(*defined: str) -> tuple[int, int | None]:
    found = Definitions()
    read_idl(TWO_BOARDS, "motor.idl", found, defined=defined)
    speeds, raw = (member.type for member in found.structs[("Motor",)].members)
    assert isinstance(speeds, Array)
    assert isinstance(raw, Sequence)
    return speeds.length, raw.bound


def test_of_a_condition_one_branch_counts() -> None:
    assert lengths() == (4, 50)
    assert lengths("LARGE") == (8, 99)
    assert lengths("SMALL") == (1, 1)
    assert lengths("LARGE", "SMALL") == (8, 99)


MISTAKES = {
    "#if VERSION > 2\n#endif": "a.idl:1:1: #if VERSION > 2 is not read: a condition is 0, 1, defined(NAME) or",
    "#ifdef A\nstruct B { long c; };": "a.idl:1:1: #endif is missing: this condition is never closed",
    "\n#else": "a.idl:2:1: #else without #if",
    "#if 1\n#else\n#else\n#endif": "a.idl:3:1: #else after #else",
    "#define N 6\nstruct A { long x[N]; };": "a.idl:2:19: N is a macro, whose value is not read: write const long N",
    "#error wrong board": "a.idl:1:1: the file refuses this: wrong board",
    "#embed <x>": "a.idl:1:1: #embed is not read",
    "#ifdef": "a.idl:1:1: #ifdef needs one name, not nothing",
}


@pytest.mark.parametrize("text", MISTAKES)
def test_what_cannot_be_obeyed_is_refused(text: str) -> None:
    with pytest.raises(ConfigError) as caught:
        read_idl(text, "a.idl", Definitions())
    assert str(caught.value).startswith(MISTAKES[text])


def test_brackets_close_without_blanks() -> None:
    found = Definitions()
    read_idl("struct A { sequence<sequence<string<8>>> a; sequence<sequence<long,2>,3> b; };", "a.idl", found)
    assert [member.type for member in found.structs[("A",)].members] == [
        Sequence(Sequence(StringType(8))),
        Sequence(Sequence(Basic("int32"), 2), 3),
    ]


def test_an_included_file_is_found_in_the_folders_of_include(tmp_path: Path) -> None:
    (tmp_path / "far/base_msgs/msg").mkdir(parents=True)
    (tmp_path / "near").mkdir()
    (tmp_path / "far/base_msgs/msg/Tick.idl").write_text(
        "#define WITH_TICK\nmodule base_msgs { module msg { struct Tick { long sec; }; }; };\n"
    )
    file = tmp_path / "near/Joint.idl"
    file.write_text(
        '#include "base_msgs/msg/Tick.idl"\n#include "std_msgs/msg/Header.idl"\n#ifdef WITH_TICK\n'
        "struct Joint { base_msgs::msg::Tick tick; std_msgs::msg::Header header; };\n#endif\n"
    )
    found = read_definitions(file, include=[tmp_path / "far"], is_ros=True)
    assert found.structs[("base_msgs", "msg", "Tick")].type_name == "base_msgs::msg::dds_::Tick_"
    assert "class Joint(Message)" in to_python(found, "Joint.idl")
    with pytest.raises(
        ConfigError, match=r"Joint\.idl:1:1: base_msgs/msg/Tick\.idl is not there \(looked into .*--include"
    ):
        read_definitions(file)


def test_the_command_obeys_ros_include_and_define(tmp_path: Path) -> None:
    share = tmp_path / "share"
    for package, text in (
        ("base_msgs", "struct Tick { long sec; unsigned long nanosec; };"),
        (
            "arm_msgs",
            "#ifdef WIDE\nconst long JOINTS = 60;\n#else\nconst long JOINTS = 6;\n#endif\n"
            "struct Arm { base_msgs::msg::Tick tick; double angles[JOINTS]; };",
        ),
    ):
        (share / package / "msg").mkdir(parents=True)
        name = "Tick" if package == "base_msgs" else "Arm"
        first = "" if name == "Tick" else '#include "base_msgs/msg/Tick.idl"\n'
        whole = f"{first}module {package} {{ module msg {{\n{text}\n}}; }};\n"
        (share / package / "msg" / f"{name}.idl").write_text(whole)
    file = share / "arm_msgs/msg/Arm.idl"
    numbers = count()

    def made(*options: str) -> Any:
        target = tmp_path / f"made_{next(numbers)}.py"
        told = CliRunner().invoke(command, ["to-python", *options, str(file), "-o", str(target)])
        assert told.exit_code == 0, told.output
        return module_from(target.read_text(), target.stem)

    plain, wide = made("--ros", "--include", str(share)), made("--ros", "--include", str(share), "--define", "WIDE")
    assert plain.Arm.type_name == "arm_msgs::msg::dds_::Arm_"
    assert plain.Tick.type_name == "base_msgs::msg::dds_::Tick_"
    assert (len(plain.Arm().angles), len(wide.Arm().angles)) == (6, 60)
    assert plain.Arm.decode(plain.Arm(tick=plain.Tick(sec=3, nanosec=4)).encode()).tick.nanosec == 4
    assert made("--include", str(share)).Arm.type_name == "arm_msgs::msg::Arm"


def test_an_option_that_says_nothing_about_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.idl").write_text("struct A { long b; };")
    (tmp_path / "A.msg").write_text("int32 b\n")
    with pytest.raises(ConfigError, match=r"--package is for \.msg and \.srv files"):
        read_definitions(tmp_path / "a.idl", package="p")
    with pytest.raises(ConfigError, match=r"--define is for \.idl files"):
        read_definitions(tmp_path / "A.msg", package="p", defined=["X"])
