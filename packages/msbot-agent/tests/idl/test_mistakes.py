"""Mistakes in interface files are told with file, line, column, and what would be right; nothing hostile stalls it."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot_agent.idl import read_definitions
from msbot_agent.idl.installed_interfaces import installed_interfaces
from msbot_agent.idl.model import Definitions
from msbot_agent.idl.omg_reader import read_idl
from msbot_xrce.errors import ConfigError

MISTAKES = {
    "struct A { lung x; };": "a.idl:1:12: there is no type lung; did you mean long? It must be defined (or included)",
    "module m { struct Pose { long x; }; struct A { Posse y; }; };": "a.idl:1:48: there is no type Posse; did you mean "
    "m::Pose? It must be defined (or included) before it is used",
    "struct A { long x }": "a.idl:1:19: ; is missing before }",
    "struct A {\n  long x;\n": "a.idl:3:1: } is missing: struct A is never closed",
    "struct A {};": "a.idl:1:8: struct A has no members: DDS needs at least one",
    "struct A { long x; short x; };": "a.idl:1:26: there is a member x already",
    "struct A { long x; };\nstruct A { long y; };": "a.idl:2:8: A is defined twice",
    "union U switch (long) { case 1: long x; };": "a.idl:1:1: a union is not supported",
    "struct A { wstring x; };": "a.idl:1:12: a wide string is not supported",
    "struct A { @optional long x; };": "a.idl:1:13: @optional is not supported: classic CDR has no form for it",
    "struct A { unsigned float x; };": "a.idl:1:12: unsigned is not a type; did you mean unsigned long?",
    "struct A { long x[0]; };": "a.idl:1:19: a bound must be 1 to 65536, not 0",
    "struct A { long x[N]; };": "a.idl:1:19: there is no whole-number constant N",
    "const long N = 4 / 0;": "a.idl:1:18: / 0 cannot be worked out",
    "enum E { A, A };": "a.idl:1:13: there is a member A already",
    "enum E { A, @value(0) B };": "a.idl:1:23: two members of E have the number 0",
    "module m { struct A { long x; };": "a.idl:1:33: } is missing: module m is never closed",
    "/* open": "a.idl:1:1: this comment is never closed: */ is missing",
    "struct A { long ä; };": "a.idl:1:17: 'ä' has no place in IDL",
    "sturct A { long x; };": "a.idl:1:1: a definition begins with module, struct, enum, typedef or const, not sturct",
    '#include "gone.idl"': "a.idl:1:1: gone.idl is not there (looked into .)",
    "struct A { long double x; };": "a.idl:1:12: long double is not supported; use double",
}


@pytest.mark.parametrize(("text", "words"), MISTAKES.items())
def test_a_mistake_is_told_with_its_place_and_what_would_be_right(text: str, words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        read_idl(text, "a.idl", Definitions())
    assert str(caught.value).startswith(words)


ROS_MISTAKES = {
    "int33 x": "it.msg:1:1: the type my/int33 is nowhere; did you mean int32 or uint32 or int8? Else give",
    "Arm x": "it.msg:1:1: the type my/Arm is nowhere: give the folder that holds the package my with --include",
    "std_mgs/Header x": "it.msg:1:1: the type std_mgs/Header is nowhere; did you mean std_msgs/Header? Else give the",
    "std_msgs/Heder x": "it.msg:1:1: the type std_msgs/Heder is nowhere; did you mean std_msgs/Header? Else give the",
    "int32 x\nint32 x": "it.msg:2:1: there is a x already",
    "int32": "it.msg:1:1: a line is TYPE NAME, TYPE NAME DEFAULT, or TYPE NAME=VALUE",
    "wstring x": "it.msg:1:1: wstring is not supported; use string",
    "time x": "it.msg:1:1: time is a type of ROS 1; in ROS 2 it is builtin_interfaces/Time",
    "int32 Big": "it.msg:1:1: names of fields are written small: big",
    "int32<=4 x": "it.msg:1:1: only a string can have the bound <=4",
    "int32[0] x": "it.msg:1:1: a bound must be 1 to 65536, not 0",
    "bool x maybe": "it.msg:1:1: a boolean is true or false, not maybe",
    "int32[2] x [1]": "it.msg:1:1: 2 values are needed, not 1",
    "int32 X=many": "it.msg:1:1: a whole number is needed, not many",
    "int32 x\n---\nint32 y": "it.msg:1:1: this file must have no line ---",
    "it x": "it.msg:1:1: my/msg/it contains itself",
}


@pytest.mark.parametrize(("text", "words"), ROS_MISTAKES.items())
def test_a_mistake_in_a_ros_file_is_told_with_its_place(text: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "it.msg"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        read_definitions(path, package="my")
    assert str(caught.value).removeprefix(f"{tmp_path}/").startswith(words)


def test_a_typo_in_an_included_file_is_told(tmp_path: Path) -> None:
    path = tmp_path / "arm_msgs/msg/Arm.idl"
    path.parent.mkdir(parents=True)
    path.write_text('#include "std_mgs/msg/Header.idl"\n')
    with pytest.raises(ConfigError, match=r"\); did you mean std_msgs/Header\? Else give the folder"):
        read_definitions(path)


def test_packages_of_ros_on_this_computer_are_known(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By the setup file of a workspace: their types are read, and a typo in one is told."""
    share = tmp_path / "ws/share"
    listed = share / "ament_index/resource_index/rosidl_interfaces/house_msgs"
    listed.parent.mkdir(parents=True)
    listed.write_text("msg/Door.idl\nmsg/Door.msg\nsrv/Open.srv\n")
    (share / "house_msgs/msg").mkdir(parents=True)
    (share / "house_msgs/msg/Door.msg").write_text("bool is_open\n")
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/there/is/none:{tmp_path / 'ws'}")
    assert installed_interfaces()["house_msgs"] == {"msg/Door", "srv/Open"}
    path = tmp_path / "It.msg"
    path.write_text("house_msgs/Door front\n")
    assert ("house_msgs", "msg", "Door") in read_definitions(path, package="my").structs
    for wrong in ("house_msgs/Doors", "hous_msgs/Door"):
        path.write_text(f"{wrong} front\n")
        with pytest.raises(ConfigError, match=r"is nowhere; did you mean house_msgs/Door\? Else"):
            read_definitions(path, package="my")


def test_a_ros_file_needs_its_package(tmp_path: Path) -> None:
    path = tmp_path / "It.msg"
    path.write_text("int32 x\n")
    with pytest.raises(ConfigError, match="which ROS package does it belong to"):
        read_definitions(path)


@pytest.mark.parametrize(
    "text",
    [
        "module m { " * 10_000,
        "const long X = " + "(" * 100_000 + "1;",
        "const long X = " + "-" * 100_000 + "1;",
        "const long X = 1" + " << 63" * 1000 + ";",
        "struct A { " + "sequence<" * 10_000 + "long" + ">" * 10_000 + " x; };",
        "struct A { long " + ", ".join(f"x{i}" for i in range(2000)) + "; ",
    ],
)
def test_hostile_files_end_in_a_sentence(text: str) -> None:
    with pytest.raises(ConfigError):
        read_idl(text, "a.idl", Definitions())


@given(st.text(st.sampled_from("struct A{longx;}<>,[]0159 \nsequence@#/*\"'=module:"), max_size=80))
def test_any_text_is_read_or_refused_in_words(text: str) -> None:
    said = "a.idl: nothing"
    try:
        read_idl(text, "a.idl", Definitions())
    except ConfigError as error:
        said = str(error)
    assert said.startswith("a.idl:")
