"""What ticks belongs to who did it: three pupils at one robot, right to the tick."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from msbot.operations.dispatch import InProcessOperations
from msbot.operations.rights import Principal, Role
from msbot.registry.lesson_ticks import BEGUN, Tick
from msbot_school.lessons.catalog import LessonCatalog
from msbot_school.lessons.check_authors import Doing
from msbot_school.lessons.lesson_run import NOBODY, Hand, LessonRun
from msbot_school.lessons.progress import csv_of, progress_of
from tests.lessons.lesson_stage import LessonStage, lesson_scene
from tests.lessons.made_up_robot import Robot
from tests.lessons.test_run import check, run

ADA, BEN = Hand(Doing.OWN), Hand(None, "Ben")
PROMISE = "What ticks in a lesson belongs to the person who did it"


@pytest.mark.promise(PROMISE)
def test_what_somebody_else_did_ticks_only_when_one_has_done_it_oneself() -> None:
    done, robot = run((check("1.1", "knob is active"),)), Robot({"knob": "active"})
    assert done.evaluate(robot, 0.0, lambda _: BEN) == []
    assert done.ticks_of_others("1.1") == "Ben"
    assert done.evaluate(robot, 1.0, lambda _: ADA) == [], "a touch is not yet the deed"
    robot.states["knob"] = "lost"
    assert done.evaluate(robot, 2.0, lambda _: ADA) == []
    robot.states["knob"] = "active"
    assert [one.by for one in done.evaluate(robot, 3.0, lambda _: ADA)] == [ADA]
    assert done.ticks_of_others("1.1") == ""


@pytest.mark.promise(PROMISE)
def test_what_others_have_moved_is_not_remembered() -> None:
    done, robot = run((check("1.1", "knob.level spans 50"),)), Robot(numbers={"knob.level": 0.0})
    done.evaluate(robot, 0.0, lambda _: NOBODY)
    for level in (60.0, 5.0, 90.0):
        robot.numbers["knob.level"] = level
        assert done.evaluate(robot, 1.0, lambda _: BEN) == []
    robot.numbers["knob.level"] = 60.0
    assert done.evaluate(robot, 2.0, lambda _: ADA) == []
    robot.numbers["knob.level"] = 5.0
    assert [one.by for one in done.evaluate(robot, 3.0, lambda _: ADA)] == [ADA]


@pytest.mark.promise(PROMISE)
def test_who_comes_after_something_held_by_anothers_hand_does_not_get_it() -> None:
    done, robot = run((check("1.1", "knob was lost"),)), Robot({"knob": "lost"})
    assert done.evaluate(robot, 0.0, lambda _: BEN) == []
    robot.states["knob"] = "active"
    assert done.evaluate(robot, 1.0, lambda _: ADA) == [], "it was Ben who had it lost"


def test_a_question_waits_for_the_robot_only() -> None:
    lesson = LessonCatalog().get("first_part")
    robot = Robot({"fan": "active", "knob": "empty"})
    done = LessonRun(lesson, 0.0)
    assert [one.check.name for one in done.evaluate(robot, 0.0)] == ["1.1"]
    robot.states["knob"] = "active"
    done.evaluate(robot, 1.0)
    assert [one.check.name for one in done.evaluate(robot, 5.0)] == ["2.1"]
    assert done.answer("1.2", "ten", 6.0)
    assert done.ticked == {"1.1": 0.0, "1.2": 6.0, "2.1": 5.0}


def pupil(stage: LessonStage, name: str) -> Principal:
    return Principal(name, lambda _right: None, lambda right: right.least.value <= Role.STUDENT.value)


def play(stage: LessonStage, who: str, *, plugged: bool) -> None:
    """Plug the knob in, or pull it out, as the page does it for a person."""
    (stage.robot.plug if plugged else stage.robot.unplug)("knob")
    stage.operations.acts.note(who, ["knob"])


def turn(stage: LessonStage, who: str, level: float) -> None:
    stage.turn("knob", "knob", level)
    stage.operations.acts.note(who, ["knob"])


async def swing(stage: LessonStage, who: str) -> None:
    for level in (5.0, 95.0):
        turn(stage, who, level)
        await asyncio.sleep(1)


@pytest.mark.promise(PROMISE)
def test_a_class_of_three_at_one_robot(tmp_path: Path) -> None:
    async def scene(stage: LessonStage) -> None:
        operations: InProcessOperations = stage.operations
        operations.pupils.use_people(lambda: ("Ada", "Ben", "Cleo"))
        await operations.do("group", who="Ms Novak", group="Red", pupils=["Ada", "Ben"], slots=[])
        await operations.do("start_lesson", who="Ms Novak", lesson="first_part")
        for name in ("Ada", "Ben", "Cleo"):
            await operations.do("join_lesson", who=pupil(stage, name))
        await asyncio.sleep(10)
        assert await kept(stage, "Cleo") == {BEGUN: "own", "1.1": "robot"}
        await operations.do("answer_lesson", who=pupil(stage, "Ada"), check="1.2", answer="ten slots")
        play(stage, "Ada", plugged=True)
        await asyncio.sleep(8)
        assert await kept(stage, "Ada") == {BEGUN: "own", "1.1": "robot", "1.2": "own", "2.1": "own"}
        assert await kept(stage, "Ben") == {BEGUN: "own", "1.1": "robot", "2.1": "group Ada"}
        assert await kept(stage, "Cleo") == {BEGUN: "own", "1.1": "robot"}
        assert stage.desk.hint_now("Cleo") is not None
        await swing(stage, "Ben")
        assert (await kept(stage, "Ben"))["3.1"] == "own"
        assert (await kept(stage, "Ada"))["3.1"] == "group Ben"
        play(stage, "Cleo", plugged=False)
        await asyncio.sleep(10)
        assert (await kept(stage, "Ada")).keys() == {BEGUN, "1.1", "1.2", "2.1", "3.1"}, "Cleo pulled it out"
        play(stage, "Cleo", plugged=True)
        await asyncio.sleep(8)
        assert (await kept(stage, "Cleo"))["2.1"] == "own"
        turn(stage, "Ms Novak", 50.0)  # a teacher who shows it has not done it for anybody
        await asyncio.sleep(1)
        turn(stage, "Ms Novak", 0.0)
        await asyncio.sleep(1)
        assert "3.1" not in await kept(stage, "Cleo")
        found = progress_of(stage.registry.lesson_ticks.all(), [LessonCatalog().get("first_part")])
        assert [(one.person, one.ticked, one.own, one.group, one.robot, one.partners) for one in found] == [
            ("Ada", 4, 2, 1, 1, ("Ben",)),
            ("Ben", 3, 1, 1, 1, ("Ada",)),
            ("Cleo", 2, 1, 0, 1, ()),
            ("Ms Novak", 1, 0, 0, 1, ()),
        ]
        assert csv_of(found).splitlines()[1].startswith("Ada,first_part,4,8,2,1,0,1,Ben,")

    lesson_scene(tmp_path, scene)


async def kept(stage: LessonStage, person: str) -> dict[str, str]:
    """What the database has of a person's ticks: whose hand each was."""
    await asyncio.sleep(0.5)  # this clock stands still until what was begun in threads is done
    assert stage.registry.storage.flush(60.0)
    ticks = [tick for tick in stage.registry.lesson_ticks.all() if tick.person == person]
    return {tick.check: f"{tick.doing} {tick.by}".strip() for tick in ticks}


