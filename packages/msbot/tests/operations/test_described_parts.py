"""Parts that say what they are: adopted with one operation, refused with the reason, forgotten again."""

from __future__ import annotations

import asyncio
from contextlib import AbstractContextManager
from pathlib import Path
from random import Random
from unittest import mock

import pytest

from msbot import Angle, Level, Light, Message, Part, Speed, float32
from msbot.config import load_library
from msbot.part.join.joining import JoinState
from msbot.part.join.pnp_messages import DescriptionMessage
from msbot.part.join.refusal import DESCRIBE_IT, IS_TOLD, Refusal
from msbot.pnp import PartState
from msbot_xrce.messages import STREAM_RELIABLE
from tests.operations.stage import Stage, play

WAIT_S = 3.0
"""A refused part claims again every 2 s."""
MINE = """number = "VANE-1"
name = "Vane"
[[port]]
name = "light"
direction = "publish"
type = "Light"
"""


class Wind(Message):
    """A message that no library knows."""

    units = {"speed": "m/s"}  # noqa: RUF012 - as students write it
    speed: float32


def vane(number: str = "VANE-1", **more: str) -> tuple[Part, list[float]]:
    """A part with a port each way, a setting, and a message of its own; and the levels that it was told."""
    part = Part(number, uid=b"vane....", random=Random(4), describes=more.get("name", "Weather vane"))
    told: list[float] = []
    part.publishes("wind", Wind)
    part.publishes("light", Light)

    @part.on("brake", Level, safe=Level(percent=100))
    def brake(level: Level) -> None:
        told.append(level.percent)

    @part.every("period_s", default=0.5)
    def measure() -> None:
        if part.bound("wind"):
            part.publish("wind", Wind(speed=3.5))

    return part, told


def run(stage: Stage, part: Part) -> asyncio.Task[None]:
    assert stage.tasks is not None
    return stage.tasks.create_task(part.run_async(stage.connect(), epoch_ns=lambda: 0))


