"""A run of a lesson, without a robot: when checks tick, what is remembered, when a hint comes."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot.registry.lesson_ticks import Tick
from msbot_school.lessons.conditions import read_lesson_condition
from msbot_school.lessons.lesson import Lesson, LessonCheck, LessonQuestion, Step
from msbot_school.lessons.lesson_run import LessonRun
from msbot_school.lessons.progress import csv_of, progress_of
from msbot_xrce.errors import ConfigError
from tests.lessons.made_up_robot import Robot


def check(name: str, *texts: str, for_s: float = 0.0) -> LessonCheck:
    return LessonCheck(name, f"say {name}", tuple(read_lesson_condition(text) for text in texts), for_s, hint="look")


def run(*steps: tuple[LessonCheck, ...], hint_after_s: float = 60.0) -> LessonRun:
    return LessonRun(Lesson("l", "L", 45, 1, tuple(Step("", step) for step in steps), hint_after_s=hint_after_s), 0.0)


def test_a_check_ticks_after_its_time_and_stays() -> None:
    done, robot = run((check("1.1", "fan is active", for_s=2.0),)), Robot({"fan": "active"})
    assert done.evaluate(robot, 0.0) == []
    robot.states["fan"] = "late"
    assert done.evaluate(robot, 1.0) == []
    robot.states["fan"] = "active"
    assert done.evaluate(robot, 1.5) == []
    assert done.evaluate(robot, 3.4) == []
    assert [one.check.name for one in done.evaluate(robot, 3.5)] == ["1.1"]
    robot.states["fan"] = "lost"
    assert done.evaluate(robot, 9.0) == []
    assert done.ticked == {"1.1": 3.5}
    assert done.is_done


def test_a_step_waits_for_the_one_before_it_and_what_was_before_does_not_count() -> None:
    done, robot = run((check("1.1", "knob is active"),), (check("2.1", "knob was lost"),)), Robot({"knob": "lost"})
    done.evaluate(robot, 0.0)
    robot.states["knob"] = "active"
    assert [one.check.name for one in done.evaluate(robot, 1.0)] == ["1.1"]
    assert done.evaluate(robot, 2.0) == []  # it was lost before the step began
    robot.states["knob"] = "lost"
    assert [one.check.name for one in done.evaluate(robot, 3.0)] == ["2.1"]


@pytest.mark.parametrize(
    ("text", "wrong", "right"),
    [
        ("knob.level spans 50", Robot(numbers={"knob.level": 1.0}), Robot(numbers={"knob.level": 51.0})),
        ("wired a.x -> b.y", Robot(wires={("b.y", "a.x")}), Robot(wires={("a.x", "b.y")})),
        (
            "setting fan start_at >= 20",
            Robot(settings={("fan", "start_at"): "19"}),
            Robot(settings={("fan", "start_at"): "20.5"}),
        ),
        (
            "setting fan mode = slow",
            Robot(settings={("fan", "mode"): "fast"}),
            Robot(settings={("fan", "mode"): "slow"}),
        ),
        ("BB has DD", Robot(parts={"BB": "BB"}), Robot(parts={"BB": "DD"})),
        ("BB has another part", Robot(parts={"BB": "BB"}), Robot(parts={"BB": "EE"})),
        ("slot lamp exists", Robot(), Robot({"lamp": "empty"})),
        ("type LED exists", Robot(), Robot()),
        ("stopped", Robot(), Robot(is_stopped=True)),
        ("not stopped", Robot(is_stopped=True), Robot()),
        ("not fan is active", Robot({"fan": "active"}), Robot({"fan": "late"})),
        ("fan is empty", Robot({"fan": "active"}), Robot()),
        ("load > 4", Robot(numbers={"load": 4.0}), Robot(numbers={"load": 4.1})),
    ],
)
def test_each_condition_holds_for_what_is_right_only(text: str, wrong: Robot, right: Robot) -> None:
    done = run((check("1.1", text),))
    if text != "type LED exists":
        assert done.evaluate(wrong, 0.0) == []
        missing = done.missing(wrong)
        assert missing is not None
        assert missing.seen
    assert [one.check.name for one in done.evaluate(right, 1.0)] == ["1.1"]


def test_turning_counts_beyond_north_and_to_one_side_only() -> None:
    done, robot = run((check("1.1", "compass.heading turns 300"),)), Robot()
    for heading in (350.0, 10.0, 350.0, 80.0, 350.0, 240.0, 110.0):  # to and fro, through north, and on to the left
        robot.numbers["compass.heading"] = heading
        assert done.evaluate(robot, 0.0) == []
    missing = done.missing(robot)
    assert missing is not None
    assert missing.seen == "compass.heading has turned by 240"
    robot.numbers["compass.heading"] = 50.0
    assert [one.check.name for one in done.evaluate(robot, 1.0)] == ["1.1"]


def test_a_question_is_answered_in_its_turn() -> None:
    question = LessonCheck("1.2", "How many?", question=LessonQuestion(("3",)), hint="count")
    done, robot = run((check("1.1", "stopped"), question), (check("2.1", "not stopped"),)), Robot()
    assert done.answer("1.2", "4", 1.0) is False
    assert done.tries("1.2") == 1
    assert done.answer("1.2", "3.0", 2.0) is True
    with pytest.raises(ConfigError, match=r"no open question 1\.2 now"):
        done.answer("1.2", "3", 3.0)
    assert done.evaluate(robot, 3.0) == []  # the second step waits for STOP
    robot.is_stopped = True
    assert len(done.evaluate(robot, 4.0)) == 1
    assert not done.is_done


def test_a_hint_comes_when_nothing_has_ticked_for_long() -> None:
    done, robot = (
        run((check("1.1", "fan is active"), check("1.2", "stopped")), hint_after_s=30.0),
        Robot({"fan": "late"}),
    )
    done.evaluate(robot, 29.0)
    assert done.hint(robot, 29.0) is None
    hint = done.hint(robot, 30.0)
    assert hint is not None
    assert (hint.check, hint.seen, hint.look) == ("1.1", "fan is late", "look")
    robot.states["fan"] = "active"
    done.evaluate(robot, 31.0)
    assert done.hint(robot, 60.0) is None
    robot.is_stopped = True
    done.evaluate(robot, 61.0)
    assert done.hint(robot, 500.0) is None


@given(st.lists(st.sampled_from(["active", "late", "lost", "empty"]), max_size=40))
def test_ticks_only_grow_and_go_by_steps(states: list[str]) -> None:
    done = run((check("1.1", "f is active"),), (check("2.1", "f was lost"),), (check("3.1", "f is active", for_s=2.0),))
    robot = Robot()
    before: dict[str, float] = {}
    for now, state in enumerate(states):
        robot.states["f"] = state
        done.evaluate(robot, float(now))
        ticked = dict(done.ticked)
        assert before.items() <= ticked.items()
        assert list(ticked) == ["1.1", "2.1", "3.1"][: len(ticked)]
        before = ticked


def test_progress_counts_the_checks_that_the_lesson_has() -> None:
    lesson = Lesson("l", "L", 45, 1, (Step("", (check("1.1", "stopped"), check("1.2", "stopped"))),))
    ticks = [
        Tick("=ann", "l", "", 10**6),
        Tick("=ann", "l", "1.1", 5 * 10**6),
        Tick("=ann", "l", "9.9", 6 * 10**6),
        Tick("bob", "gone", "", 10**6),
    ]
    ann, bob = progress_of(ticks, [lesson])
    assert (ann.ticked, ann.checks, ann.is_done, ann.begun_ms, ann.last_ms) == (1, 2, False, 1, 5)
    assert (bob.title, bob.checks, bob.is_done) == ("gone", 0, False)
    assert csv_of([ann]).splitlines()[1] == "'=ann,l,1,2,1,0,0,0,,1,5"