@pytest.mark.promise(PROMISE)
def test_who_comes_late_gets_nothing_that_was_done_before(tmp_path: Path) -> None:
    async def scene(stage: LessonStage) -> None:
        await stage.do("start_lesson", lesson="first_part")
        await asyncio.sleep(10)
        play(stage, "Ada", plugged=True)
        await asyncio.sleep(8)
        await stage.do("answer_lesson", check="1.2", answer="10")
        assert len(await kept(stage, "Ada")) == 4
        await stage.operations.do("join_lesson", who=pupil(stage, "Ben"))
        await asyncio.sleep(8)
        assert await kept(stage, "Ben") == {BEGUN: "own"}

    lesson_scene(tmp_path, scene)


def test_what_a_pupil_may_not_do_a_teacher_does_and_it_says_so(tmp_path: Path) -> None:
    async def scene(stage: LessonStage) -> None:
        await stage.operations.do("start_lesson", who="Ms Novak", lesson="own_message")
        await stage.operations.do("join_lesson", who=pupil(stage, "Ada"))
        await stage.operations.do("answer_lesson", who=pupil(stage, "Ada"), check="1.1", answer="Celsius, rain")
        stage.run_program("own_message")
        await asyncio.sleep(3)
        await stage.do("adopt", "Ms Novak", part="WEATHER-1")
        await stage.do("bind", "Ms Novak", topic="weather", type="Weather", **{"from": "weather_1.weather"})
        await asyncio.sleep(8)
        ticks = await kept(stage, "Ada")
        assert ticks["1.1"] == "own"
        assert ticks["2.1"] in ("helped Ms Novak", "robot")
        assert ticks["2.2"] == "helped Ms Novak"

    lesson_scene(tmp_path, scene)


def test_what_is_refused_is_no_deed(tmp_path: Path) -> None:
    async def scene(stage: LessonStage) -> None:
        stage.operations.acts.note("Ada", ["knob"])
        assert await stage.refused("set", "Ben", slot="knob", name="nonsense", value=1)
        act = stage.operations.acts.latest(["knob"])
        assert act is not None
        assert act.who == "Ada"
        await stage.do("set", "Ben", slot="knob", name="period_s", value=0.5)
        act = stage.operations.acts.latest(["knob"])
        assert act is not None
        assert (act.who, act.helps) == ("Ben", False)

    lesson_scene(tmp_path, scene)


def test_the_first_own_deed_replaces_what_the_group_did(tmp_path: Path) -> None:
    async def scene(stage: LessonStage) -> None:
        note = stage.registry.lesson_ticks.note
        note(["Ada"], "ring", "1.1", 5, doing=Doing.GROUP.value, by="Ben")
        note(["Ada"], "ring", "1.1", 6, doing=Doing.ROBOT.value)
        assert stage.registry.lesson_ticks.all() == [Tick("Ada", "ring", "1.1", 5, "group", "Ben")]
        note(["Ada"], "ring", "1.1", 7)
        note(["Ada"], "ring", "1.1", 8)
        assert stage.registry.lesson_ticks.all() == [Tick("Ada", "ring", "1.1", 7)]

    lesson_scene(tmp_path, scene)