def test_a_part_that_the_robot_does_not_know_says_whether_it_can_be_adopted(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO", "msbot.part")

    async def scene(stage: Stage) -> None:
        mute = Part("MUTE-1", uid=b"mute....", random=Random(8))
        mute.publishes("light", Light)
        tasks = [run(stage, part) for part in (vane()[0], mute)]
        await asyncio.sleep(WAIT_S)
        said = [one.getMessage() for one in caplog.records]
        unknown = Refusal.UNKNOWN_PART.describe
        assert said.count(IS_TOLD) == 1
        assert f"VANE-1 is refused: {unknown}" in said
        assert f"MUTE-1 is refused: {unknown}; {DESCRIBE_IT}" in said
        for task in tasks:
            task.cancel()

    play(tmp_path, scene)


def test_one_operation_makes_type_slot_and_offers_and_lets_the_part_in(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        part, told = vane()
        task = run(stage, part)
        await asyncio.sleep(WAIT_S)
        says = stage.info("VANE-1").says
        assert says is not None
        assert says.described is not None
        assert says.described.part_type.name == "Weather vane"
        assert part.state is JoinState.REFUSED
        assert any("it describes itself: Weather vane" in line for line in stage.master.why("VANE-1"))
        done = await stage.do.adopt("VANE-1", who="ann")
        assert done.words == (
            "VANE-1 (Weather vane) is in the library now, as the part describes it, and has slot vane_1"
        )
        await asyncio.sleep(0.5)
        assert (part.state, part.slot, dict(part.settings)) == (JoinState.ACTIVE, "vane_1", {"period_s": "0.5"})
        part_type = load_library(tmp_path / "adopted").get("VANE-1")
        assert part_type is not None
        assert part_type.origin == f"said by the part {b'vane....'.hex()}, adopted by ann"
        assert [port.name for port in part_type.ports] == ["wind", "light", "brake"]
        assert part_type.ports[2].safe == {"percent": 100.0}
        assert done.answer == {
            "slot": "vane_1",
            "offers": [],
            "for_people": [
                {"topic": name, "type": kind, "from": f"vane_1.{name}", "to": []}
                for name, kind in (("wind", "Wind"), ("light", "Light"))
            ],
            "by_hand": [{"topic": "brake", "type": "Level", "from": "", "to": ["vane_1.brake"]}],
        }
        await stage.do.bind("wind", "Wind", "vane_1.wind", (), reliable=True, who="ann")
        await stage.do.bind("brake", "Level", None, ("vane_1.brake",), reliable=True, who="ann")
        await asyncio.sleep(0.5)
        assert part.bound("wind")
        await stage.do.stop("", who="ann")
        await asyncio.sleep(0.5)
        assert told == [100.0], "its safe value came from its own words"
        await stage.do.go(who="ann")
        part.end()
        await task
        await stage.do.remove_slot("vane_1", who="ann")
        await stage.do.forget_type("VANE-1", who="ann")
        assert not list((tmp_path / "adopted").iterdir())

    play(tmp_path, scene)


def test_wires_of_services_are_offered_from_the_part_that_serves_to_the_one_that_calls(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        eye = Part("EYE-1", uid=b"eye.....", random=Random(5), describes="Eye")
        eye.serves("look", Angle, Light)(lambda _: Light(lux=4))
        brain = Part("BRAIN-1", uid=b"brain...", random=Random(6), describes="Brain")
        brain.calls("see", Angle, Light)
        offers = {}
        tasks = []
        for part in (eye, brain):
            tasks.append(run(stage, part))
            await asyncio.sleep(WAIT_S)
            done = await stage.do.adopt(part.part_number, who="ann")
            offers[part.part_number] = (done.answer["offers"], done.answer["for_people"])
        alone = {"topic": "look", "type": "Angle -> Light", "from": "eye_1.look", "to": []}
        fits = {"topic": "eye_1_look", "type": "Angle -> Light", "from": "eye_1.look", "to": ["brain_1.see"]}
        assert offers == {"EYE-1": ([], [alone]), "BRAIN-1": ([fits], [])}
        await stage.do.bind(fits["topic"], fits["type"], fits["from"], fits["to"], who="ann")
        await asyncio.sleep(0.5)
        seen: list[object] = []
        brain.call("see", Angle(degrees=1), on_reply=lambda reply, error: seen.append(error or reply.lux))
        await asyncio.sleep(0.5)
        assert seen == [4.0]
        for part in (eye, brain):
            part.end()
        await asyncio.gather(*tasks)

    play(tmp_path, scene)


def drive(number: str, uid: bytes, **settings: float) -> tuple[Part, list[float]]:
    """A part of some maker that turns something; and the angles that it was told."""
    part = Part(number, uid=uid, random=Random(4), describes=number.partition(":")[2])
    told: list[float] = []
    part.publishes("position", Angle)
    for name, default in settings.items():
        part.on_setting(name, float, default=default, least=0, most=100)(lambda _value: None)
    part.on("angle", Angle, safe=Angle(degrees=0))(lambda angle: told.append(angle.degrees))
    return part, told


def test_a_spare_of_another_maker_takes_over_a_slot_after_it_was_said_what_is_lost(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        first, _ = drive("acme:drive", b"acme....", speed=20, torque=5)
        first.publishes("turns", Speed)
        second, told = drive("zeta:servo", b"zeta....", speed=30)
        tasks = [run(stage, first)]
        await asyncio.sleep(WAIT_S)
        await stage.do.adopt("acme:drive", "arm", who="ann")
        await stage.do.bind("arm_angle", "Angle", None, ("arm.angle",), reliable=True, who="ann")
        await stage.do.set("arm", "speed", "44", who="ann")
        tasks.append(run(stage, second))
        await asyncio.sleep(WAIT_S)
        lost = await stage.refusal(stage.do.spare("arm", "zeta:servo", who="ann"))
        assert lost == (
            "if zeta:servo (zeta:servo) fills slot arm, this is lost: ports turns; settings torque; if that is right, "
            "say so: --agreed"
        )
        assert second.state is JoinState.REFUSED
        await stage.do.spare("arm", "zeta:servo", True, who="ann")
        await asyncio.sleep(WAIT_S)
        assert stage.info("zeta:servo").state is PartState.STANDBY
        kept = load_library(tmp_path / "adopted").require("zeta:servo")
        assert (kept.compatible_with, kept.lacks) == (("acme:drive",), ("turns",))
        assert "fits slot arm already" in await stage.refusal(stage.do.spare("arm", "zeta:servo", who="ann"))
        first.end()
        await tasks[0]
        await asyncio.sleep(WAIT_S)
        assert (second.state, second.slot, second.settings["speed"]) == (JoinState.ACTIVE, "arm", "44")
        assert second.bound("angle")
        await stage.do.publish("arm.angle", ["12"], who="ann")
        await asyncio.sleep(2)
        assert told[-1] == 12.0
        second.end()
        await tasks[1]

    play(tmp_path, scene)


def test_a_wired_port_that_a_spare_has_not_is_no_matter_of_agreement(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        part, _ = drive("zeta:servo", b"zeta....", speed=30)
        task = run(stage, part)
        await asyncio.sleep(WAIT_S)
        words = await stage.refusal(stage.do.spare("AA", "zeta:servo", True, who="ann"))
        assert words.startswith("zeta:servo (zeta:servo) cannot fill slot AA: its ports ")
        part.end()
        await task

    play(tmp_path, scene)


def averager(*fields: str) -> Part:
    """A part that serves with a message of its own, which has these fields."""
    samples = type("Samples", (Message,), {"__annotations__": dict.fromkeys(fields, float32)})
    part = Part("AVG-1", uid=b"average.", random=Random(7), describes="Averager")
    part.serves("mean", samples, Light)(lambda request: Light(lux=request.first))
    return part


def test_who_changes_a_message_of_his_own_is_told_the_commands_that_take_it_and_they_do(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        task = run(stage, first := averager("first"))
        await asyncio.sleep(WAIT_S)
        await stage.do.adopt("AVG-1", who="ann")
        await asyncio.sleep(WAIT_S)
        command = "msbot bind mean --type 'Samples -> Light' --from avg_1.mean"
        missing = f"nobody can call it before `{command}`; this robot binds no port of the part"
        assert stage.operations.showing.why("avg_1").answer["troubles"] == [f"its program says: port 'mean': {missing}"]
        await stage.do.bind("mean", "Samples -> Light", "avg_1.mean", (), who="ann")
        assert stage.operations.showing.why("avg_1").answer["troubles"] == []
        first.end()
        await task
        task = run(stage, part := averager("first", "second"))
        await asyncio.sleep(WAIT_S)
        assert part.state is JoinState.ACTIVE
        call = stage.do.call("avg_1.mean", ["1"], who="ann")
        assert (await stage.refusal(call)).endswith(": msbot why avg_1 says what to do")
        words = "if the program is right: msbot adopt avg_1; the wires that still fit stay"
        assert stage.master.why("avg_1").count(words) == 1
        done = await stage.do.adopt("avg_1", who="ann")
        assert done.words == "AVG-1 is in the library now as its part describes it; its wires stay"
        await asyncio.sleep(WAIT_S)
        done = await stage.do.call("avg_1.mean", ["3", "4"], who="ann")
        assert done.answer["reply"] == {"lux": 3.0}
        assert not [line for line in stage.master.why("avg_1") if "if the program is right" in line]
        part.end()
        await task

    play(tmp_path, scene)


def test_a_part_that_is_adopted_anew_keeps_the_wires_of_ports_that_are_as_before(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        task = run(stage, first := vane()[0])
        await asyncio.sleep(WAIT_S)
        await stage.do.adopt("VANE-1", who="ann")
        assert "is in slot vane_1 already" in await stage.refusal(stage.do.adopt("VANE-1", who="ann"))
        for port in ("wind", "light"):
            await stage.do.bind(port, "", f"vane_1.{port}", (), who="ann")
        await stage.do.bind("brake", "Level", None, ("vane_1.brake",), who="ann")
        first.end()
        await task
        other = Part("VANE-1", uid=b"vane....", random=Random(5), describes="Weather vane")
        other.publishes("wind", Wind)
        other.publishes("light", Speed)
        other.publishes("gust", Wind)
        task = run(stage, other)
        await asyncio.sleep(WAIT_S)
        assert other.state is JoinState.ACTIVE
        words = await stage.refusal(stage.do.bind("gust", "Wind", "vane_1.gust", (), who="ann"))
        assert words.endswith("; if its program has it now: msbot adopt vane_1")
        done = await stage.do.adopt("vane_1", who="ann")
        assert done.words == (
            "VANE-1 is in the library now as its part describes it; its wires stay, but for vane_1.light (topic light: "
            "it carries Speed now), vane_1.brake (topic brake: the port is gone)"
        )
        assert done.answer["lost"] == [
            {"topic": "light", "port": "vane_1.light"},
            {"topic": "brake", "port": "vane_1.brake"},
        ]
        for_people = done.answer["for_people"]
        assert isinstance(for_people, list)
        assert [wire["from"] for wire in for_people] == ["vane_1.light", "vane_1.gust"]
        await asyncio.sleep(0.5)
        assert (other.state, other.slot, other.bound("wind"), other.bound("light")) == (
            JoinState.ACTIVE,
            "vane_1",
            True,
            False,
        )
        part_type = load_library(tmp_path / "adopted").require("VANE-1")
        assert [port.name for port in part_type.ports] == ["wind", "light", "gust"]
        assert len(list((tmp_path / "adopted").iterdir())) == 1
        assert "describes itself as before" in await stage.refusal(stage.do.adopt("vane_1", who="ann"))
        other.end()
        await task

    play(tmp_path, scene)


def test_a_part_in_the_robot_that_does_not_say_what_it_is_stays_as_it_was(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        task = run(stage, first := vane()[0])
        await asyncio.sleep(WAIT_S)
        await stage.do.adopt("VANE-1", who="ann")
        await stage.do.bind("wind", "", "vane_1.wind", (), who="ann")
        first.end()
        await task
        mute = Part("VANE-1", uid=b"vane....", random=Random(6))
        mute.publishes("wind", Wind)
        task = run(stage, mute)
        await asyncio.sleep(WAIT_S)
        words = await stage.refusal(stage.do.adopt("vane_1", who="ann"))
        assert words.startswith("VANE-1 does not say what it is: run its program with describes=")
        assert mute.bound("wind")
        mute.end()
        await task
        with say(MINE.replace('"Light"', '"Lihgt"')):
            task = run(stage, wrong := vane()[0])
            await asyncio.sleep(WAIT_S)
            words = await stage.refusal(stage.do.adopt("vane_1", who="ann"))
        assert 'there is no message type "Lihgt"' in words
        assert [port.name for port in load_library(tmp_path / "adopted").require("VANE-1").ports] == [
            "wind",
            "light",
            "brake",
        ]
        wrong.end()
        await task

    play(tmp_path, scene)


def test_a_forgotten_type_can_be_described_anew(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        for name, shown in (("first", "VANE-1 (first)"), ("VANE-1", "VANE-1")):
            part, _ = vane(name=name)
            task = run(stage, part)
            await asyncio.sleep(WAIT_S)
            done = await stage.do.adopt("VANE-1", "eye", who="ann")
            assert done.words == f"{shown} is in the library now, as the part describes it, and has slot eye"
            await asyncio.sleep(0.5)
            assert part.slot == "eye"
            assert load_library(tmp_path / "adopted").require("VANE-1").name == name
            assert "has slots: eye" in await stage.refusal(stage.do.forget_type("VANE-1", who="ann"))
            part.end()
            await task
            await stage.do.remove_slot("eye", who="ann")
            await stage.do.forget_type("VANE-1", who="ann")
        assert "was not adopted" in await stage.refusal(stage.do.forget_type("ABCD", who="ann"))

    play(tmp_path, scene)


def say(text: str) -> AbstractContextManager[object]:
    """Whatever parts declare, they say this."""
    return mock.patch("msbot.part.part.describe", return_value=text.ljust(540))


def test_what_is_wrong_is_refused_with_the_reason_and_nothing_is_written(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        part, _ = vane()
        task = run(stage, part)
        await asyncio.sleep(WAIT_S)
        says = stage.info("VANE-1").says
        assert says is not None
        assert says.described is None
        for words in (says.fault, *stage.master.why("VANE-1")[-1:]):
            assert 'there is no message type "Lihgt"; did you mean "Light"' in words
        assert says.fault in await stage.refusal(stage.do.adopt("VANE-1", who="ann"))
        assert not (tmp_path / "adopted").exists()
        part.end()
        await task

    with say(MINE.replace('"Light"', '"Lihgt"')):
        play(tmp_path, scene)


def test_who_claims_a_known_number_is_not_asked_and_what_it_says_does_not_count(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        part, _ = vane("ABCD")
        task = run(stage, part)
        await asyncio.sleep(WAIT_S)
        assert stage.info("ABCD").says is None
        membership = part._runner._membership
        assert membership is not None
        for _ in range(3):
            membership._send(DescriptionMessage(text=MINE.ljust(540)).encode(), STREAM_RELIABLE)
        await asyncio.sleep(WAIT_S)
        assert stage.info("ABCD").says is None
        lines = [line for line in stage.master.why("ABCD") if "the library's entry of its number counts" in line]
        assert len(lines) == 1, "said once"
        part.end()
        await task

    play(tmp_path, scene)


def test_a_part_that_was_adopted_by_another_number_is_checked_again(tmp_path: Path) -> None:
    """Two parts describe the same number: the second is known by the time somebody adopts it."""

    async def scene(stage: Stage) -> None:
        parts = []
        for serial in (1, 2):
            part, _ = vane()
            part.uid = serial.to_bytes(8, "big")
            parts.append((part, run(stage, part)))
        await asyncio.sleep(WAIT_S)
        await stage.do.adopt("0000000000000001", who="ann")
        words = await stage.refusal(stage.do.adopt("0000000000000002", who="ann"))
        assert "the library knows VANE-1 already" in words
        await asyncio.sleep(WAIT_S)
        assert [part.state.value for part, _ in parts] == ["active", "refused"]
        for part, task in parts:
            part.end()
            await task

    play(tmp_path, scene)
