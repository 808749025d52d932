"""Every lesson that MsBOT brings, done from beginning to end: its checks tick in order, and only for what is right."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from math import hypot
from pathlib import Path

import pytest

from msbot_school.lessons.catalog import LessonCatalog
from msbot_school.lessons.lesson import Lesson
from tests import ROOT
from tests.lessons.lesson_stage import LessonStage, blocks_of_the_handbook, lesson_scene

BLOCKS = ROOT / "packages/msbot-web/tests/web/browser/blocks"
"""Programs as blocks write them; a test in the browser says that they do."""
PATIENCE_S = 60.0
"""Longest time until a check ticks after the right thing was done."""
LAP_S = 120.0
FAR_M = 0.5
NEAR_M = 0.15
LAP_SPEED = 2.0
"""The world runs so much quicker meanwhile: the pilot has half as many looks at the line for each metre."""
"""What once round is: that far from where the robot began, and back again."""
WRONG_S = 3.0
"""How long a wrong solution is left alone."""


@dataclass(frozen=True)
class Deed:
    """What is done for one check."""

    right: Callable[[LessonStage], Awaitable[None]]
    wrong: Callable[[LessonStage], Awaitable[None]] | None = None
    """Something else, that must not make it tick."""


async def nothing(stage: LessonStage) -> None:
    """It is so already, or comes by itself."""


def plug(slot: str) -> Callable[[LessonStage], Awaitable[None]]:
    async def do(stage: LessonStage) -> None:
        stage.parts.plug(slot)

    return do


def unplug(slot: str) -> Callable[[LessonStage], Awaitable[None]]:
    async def do(stage: LessonStage) -> None:
        stage.parts.unplug(slot)

    return do


def turned(*values: float) -> Callable[[LessonStage], Awaitable[None]]:
    async def do(stage: LessonStage) -> None:
        for value in values:
            stage.turn("knob", "knob", value)
            await asyncio.sleep(0.6)

    return do


def done(operation: str, **arguments: object) -> Callable[[LessonStage], Awaitable[None]]:
    async def do(stage: LessonStage) -> None:
        await stage.operations.do(operation, who="Ada", **arguments)

    return do


def several(*deeds: Callable[[LessonStage], Awaitable[None]]) -> Callable[[LessonStage], Awaitable[None]]:
    async def do(stage: LessonStage) -> None:
        for deed in deeds:
            await deed(stage)

    return do


def adopt(number: str) -> Callable[[LessonStage], Awaitable[None]]:
    async def do(stage: LessonStage) -> None:
        stage.run_program({"WEATHER-1": "own_message", "BLINK-1": "own_part_type"}[number])
        await asyncio.sleep(3)
        await stage.do("adopt", part=number)

    return do


def in_program(number: str) -> Callable[[LessonStage], Awaitable[None]]:
    """Run it, and do not adopt it."""

    async def do(stage: LessonStage) -> None:
        stage.run_program({"WEATHER-1": "own_message", "BLINK-1": "own_part_type"}[number])
        await asyncio.sleep(3)
        stage.programs.pop().cancel()

    return do


def drive(old: str = "", new: str = "") -> Callable[[LessonStage], Awaitable[None]]:
    """Put the robot back on its line, and run the pilot of the lesson."""

    async def do(stage: LessonStage) -> None:
        await back_on_the_line(stage)
        stage.run_program("closing_the_loop", old, new)

    return do


async def drive_blocks(stage: LessonStage) -> None:
    """The same with the pilot that the handbook makes of blocks."""
    await back_on_the_line(stage)
    stage.run_text(blocks_of_the_handbook(), "blocks.py")


async def back_on_the_line(stage: LessonStage) -> None:
    for program in stage.programs:
        program.cancel()
    stage.programs.clear()
    await asyncio.sleep(2)
    assert stage.living is not None
    stage.living.reset()


async def once_round(stage: LessonStage) -> None:
    """Wait until the robot is where it began, having been far away."""
    assert stage.living is not None
    stage.living.speed = LAP_SPEED
    start, farthest = stage.living.arena.plan.robots[0].start, 0.0
    for _ in range(round(10 * LAP_S)):
        pose = stage.living.arena.poses()["robot"]
        away = hypot(pose.x - start[0], pose.y - start[1])
        if farthest > FAR_M and away < NEAR_M:
            stage.living.speed = 1.0
            return
        farthest = max(farthest, away)
        await asyncio.sleep(0.1)
    raise AssertionError(f"the robot does not come round: {pose}, {farthest:.2f} m away at most")


async def blink_blocks(stage: LessonStage) -> None:
    """The blinking light of blocks, with the setting that the lesson has one type."""
    text = (BLOCKS / "blink.txt").read_text()
    assert text.count("@part.every(0.5)") == 1
    stage.run_text(text.replace("@part.every(0.5)", '@part.every("period_s", default=0.5)'), "blocks.py")
    await asyncio.sleep(3)
    await stage.do("adopt", part="BLINK-1")


async def unplug_stand_in(stage: LessonStage) -> None:
    stage.operations.stand_ins.unplug("BB")


SOLVED: dict[str, dict[str, Deed]] = {
    "first_part": {
        "1.1": Deed(nothing),
        "2.1": Deed(plug("knob"), unplug("fan")),
        "3.1": Deed(turned(10.0, 90.0), turned(45.0, 55.0)),
        "4.1": Deed(unplug("knob"), unplug("ear")),
        "5.1": Deed(plug("knob"), plug("ear")),
    },
    "own_message": {
        "2.1": Deed(adopt("WEATHER-1"), in_program("WEATHER-1")),
        "2.2": Deed(nothing),
        "3.1": Deed(
            done("bind", topic="weather", type="Weather", **{"from": "weather_1.weather"}),
            done("identify", part="fan"),
        ),
    },
    "ring": {
        "1.1": Deed(nothing),
        "1.2": Deed(nothing),
        "2.1": Deed(plug("CC")),
        "2.2": Deed(nothing),
        "3.1": Deed(unplug("AA")),
        "4.1": Deed(plug("AA")),
    },
    "part_dies": {
        "1.1": Deed(turned(80.0), turned(60.0)),
        "2.1": Deed(done("stop"), done("identify", part="fan")),
        "3.1": Deed(done("go")),
        "4.1": Deed(unplug("knob"), unplug("ear")),
        "6.1": Deed(several(plug("knob"), lambda _: asyncio.sleep(2), turned(20.0, 80.0)), plug("ear")),
    },
    "spare": {
        "1.1": Deed(done("simulate", slot="BB")),
        "1.2": Deed(nothing),
        "2.1": Deed(unplug_stand_in),
        "2.2": Deed(nothing),
    },
    "bits_on_the_bus": {
        "1.1": Deed(turned(20.0, 60.0), turned(50.0, 52.0)),
        "2.1": Deed(
            several(
                done("set", slot="knob", name="period_s", value=0.02),
                done("set", slot="knob", name="change", value=0),
            ),
            done("set", slot="knob", name="period_s", value=0.02),
        ),
        "2.2": Deed(nothing),
        "3.1": Deed(
            done("reset", slot="knob", name="period_s"),
            done("reset", slot="knob", name="change"),
        ),
    },
    "closing_the_loop": {
        "1.1": Deed(nothing),
        "2.1": Deed(drive()),
        "3.1": Deed(drive("turn = 0", "turn = 30 * line.position"), drive("turn = 0", "turn = -30 * line.position")),
        "4.1": Deed(several(drive_blocks, once_round)),
        "5.1": Deed(done("stop"), done("identify", part="wheels")),
    },
    "own_part_type": {
        "1.1": Deed(adopt("BLINK-1"), in_program("BLINK-1")),
        "1.2": Deed(nothing),
        "2.1": Deed(
            done("bind", topic="headlight_on", type="Switch", **{"from": "blink_1.light"}, move=True),
        ),
        "2.2": Deed(nothing),
        "3.1": Deed(
            done("set", slot="blink_1", name="period_s", value=0.1),
            done("set", slot="blink_1", name="period_s", value=1.0),
        ),
    },
}
"""What is done for each check that is no question."""

WITH_BLOCKS: dict[str, dict[str, Deed]] = {
    "own_part_type": {"1.1": Deed(blink_blocks, in_program("BLINK-1"))},
}
"""What is done otherwise by whoever puts blocks together where a lesson has one write a program."""


def test_every_lesson_is_solved_here() -> None:
    lessons, wrong = LessonCatalog().all()
    assert wrong == []
    assert {lesson.name for lesson in lessons} == set(SOLVED)
    for lesson in lessons:
        deeds = {check.name for check in lesson.checks if check.question is None}
        assert deeds == set(SOLVED[lesson.name])


@pytest.mark.parametrize(
    ("name", "deeds"),
    [
        *(pytest.param(name, deeds, id=name) for name, deeds in sorted(SOLVED.items())),
        *(pytest.param(name, SOLVED[name] | deeds, id=f"{name} with blocks") for name, deeds in WITH_BLOCKS.items()),
    ],
)
def test_a_lesson_is_done_from_beginning_to_end_and_put_back(name: str, deeds: dict[str, Deed], tmp_path: Path) -> None:
    lesson = LessonCatalog().get(name)

    async def scene(stage: LessonStage) -> None:
        await all_done(stage, lesson, deeds)

    lesson_scene(tmp_path, scene, sample=lesson.robot, world=lesson.world)


NOT_WITHOUT_HARDWARE = {
    "bits_on_the_bus": "needs a robot on a simulated bus, whose load is known: ",
    "closing_the_loop": "needs a robot in the world line: ",
}
"""What is said before such a lesson begins at a class's robot without hardware."""


