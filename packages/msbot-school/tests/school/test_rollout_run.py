"""How far each robot of a roll-out is, and that one that fails holds up no other one."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from msbot.config import SAMPLE_ROBOT_TOML, load_library, parse_blueprint
from msbot.registry import open_registry
from msbot_school.classroom.class_robots import ClassRobot, class_robots
from msbot_school.classroom.rollout import RollOut, plan_for, undo_job
from msbot_school.classroom.rollout_run import NoAnswer, RobotChange, RobotJob, RollOutLog, RollOutRun, StepState
from msbot_xrce.errors import ConfigError, DatabaseBusy
from tests.operations.stage import put_database


def raising(error: Exception) -> Callable[[], RobotChange]:
    def do() -> RobotChange:
        raise error

    return do


def test_each_robot_says_for_itself_how_it_went() -> None:
    seen: list[StepState] = []

    def change() -> RobotChange:
        seen.append(run.steps[0].state)
        return RobotChange("done", 7)

    run = RollOutRun(
        "robot.toml",
        [
            RobotJob("A 1", change),
            RobotJob("B 1", raising(ConfigError("no such part"))),
            RobotJob("C 1", raising(NoAnswer("no answer in time"))),
            RobotJob("D 1", raising(ZeroDivisionError())),
            RobotJob("E 1", change),
        ],
    )
    assert {step.state for step in run.steps} == {StepState.WAITING}
    for number in range(3):
        run.do(number)
    with pytest.raises(ZeroDivisionError):
        run.do(3)
    assert not run.is_over
    run.halt("STOP")
    assert run.do(4).words == "STOP", "not begun any more"
    assert run.is_over
    assert seen == [StepState.WORKING]
    told = [(step.state, step.words, step.edit) for step in run.steps]
    assert told[:3] == [
        (StepState.CHANGED, "done", 7),
        (StepState.REFUSED, "no such part", None),
        (StepState.SILENT, "no answer in time", None),
    ]
    assert [state for state, _, _ in told[3:]] == [StepState.SILENT, StepState.LEFT]
    run.do(0)
    assert seen == [StepState.WORKING], "nothing is done twice"


def test_robots_of_one_database_take_turns_and_others_do_not_wait() -> None:
    """A master that runs waits for the lock of its database's file only a moment, and a slow disk holds it longer."""
    both, begun, goes_on = threading.Barrier(2), threading.Event(), threading.Event()
    inside: list[str] = []

    def first() -> RobotChange:
        inside.append("A")
        both.wait(20)
        assert goes_on.wait(20)
        inside.append("a")
        return RobotChange("done", 1)

    def second() -> RobotChange:
        inside.append("B")
        begun.set()
        return RobotChange("done", 2)

    def elsewhere() -> RobotChange:
        both.wait(20)  # together with the first
        return RobotChange("done", 3)

    jobs = [RobotJob("A", first, "one.db"), RobotJob("B", second, "one.db"), RobotJob("C", elsewhere, "two.db")]
    run = RollOutRun("robot.toml", jobs, turn_s=20)
    threads = [threading.Thread(target=run.do, args=(number,)) for number in (0, 2, 1)]
    for thread in threads[:2]:
        thread.start()
    threads[1].join()
    threads[2].start()
    assert not begun.wait(0.05), "not before its turn"
    assert run.steps[1].state is StepState.WAITING
    goes_on.set()
    for thread in threads:
        thread.join()
    assert inside == ["A", "a", "B"]
    assert [step.state for step in run.steps] == [StepState.CHANGED] * 3


def test_a_robot_that_does_not_come_to_an_end_holds_up_its_database_for_a_while_only() -> None:
    goes_on = threading.Event()

    def stuck() -> RobotChange:
        assert goes_on.wait(20)
        return RobotChange("done", 1)

    jobs = [RobotJob("A", stuck, "one.db"), RobotJob("B", lambda: RobotChange("done", 2), "one.db")]
    run = RollOutRun("robot.toml", jobs, turn_s=0.01)
    thread = threading.Thread(target=run.do, args=(0,))
    thread.start()
    while run.steps[0].state is not StepState.WORKING:
        assert thread.is_alive()
    assert run.do(1).state is StepState.CHANGED
    goes_on.set()
    thread.join()
    assert run.do(0).state is StepState.CHANGED
    run = RollOutRun("robot.toml", jobs)
    assert [run.do(number).state for number in (0, 1)] == [StepState.CHANGED] * 2, "a turn is given back"


