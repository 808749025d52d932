"""Each check of each lesson ticks when all that it asks for is so, and never while one of it is not."""

from __future__ import annotations

import pytest

from msbot_school.faults.fault_kinds import NumberCondition, StateCondition
from msbot_school.lessons.catalog import LessonCatalog
from msbot_school.lessons.conditions import (
    Condition,
    CurrentState,
    Exists,
    HeldBy,
    MovedBy,
    RotatedBy,
    SettingIs,
    Stopped,
    WasInState,
    Wired,
)
from msbot_school.lessons.lesson import Lesson, LessonCheck, Step
from msbot_school.lessons.lesson_run import LessonRun
from tests.lessons.made_up_robot import Robot

LOOK_S = 0.25
PHASES = 6
"""After so many looks everything that changes has been everywhere."""
BEYOND = {">": 1.0, ">=": 0.0, "<": -1.0, "<=": 0.0, "=": 0.0}
SHORT_OF = {">": 0.0, ">=": -1.0, "<": 0.0, "<=": 1.0, "=": 1.0}


def let(robot: Robot, condition: Condition, phase: int, *, is_so: bool) -> None:
    """Make the robot such that a condition holds, or just not."""
    match condition:
        case CurrentState(plain=StateCondition(slot=slot, wanted=wanted)):
            robot.states[slot] = wanted if is_so else "late" if wanted != "late" else "active"
        case WasInState(slot=slot, wanted=wanted):
            if is_so and phase % 2 == (wanted == "late"):  # two states of one slot take turns
                robot.states[slot] = wanted
            robot.states.setdefault(slot, "active")
        case CurrentState(plain=NumberCondition(source=source, operator=sign, limit=limit)):
            step = 0.01 * abs(limit) + 1e-6
            robot.numbers[source] = limit + step * (BEYOND if is_so else SHORT_OF)[sign]
        case MovedBy(source=source, width=width):
            robot.numbers[source] = (phase % 2) * width * (1.0 if is_so else 0.99)
        case RotatedBy(source=source, width=width):
            share = min(phase, PHASES - 1) / (PHASES - 1)
            robot.numbers[source] = share * width * (1.0 if is_so else 0.99) % 360
        case Wired(source=source, target=target):
            robot.wires.add((source, target) if is_so else (target, source))
        case SettingIs(slot=slot, name=name, operator=sign, value=value):
            robot.settings[slot, name] = f"{float(value) + 0.01 * (BEYOND if is_so else SHORT_OF)[sign]:.6f}"
        case HeldBy(slot=slot, part=""):
            robot.parts[slot] = "the first" if phase == 0 or not is_so else "another"
        case Exists(kind="type", name=name):
            (robot.types.add if is_so else robot.types.discard)(name)
        case Exists(kind="slot", name=name):
            if is_so:
                robot.states.setdefault(name, "new")
            else:
                robot.states.pop(name, None)
        case Stopped(wanted=wanted):
            robot.is_stopped = wanted is is_so
        case _:
            raise AssertionError(f"add to this test how {condition} comes about")


def ticks(check: LessonCheck, without: Condition | None) -> bool:
    """Whether it ticks in a robot in which all its conditions hold, except maybe one."""
    run = LessonRun(Lesson("l", "L", 45, 1, (Step("", (check,)),)), 0.0)
    robot = Robot()
    for phase in range(PHASES + round(check.for_s / LOOK_S) + 1):
        # What is not so comes last: it may concern what another one has set.
        for condition in sorted(check.conditions, key=lambda one: one is without):
            let(robot, condition, phase, is_so=condition is not without)
        if run.evaluate(robot, phase * LOOK_S):
            return True
    return False


CHECKS = {f"{lesson.name} {check.name}": check for lesson in LessonCatalog().all()[0] for check in lesson.checks}


@pytest.mark.parametrize("name", [name for name, check in CHECKS.items() if check.question is None])
def test_a_check_ticks_only_when_all_of_it_is_so(name: str) -> None:
    check = CHECKS[name]
    assert ticks(check, None)
    for condition in check.conditions:
        assert not ticks(check, condition), f"without {condition}"


@pytest.mark.parametrize("name", [name for name, check in CHECKS.items() if check.question is not None])
def test_a_question_takes_no_wrong_answer(name: str) -> None:
    question = CHECKS[name].question
    assert question is not None
    assert all(question.is_right(one) for one in question.right)
    wrong = [one for one in question.choices if one not in question.right] or ["", "-", "wrong", "7"]
    assert wrong
    assert not any(question.is_right(one) for one in wrong)