@pytest.mark.parametrize("name", sorted(SOLVED))
def test_a_lesson_at_a_class_s_robot_without_hardware(name: str, tmp_path: Path) -> None:
    lesson = LessonCatalog().get(name)

    async def scene(stage: LessonStage) -> None:
        obstacle = stage.desk.obstacle(lesson)
        if name in NOT_WITHOUT_HARDWARE:
            assert f"{lesson.title!r} {NOT_WITHOUT_HARDWARE[name]}" in obstacle
            assert f"`msbot demo --lesson {name}`" in obstacle
            assert await stage.refused("start_lesson", lesson=name) == obstacle
        else:
            assert obstacle == ""
            await all_done(stage, lesson, SOLVED[name])
        assert stage.operations.stand_ins.uids == frozenset(), "what a lesson begins it also ends"

    lesson_scene(tmp_path, scene, has_parts=False)


def test_a_slot_that_was_simulated_before_is_simulated_again_after_its_spare_took_over(tmp_path: Path) -> None:
    async def scene(stage: LessonStage) -> None:
        for slot in ("AA", "BB", "CC"):
            await stage.do("simulate", slot=slot)
        before = stage.operations.stand_ins.uids
        await all_done(stage, LessonCatalog().get("spare"), SOLVED["spare"])
        assert stage.operations.stand_ins.uids == before
        running = stage.operations.faults.running
        assert [running.state_of(slot) for slot in ("AA", "BB", "CC")] == 3 * ["active"]

    lesson_scene(tmp_path, scene, sample="thesis", has_parts=False)