def test_what_a_locked_database_did_not_take_is_tried_again_for_a_while_or_until_people_end_it() -> None:
    answers = iter([DatabaseBusy("locked"), DatabaseBusy("locked"), None])

    def change() -> RobotChange:
        if (error := next(answers)) is not None:
            raise error
        return RobotChange("done", 1)

    run = RollOutRun("robot.toml", [RobotJob("A", change)], turn_s=20)
    assert run.do(0).state is StepState.CHANGED

    refused = RobotJob("A", raising(DatabaseBusy("nothing was changed: locked")))
    run = RollOutRun("robot.toml", [refused], turn_s=0)
    assert (run.do(0).state, run.steps[0].words) == (StepState.REFUSED, "nothing was changed: locked")

    asked = threading.Event()

    def locked() -> RobotChange:
        asked.set()
        raise DatabaseBusy("locked")

    run = RollOutRun("robot.toml", [RobotJob("A", locked)], turn_s=1000)
    thread = threading.Thread(target=run.do, args=(0,))
    thread.start()
    assert asked.wait(20)
    run.halt("the teacher ends it")
    thread.join(20)
    assert [step.state for step in run.steps] == [StepState.REFUSED]


def test_stored_robots_are_changed_and_changed_back_and_one_changed_since_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))  # no master of this user is seen
    database, library, book = str(tmp_path / "robot.db"), load_library(), RollOutLog(tmp_path)
    put_database(tmp_path / "robot.db")
    serial = next(line for line in SAMPLE_ROBOT_TOML.splitlines() if line.startswith("serial_number"))
    with open_registry(database) as registry:
        for number in (1, 2):
            text = SAMPLE_ROBOT_TOML.replace(serial, f'serial_number = "X{number}"')
            registry.robots.apply_blueprint(parse_blueprint(text, library), library)
    wanted = parse_blueprint(SAMPLE_ROBOT_TOML + '\n[[slot]]\nname = "extra"\npart = "RELAY-1"\n', library)

    def slots() -> list[bool]:
        with open_registry(database, read_only=True) as registry:
            return ["extra" in registry.robots.slot_names(record) for record in registry.robots.all()]

    robots = class_robots(database, ())
    plans = [plan_for(robot, wanted) for robot in robots]
    assert len({RollOut("", tmp_path, library, (), "ann", book=book).job(plan).database for plan in plans}) == 1
    assert [plan.changes for plan in plans] == [("+ slot extra: part RELAY-1",)] * 2
    roll = RollOut("robot.toml", tmp_path, library, (), "ann", book=book)
    run = RollOutRun("robot.toml", [roll.job(plan) for plan in plans])
    assert [run.do(number).state for number in (0, 1)] == [StepState.CHANGED] * 2
    assert slots() == [True, True]
    last = book.last()
    assert last is not None
    assert [one.edit for one in last.done] == [step.edit for step in run.steps]

    with open_registry(database) as registry:  # somebody goes on with the first one
        (first, _) = registry.robots.all()
        present = registry.robots.blueprint(first)
        changed = parse_blueprint(SAMPLE_ROBOT_TOML.replace(serial, 'serial_number = "X1"'), library)
        assert changed != present
        registry.robots.change_blueprint(changed, library, "bob")
    back = RollOutRun("robot.toml", [undo_job(last.at, one, robots, "ann", book) for one in last.done], is_undo=True)
    assert [back.do(number).state for number in (0, 1)] == [StepState.REFUSED, StepState.CHANGED]
    assert slots() == [False, False]
    last = book.last()
    assert last is not None
    assert [one.serial_number for one in last.done] == ["X1"], "what was not taken back is still remembered"


def test_a_robot_without_a_database_says_so() -> None:
    plan = plan_for(ClassRobot("R", "1", "", "", None), parse_blueprint(SAMPLE_ROBOT_TOML, load_library()))
    assert plan.obstacle == "it runs without a database, so it cannot be changed from here"
