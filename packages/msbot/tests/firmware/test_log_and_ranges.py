"""What the firmware's part writes into the robot's log, and what it publishes outside of the library's ranges."""

from __future__ import annotations

import asyncio
import re
import struct
from pathlib import Path
from random import Random

import pytest

from msbot_agent.idl import to_c
from msbot_agent.idl.model import Definitions
from msbot_agent.idl.omg_reader import read_idl
from tests.firmware.c_part import CPart, Described
from tests.firmware.pipe import Firmware
from tests.firmware.robot import Robot, play

UID = bytes(range(1, 9))
DIAL, SCAN, DRIVE = 0, 1, 2
PORTS = ((1, "dial", "Level"), (1, "scan", "Reading"), (0, "drive", "Level"))
BOARD = Described(uid=UID, part_number="DIAL-C", ports=PORTS)
READING = "name:s place:d count:q step:h seen:? beams:f=3 far:I<4 tip.x:f"
INFO, WARNING, ERROR = 1, 2, 3

TYPES = """number = "DIAL-C"
name = "Dial"

[[type]]
name = "Tip"
fields = { x = "float32" }

[[type]]
name = "Reading"

[type.fields]
name = "text"
place = "float64"
count = "int64"
step = "int16"
seen = "bool"
beams = "float32[3]"
far = "uint32[<=4]"
tip = "Tip"

[[port]]
name = "dial"
direction = "publish"
type = "Level"
ranges = { percent = [0, 100] }

[[port]]
name = "scan"
direction = "publish"
type = "Reading"

[port.ranges]
place = [-1e-3, 1.5e9]
count = [-5, 5]
step = [-2, 2]
beams = [0, 0.25]
far = [1, 4]
"tip.x" = [-1, 1]

[[port]]
name = "drive"
direction = "subscribe"
type = "Level"
"""
SLOTS = """part = "TOGGLE"

[[slot]]
name = "dial"
part = "DIAL-C"

[[slot]]
name = "other"
part = "FAN-5V"

[[binding]]
topic = "dial"
type = "Level"
from = "dial.dial"
to = ["other.power"]

[[binding]]
topic = "scan"
type = "Reading"
from = "dial.scan"
to = []
"""
ROBOT = (('part = "TOGGLE"\n', SLOTS),)


