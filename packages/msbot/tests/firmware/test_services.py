"""The firmware's part calls and is called in a robot of MsBOT, and says what is wrong with its configuration."""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from random import Random
from unittest import mock

import pytest

from msbot import CallError, Number, Text
from msbot.part.calls import ReplyStatus, encode_reply
from msbot.pnp import Freeze
from tests.firmware.c_part import CPart, Described
from tests.firmware.msbot_side import Part
from tests.firmware.pipe import Firmware
from tests.firmware.robot import Robot, play

UID = bytes(range(1, 9))
SUBSCRIBES, PUBLISHES, SERVES, CALLS = range(4)
ASK, HALVE = 0, 1
PORTS = ((CALLS, "ask", "Number -> Text"), (SERVES, "halve", "Number -> Number"))
BOARD = Described(uid=UID, part_number="BRAIN-C", ports=PORTS)
MOST_CALLS = 4

BRAIN = """number = "BRAIN-C"
name = "Brain"

[[port]]
name = "ask"
direction = "call"
request = "Number"
reply = "Text"

[[port]]
name = "halve"
direction = "serve"
request = "Number"
reply = "Number"
"""
PYTHON = """number = "PYTHON"
name = "A part in Python"

[[port]]
name = "name"
direction = "serve"
request = "Number"
reply = "Text"

[[port]]
name = "way"
direction = "call"
request = "Number"
reply = "Number"
"""
SLOTS = """part = "TOGGLE"

[[slot]]
name = "brain"
part = "BRAIN-C"

[[slot]]
name = "python"
part = "PYTHON"

[[binding]]
topic = "name"
type = "Number -> Text"
from = "python.name"
to = ["brain.ask"]

[[binding]]
topic = "half"
type = "Number -> Number"
from = "brain.halve"
to = ["python.way"]
"""
ROBOT = (('part = "TOGGLE"\n', SLOTS),)