async def all_done(stage: LessonStage, lesson: Lesson, deeds: Mapping[str, Deed]) -> None:
    """Do a lesson from its beginning to its end, and see that everything is put back."""
    blueprint = await stage.operations.applying.present()
    plugged = {slot: stage.robot.is_plugged(slot) for slot in stage.robot.names}
    await stage.do("start_lesson", lesson=lesson.name)
    slots = set(stage.operations.faults.running.slot_names())
    out = {slot for slot in slots.intersection(stage.parts.names) if not stage.parts.is_plugged(slot)}
    assert out == set(lesson.unplugged)
    expected: list[str] = []
    for check in lesson.checks:
        early = [name for name in await stage.ticked() if name > f"{check.name.split('.')[0]}.99"]
        assert not early, "the checks of a step tick after those of the steps before"
        if check.question is not None:
            assert await stage.refused("answer_lesson", check=check.name, answer="wrong")
            await stage.do("answer_lesson", check=check.name, answer=check.question.right[0])
        else:
            deed = deeds[check.name]
            if deed.wrong is not None:
                await deed.wrong(stage)
                await asyncio.sleep(WRONG_S + check.for_s)
                assert check.name not in await stage.ticked(), f"{check.name} ticks for the wrong solution"
            elif deed.right is not nothing:
                await asyncio.sleep(WRONG_S + check.for_s)
                assert check.name not in await stage.ticked(), f"{check.name} ticks by itself"
            await deed.right(stage)
            await until_ticked(stage, check.name)
        expected.append(check.name)
    assert (await stage.seen())["done"] is True
    said = await stage.do("stop_lesson")
    assert said == f"the lesson {lesson.title!r} is over; everything is as it was before"
    assert await stage.operations.applying.present() == blueprint
    assert {slot: stage.robot.is_plugged(slot) for slot in stage.robot.names} == plugged | {
        slot: stage.robot.is_plugged(slot) for slot in plugged if slot not in lesson.unplugged
    }
    assert await stage.operations.undoing.read(1000)
    await asyncio.sleep(1.0)  # this clock stands still until what was begun in threads is done
    assert stage.registry.storage.flush(60.0)
    kept = [tick.check for tick in stage.registry.lesson_ticks.all() if tick.person == "Ada"]
    assert sorted(kept) == ["", *expected]


async def until_ticked(stage: LessonStage, check: str) -> None:
    for _ in range(round(PATIENCE_S * 10)):
        if check in await stage.ticked():
            return
        await asyncio.sleep(0.1)
    raise AssertionError(f"{check} does not tick: {stage.desk.hint_now('Ada')}")