@pytest.fixture
def types(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The library of the examples with a part whose ports have ranges."""
    import tests.firmware.robot as robot

    folder = tmp_path / "examples"
    (folder / "parts").mkdir(parents=True)
    for path in (robot.EXAMPLES / "robot.toml", *(robot.EXAMPLES / "parts").glob("*.toml")):
        (folder / path.relative_to(robot.EXAMPLES)).write_text(path.read_text())
    (folder / "parts" / "dial.toml").write_text(TYPES)
    monkeypatch.setattr(robot, "EXAMPLES", folder)


def lines(robot: Robot) -> list[str]:
    """The robot's log, from now on."""
    heard: list[str] = []
    robot.master.inventory.log.on_line(lambda line: heard.append(f"{line.level.word} {line.words}"))
    return heard


def level(percent: float) -> bytes:
    return struct.pack("<f", percent)


def reading(**changes: float) -> bytes:
    """All in range, but for what is said."""
    value = {"place": 0.5, "count": 5, "step": -2, "beam": 0.25, "far": 4, "x": 0.0} | changes
    head = struct.pack("<I5s7xdqhBx", 5, b"left\0", value["place"], int(value["count"]), int(value["step"]), 1)
    return head + struct.pack("<3fI2If", 0, 0, value["beam"], 2, 1, int(value["far"]), value["x"])


def test_the_robot_gets_the_lines_of_its_program(firmware: Firmware, tmp_path: Path, types: None) -> None:
    async def scene(robot: Robot) -> None:
        board = robot.plug(CPart(firmware, BOARD))
        heard = lines(robot)
        assert not board.log(b"too early")
        await asyncio.sleep(2)
        for text, how in ((b"it is warm", INFO), ("hot: 90 °C".encode(), WARNING), (b"line\nand line\x07", ERROR)):
            assert board.log(text, how)
            await asyncio.sleep(0.2)
        assert board.log(("ä" * 100).encode())
        await asyncio.sleep(0.5)
        assert board.log(b"")
        assert board.log(b"x" * 24)
        await asyncio.sleep(0.5)
        assert heard == [
            "info it is warm",
            "warning hot: 90 °C",
            "error line and line ",
            "info " + "ä" * 88 + "…",
            "info  ",
            "info " + "x" * 24,
        ]
        heard.clear()
        await asyncio.sleep(5)
        taken = 0
        for number in range(30):
            taken += board.log(b"%d" % number)
            await asyncio.sleep(0.01)
        assert taken == 21, "20 at once, and one of the time in which they came"
        await asyncio.sleep(1)
        assert board.log(b"again")
        await asyncio.sleep(1)
        assert heard == [
            *(f"info {number}" for number in range(21)),
            "warning 9 lines were left out: 5 a second are sent",
            "info again",
        ]
        assert board.dropped == (0, 0, 0)

    play(tmp_path, scene, changes=ROBOT)


def test_a_line_does_not_outlive_its_session(firmware: Firmware, tmp_path: Path, types: None) -> None:
    async def scene(robot: Robot) -> None:
        board = robot.plug(CPart(firmware, BOARD))
        await asyncio.sleep(2)
        await robot.kill_master()
        assert board.log(b"into the void" * 10)
        await asyncio.sleep(30)
        await robot.new_master()
        heard = lines(robot)
        await asyncio.sleep(5)
        assert robot.state() == "active"
        assert board.log(b"back")
        await asyncio.sleep(1)
        assert heard == ["info back"]

    play(tmp_path, scene, changes=ROBOT)


def test_a_value_outside_of_its_range_is_sent_counted_and_said_once(
    firmware: Firmware, tmp_path: Path, types: None
) -> None:
    async def scene(robot: Robot) -> None:
        board = robot.plug(CPart(firmware, BOARD))
        heard = lines(robot)
        assert board.watch(DIAL, "percent:f")
        assert board.watch(SCAN, READING)
        await asyncio.sleep(3)
        for percent in (0.0, 100.0, 140.0, -0.5, float("nan")):
            assert board.publish(DIAL, level(percent))
            await asyncio.sleep(0.1)
        assert board.publish(SCAN, reading())
        assert board.out_of_range == 3
        changes: tuple[dict[str, float], ...] = (
            {"place": -0.00125},
            {"place": 2.5e9},
            {"count": -123456},
            {"step": 3},
            {"beam": 0.3},
            {"far": 4000000000},
            {"x": float("-inf")},
        )
        for change in changes:
            assert board.publish(SCAN, reading(**change))
            await asyncio.sleep(0.1)
        assert board.out_of_range == 10
        await asyncio.sleep(1)
        assert heard == [
            "warning dial: percent is published as 140; the robot's library says 0 to 100",
            "warning scan: place is published as -0.00125; the robot's library says -0.001 to 1.5e+09",
            "warning scan: count is published as -123456; the robot's library says -5 to 5",
            "warning scan: step is published as 3; the robot's library says -2 to 2",
            "warning scan: beams is published as 0.3; the robot's library says 0 to 0.25",
            "warning scan: far is published as 4e+09; the robot's library says 1 to 4",
            "warning scan: tip.x is published as -inf; the robot's library says -1 to 1",
        ]
        assert any("its program says: scan: tip.x is published as -inf" in line for line in robot.master.why("dial"))

    play(tmp_path, scene, changes=ROBOT)


IDL = """
enum Mode { OFF, SLOW };
struct Tip { float x; double y; };
struct Arm {
    string<8> name; Tip tip; Mode mode; float joints[6]; sequence<unsigned short, 4> marks; sequence<octet> raw;
    boolean up; long long count;
};
struct Hand { sequence<Tip> tips; };
"""
ARM = "name:s tip.x:f tip.y:d mode:I joints:f=6 marks:H<4 raw:B< up:? count:q"


def test_the_fields_that_idl_to_c_writes_are_such(firmware: Firmware, tmp_path: Path, types: None) -> None:
    definitions = Definitions()
    read_idl(IDL, "arm.idl", definitions)
    header, _ = to_c(definitions, "arm.idl", "arm")
    assert re.findall(r'#define (\w+)_FIELDS "(.*)"', header) == [("Tip", "x:f y:d"), ("Arm", ARM)]

    async def scene(robot: Robot) -> None:
        board = robot.plug(CPart(firmware, BOARD))
        assert board.watch(SCAN, ARM)
        await asyncio.sleep(0.1)

    play(tmp_path, scene, changes=ROBOT)


def test_a_message_cut_short_and_fields_that_are_none(firmware: Firmware, tmp_path: Path, types: None) -> None:
    async def scene(robot: Robot) -> None:
        board = robot.plug(CPart(firmware, BOARD))
        for fields in (
            "",
            "percent",
            "percent:",
            ":f",
            "percent:x",
            "a:f  b:f",
            "a:f b",
            "a:f=",
            "a:s<4",
            "a:f ",
            "a b:f",
        ):
            assert not board.watch(DIAL, fields), fields
        assert not board.watch(DRIVE, "percent:f"), "it does not publish"
        assert not board.watch(7, "percent:f")
        assert board.watch(SCAN, READING)
        await asyncio.sleep(3)
        random = Random(1)
        for _ in range(200):
            board.publish(SCAN, random.randbytes(random.randrange(60)))
            await asyncio.sleep(0.02)
        assert robot.state() == "active"

    play(tmp_path, scene, changes=ROBOT)