@pytest.fixture
def types(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The library of the examples with two parts that call and serve."""
    import tests.firmware.robot as robot

    folder = tmp_path / "examples"
    (folder / "parts").mkdir(parents=True)
    for path in (robot.EXAMPLES / "robot.toml", *(robot.EXAMPLES / "parts").glob("*.toml")):
        (folder / path.relative_to(robot.EXAMPLES)).write_text(path.read_text())
    (folder / "parts" / "brain.toml").write_text(BRAIN)
    (folder / "parts" / "python.toml").write_text(PYTHON)
    monkeypatch.setattr(robot, "EXAMPLES", folder)


def number(value: float) -> bytes:
    return struct.pack("<f", value)


def text(reply: bytes | str) -> str:
    assert isinstance(reply, bytes)
    return Text.decode(reply).text


def partner(robot: Robot) -> Part:
    part = Part("PYTHON", random=Random(1))
    part.calls("way", Number, Number)

    @part.serves("name", Number, Text)
    def name(request: Number) -> Text:
        if request.value < 0:
            raise CallError("negative numbers have no name here")
        return Text(text=f"it is {request.value:g}")

    return robot.plug_python(part, "python")


def plug(robot: Robot, firmware: Firmware, *, serves: bool = True) -> CPart:
    return robot.plug(CPart(firmware, BOARD, serves=serves))


@pytest.mark.parametrize("codec", [True, False], ids=["compressed", "plain"])
def test_it_calls_and_learns_every_end(firmware: Firmware, tmp_path: Path, types: None, codec: bool) -> None:
    async def scene(robot: Robot) -> None:
        board = plug(robot, firmware)
        assert board.call(ASK, 0, number(1)) == "the part is not active"
        await asyncio.sleep(2)
        assert board.call(HALVE, 0, number(1)) == "it is no port that calls"
        assert board.call(ASK, 0, bytes(238)) == "the request is larger than MSBOT_PART_REQUEST"
        assert board.call(ASK, 1, number(1), 500.0) == ""
        await asyncio.sleep(0.5)
        assert board.ended.pop() == (1, "the robot does not pass it on: slot python is empty")
        other = partner(robot)
        await asyncio.sleep(2)
        assert [board.call(ASK, one, number(one), 500.0) for one in range(MOST_CALLS + 1)] == [
            *[""] * MOST_CALLS,
            "MSBOT_PART_CALLS calls wait for replies already: call more slowly",
        ]
        await asyncio.sleep(0.5)
        assert [(one, text(reply)) for one, reply in board.ended] == [
            (one, f"it is {one}") for one in range(MOST_CALLS)
        ]
        board.ended.clear()
        board.call(ASK, 7, number(-1))
        board.call(ASK, 8, b"")
        await asyncio.sleep(0.5)
        assert board.ended[0] == (7, "refused: negative numbers have no name here")
        assert str(board.ended[1][1]).startswith("the part that serves it cannot read the request: ")
        later: list[Callable[[bytes], None]] = []

        def serve_later(_binding: object, _request: bytes, *, stopped: bool, reply: Callable[[bytes], None]) -> bool:
            later.append(reply)
            return not stopped

        services = other._runner._services
        serve, services.serve = services.serve, serve_later  # type: ignore[assignment]
        board.call(ASK, 12, number(1), 60.0)
        await asyncio.sleep(0.5)
        services.serve = serve  # type: ignore[method-assign]
        robot.master.say_stop("ann")
        await asyncio.sleep(0.5)
        later[0](encode_reply(ReplyStatus.DONE, Text(text="late").encode()))
        board.call(ASK, 9, number(1))
        await asyncio.sleep(0.5)
        assert board.ended[2:] == [(one, "STOP is in force: call again after GO") for one in (12, 9)]
        robot.master.say_go("ann")
        await asyncio.sleep(0.5)
        board.ended.clear()
        membership = other._runner._membership
        assert membership is not None
        membership.client._on_request = lambda *_: None
        board.call(ASK, 10, number(1), 0.75)
        board.call(ASK, 11, number(1), 500.0)
        await asyncio.sleep(0.7)
        assert board.ended == []
        await asyncio.sleep(0.3)
        assert board.ended == [(10, "no reply in time: is the part there that serves it?")]
        other.end()
        await asyncio.sleep(0.5)
        assert board.ended[1:] == [(11, "the part that served it has left, or is held")]
        assert board.dropped == (0, 0, 0)

    play(tmp_path, scene, codec=codec, changes=ROBOT)


def test_a_held_board_and_one_that_loses_its_robot(firmware: Firmware, tmp_path: Path, types: None) -> None:
    async def scene(robot: Robot) -> None:
        board = plug(robot, firmware)
        other = partner(robot)
        await asyncio.sleep(3)
        inventory, now = robot.master.inventory, asyncio.get_running_loop().time()
        key = next(info.client_key for info in inventory.view(now) if info.part_number == "BRAIN-C")
        inventory._index.sessions[key].pupil = "ben"
        inventory.pupil_parts.pupils.freeze = Freeze("ann", "look", now)
        inventory.pupil_parts.follow(now)
        robot.master.agent.recheck(key)
        await asyncio.sleep(0.5)
        board.call(ASK, 1, number(1), 500.0)
        await asyncio.sleep(0.5)
        assert board.ended == [(1, "the robot does not pass it on: the class is frozen by ann: look")]
        inventory.pupil_parts.pupils.freeze = None
        inventory.pupil_parts.follow(now)
        robot.master.agent.recheck(key)
        membership = other._runner._membership
        assert membership is not None
        membership.client._on_request = lambda *_: None
        board.call(ASK, 2, number(1), 500.0)
        await asyncio.sleep(1)
        await robot.kill_master()
        await asyncio.sleep(5)
        assert board.ended[1:] == [(2, "the part is not active any more")]
        await robot.new_master()
        await asyncio.sleep(5)
        assert board.call(ASK, 3, number(4), 20.0) == ""
        await asyncio.sleep(1)

    play(tmp_path, scene, changes=ROBOT)


def test_it_serves(firmware: Firmware, tmp_path: Path, types: None) -> None:
    async def scene(robot: Robot) -> None:
        board = plug(robot, firmware)
        other = partner(robot)
        log: list[object] = []
        await asyncio.sleep(3)

        async def ask(request: Number | bytes) -> object:
            octets = request if isinstance(request, bytes) else request.encode()  # also what no Python part sends
            with mock.patch.object(Number, "encode", return_value=octets):
                other.call("way", Number(value=0.0), on_reply=lambda reply, error: log.append(error or reply))
            await asyncio.sleep(0.3)
            return log.pop()

        assert await ask(Number(value=2.0)) == Number(value=2.0)
        assert board.asked == [(HALVE, number(2.0))]
        assert await ask(b"refuse") == f"call of way: refused: {'w' * 180}"
        assert await ask(b"no") == "call of way: refused"
        assert await ask(b"large") == "call of way: the function that serves it failed"
        assert str(await ask(b"x" * 212)).startswith("call of way: the reply cannot be read as Number: ")
        robot.master.say_stop("ann")
        await asyncio.sleep(0.5)
        served = len(board.asked)
        assert await ask(Number(value=1.0)) == "call of way: STOP is in force: call again after GO"
        assert len(board.asked) == served
        robot.master.say_go("ann")
        await asyncio.sleep(0.5)
        robot.pull(board)
        await asyncio.sleep(10)
        assert await ask(Number(value=1.0)) == "call of way: the robot does not pass it on: slot brain is empty"
        board = plug(robot, firmware, serves=False)
        await asyncio.sleep(3)
        words = "call of way: the program of the part has no function for it: write @part.serves(...)"
        assert await ask(Number(value=1.0)) == words

    play(tmp_path, scene, changes=ROBOT)


@pytest.mark.parametrize(
    ("described", "words"),
    [
        (BOARD, "all is well"),
        (replace(BOARD, uid=bytes(8)), "can.uid is all zero"),
        (replace(BOARD, part_number="n" * 200), "together they are too long for MSBOT_XRCE_MTU"),
        (replace(BOARD, key=bytes(15)), "key_size must be 16 to 64"),
        (replace(BOARD, random=0), "random must not be 0"),
        (
            replace(BOARD, ports=tuple((PUBLISHES, f"p{one}", "Switch") for one in range(8))),
            "port_count is more than MSBOT_PART_PORTS",
        ),
        (replace(BOARD, ports=(*PORTS, PORTS[0])), "or two have the same name"),
        (replace(BOARD, ports=((SERVES, "halve", "Number"),)), "no type or a wrong one"),
        (replace(BOARD, ports=((PUBLISHES, "halve", "Number -> Number"),)), "no type or a wrong one"),
        (replace(BOARD, ports=((9, "halve", "Number"),)), "no type or a wrong one"),
    ],
)
def test_init_names_what_is_wrong(firmware: Firmware, described: Described, words: str) -> None:
    (error,) = firmware.ask(b"A" + described.octets(500_000))
    (said,) = firmware.ask(b"W" + error)
    assert words in said.decode()
