"""`msbot class`: all robots of a class: list and search them, one STOP for all, one blueprint for many."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

import click

from msbot.cli.change.stop_commands import LOOK_S, PATIENCE_S, silent_words
from msbot.cli.database_place import database_here, existing_database
from msbot.cli.robot_options import db_option, library_option, stop_group_option, user_name
from msbot.stop.socket_folders import IS_THERE
from msbot.stop.socket_names import group_to_stop
from msbot.stop.stop_request import SilentMaster, ask_masters
from msbot_agent.cli.options import json_option
from msbot_agent.cli.table import print_table
from msbot_agent.startup.extensions import own_version
from msbot_school.classroom.class_robots import ClassRobot, class_robots
from msbot_school.classroom.remote_access import RemoteAccess, RemoteAccessFile
from msbot_school.classroom.remote_masters import STOP_S, Answer, ParallelRequest, RemoteMasterError, say_stop
from msbot_school.cli.classroom.access_commands import find, join, leave
from msbot_xrce.counting import amount
from msbot_xrce.errors import ConfigError

MOST_CHANGES = 6
"""Changes of a robot that are named before a roll-out."""


@click.group("class")
def command() -> None:
    """All robots of a class: on this computer, of a database, and elsewhere, if you have access.

    The database is that of --db, for example a PostgreSQL server that the whole school shares, or robot.db here.
    Access is an API token of a robot's page on another computer: `msbot class join`.
    """


command.add_command(find)
command.add_command(join)
command.add_command(leave)


def robots_of_class(db: str | None, words: tuple[str, ...] = ()) -> list[ClassRobot]:
    """All robots of the class that fit the words."""
    path = db or database_here()
    stored = existing_database(db) if db is not None or Path(path).exists() else None
    return class_robots(stored, RemoteAccessFile().all(), words, path=path)


@command.command("list")
@click.argument("words", nargs=-1)
@db_option
@json_option
def list_robots(words: tuple[str, ...], db: str | None, *, as_json: bool) -> None:
    """List the robots whose line contains all WORDS."""
    robots = robots_of_class(db, words)
    if as_json:
        click.echo(json.dumps([_as_dict(robot) for robot in robots]))
        return
    if not robots:
        click.echo(
            "No robot fits."
            if words
            else "There is no robot: no master runs here, there is no robot.db, and "
            "no access to a robot elsewhere (`msbot class join`)."
        )
        return
    print_table(("robot", "version", "blueprint", "state", "page"), [_row(robot) for robot in robots])
    click.echo(_sum(robots))


def _row(robot: ClassRobot) -> tuple[str, ...]:
    state = robot.state + (f", STOP group {robot.stop_group}" if robot.stop_group else "")
    state += f", MsBOT {robot.msbot}" if robot.msbot not in ("", own_version()) else ""
    page = "" if robot.far is not None else robot.page
    return robot.describe, robot.version, robot.blueprint, state, page


def _sum(robots: list[ClassRobot]) -> str:
    silent = sum(robot.far is not None and not robot.answers for robot in robots)
    elsewhere = sum(robot.runs_elsewhere or (robot.far is not None and robot.answers) for robot in robots)
    parts = [
        f"{amount(len(robots), 'robot')}",
        f"{amount(sum(robot.master is not None for robot in robots), 'of them runs here', 'of them run here')}",
    ]
    parts += [f"{elsewhere} on other computers"] if elsewhere else []
    parts += [amount(silent, "does not answer", "do not answer")] if silent else []
    marks = {robot.blueprint for robot in robots if robot.blueprint}
    return f"{', '.join(parts)}." + (f" {len(marks)} different blueprints." if len(marks) > 1 else "")


def _as_dict(robot: ClassRobot) -> dict[str, object]:
    return {
        "name": robot.name,
        "serial_number": robot.serial_number,
        "version": robot.version,
        "blueprint": robot.blueprint,
        "msbot": robot.msbot,
        "database": robot.database,
        "runs_here": robot.master is not None,
        "runs_elsewhere": robot.runs_elsewhere or (robot.far is not None and robot.answers),
        "has_access": robot.far is not None,
        "answers": robot.answers,
        "trouble": "" if robot.far is None else robot.far.trouble,
        "page": robot.page,
        "slots": robot.slots,
        "active": robot.active,
        "stop_group": robot.stop_group,
    }


@command.command("stop")
@click.option("--reason", default="", help="Why, for the people who see it.")
@stop_group_option
@db_option
@json_option
def stop(reason: str, db: str | None, *, as_json: bool, stop_group: str | None) -> None:
    """STOP every robot of the class at once, without asking, and report who confirmed.

    Those whose masters run on this computer, and those elsewhere to which you have access; with --stop-group or
    $MSBOT_STOP_GROUP, those in that group. HOME and XDG folders do not keep robots apart. A robot that does not answer
    is named, and so is one elsewhere that is not in the group.
    """
    group, odd = group_to_stop() if stop_group is None else (stop_group, "")
    if odd:
        click.echo(f"{odd}: STOP goes to every robot of yours and of the class", err=True)
    trouble = ""
    try:
        accesses = RemoteAccessFile().all()
    except ConfigError as error:  # the robots here are stopped all the same
        accesses, trouble = [], str(error)
    far = ParallelRequest(accesses, say_stop(reason, group), STOP_S)  # they are told while those here are
    answers, silent = _stop_here(reason, group)
    lines, left_alone = _stop_lines(accesses, far)
    answers = sorted([*answers, *not_here(lines, answers)], key=_in_order)
    if as_json:
        names = (
            "robot",
            "serial_number",
            "database",
            "page",
            "stopped",
            "told",
            "confirmed",
            "silent",
            "not_confirmed",
            "stored",
            "error",
        )
        click.echo(json.dumps([{name: answer[name] for name in names if name in answer} for answer in answers]))
    else:
        for answer in answers:
            click.echo(stop_line(answer))
        for words in left_alone:
            click.echo(f"{words}: left alone, it is not in the STOP group {group}")
    told = {(answer.get("robot"), answer.get("serial_number")) for answer in answers}
    not_stopped = [f"{one.get('robot')} {one.get('serial_number')}" for one in answers if not one.get("stopped")]
    # What needs the database comes after STOP: it may be slow, or away.
    elsewhere = [
        robot.describe
        for robot in _stored_robots(db)
        if not group and robot.runs_elsewhere and (robot.name, robot.serial_number) not in told
    ]
    if not IS_THERE:
        trouble = "this system has no socket for STOP: say `msbot stop --robot NAME` for each robot that runs here"
    problems = [f"NOT delivered to {silent_words(silent)}; cut their power"] if silent else []
    problems += [f"NOT stopped: {', '.join(not_stopped)}: cut their power"] if not_stopped else []
    if elsewhere:
        problems.append(
            f"NOT told, their masters run on other computers and there is no access: {', '.join(elsewhere)}. Say STOP "
            "there, and `msbot class join` their pages"
        )
    problems += [trouble] if trouble else []
    if problems:
        raise ConfigError("; ".join(problems))
    if not answers:
        raise ConfigError("NOT delivered: no master of yours runs on this computer, and there is no access to others")


def _stored_robots(db: str | None) -> list[ClassRobot]:
    """The robots here and of the database; those elsewhere have been spoken to already."""
    path = db or database_here()
    stored = existing_database(db) if db is not None or Path(path).exists() else None
    return class_robots(stored, (), path=path)


def _stop_here(reason: str, group: str) -> tuple[list[Answer], list[SilentMaster]]:
    """STOP to all masters of this computer: their answers, and which do not answer."""
    if not IS_THERE:
        return [], []
    answers, silent = ask_masters({"do": "stop", "who": user_name(), "reason": reason}, group=group)
    until = time.monotonic() + PATIENCE_S
    while any(answer.get("not_confirmed") for answer in answers) and time.monotonic() < until:
        time.sleep(LOOK_S)
        answers, _ = ask_masters({"do": "status", "who": user_name(), "reason": ""}, group=group)
    return answers, silent


def _in_order(answer: Answer) -> tuple[str, str]:
    return str(answer.get("robot")), str(answer.get("serial_number"))


def _stop_lines(accesses: list[RemoteAccess], far: ParallelRequest[Answer]) -> tuple[list[Answer], list[str]]:
    """How STOP stands at the robots elsewhere, and which of them are of another STOP group."""
    found = far.answers()
    lines: list[Answer] = []
    left_alone: list[str] = []
    for access in accesses:
        answer, known = found[access.address], {"robot": access.robot, "serial_number": access.serial_number}
        if isinstance(answer, RemoteMasterError):
            lines.append(known | {"page": access.address, "stopped": False, "error": f"NOT told: {answer}"})
        elif "stopped" in answer:
            lines.append(known | {"page": access.address} | answer)
        else:
            left_alone.append(f"{access.robot} {access.serial_number}")
    return lines, left_alone


def not_here(far: Sequence[Answer], here: Sequence[Answer]) -> list[Answer]:
    """What accesses say, without robots that run on this computer and have stopped: they are told once.

    Robots may bear the same name and number: one that has not stopped is named in any case.
    """
    stopped = {_in_order(answer) for answer in here if answer.get("stopped")}
    return [answer for answer in far if not (answer.get("stopped") and _in_order(answer) in stopped)]


def stop_line(answer: dict[str, object]) -> str:
    """How STOP stands at one robot."""
    who = f"{answer.get('robot')} {answer.get('serial_number')}"
    if "error" in answer:
        return f"{who}: {answer['error']}"
    if not answer["stopped"]:
        return f"{who}: STOP has been ended meanwhile"
    return f"{who}: {_confirmed(answer)}{'' if answer.get('stored', True) else '; NOT stored: it ends with its master'}"


def _confirmed(answer: dict[str, object]) -> str:
    """Which parts of a robot have confirmed the STOP that holds there."""
    told, missing, names = answer["told"], answer["not_confirmed"], answer["silent"]
    if told is None:
        return "STOP was taken; which parts have confirmed it is NOT known"
    assert isinstance(told, int)
    assert isinstance(missing, int)
    assert isinstance(names, list)
    if not told:
        return "STOP holds; no part is in the robot"
    if not missing:
        return f"STOP, confirmed by {'the one part' if told == 1 else f'all {told} parts'}"
    return f"STOP, confirmed by {told - missing} of {amount(told, 'part')}; NOT by {', '.join(map(str, names))}"


@command.command("apply")
@click.argument("blueprint", type=click.Path(path_type=Path))
@click.option(
    "--only",
    "words",
    multiple=True,
    metavar="WORD",
    help="Only robots whose line in `msbot class list` contains WORD; repeatable.",
)
@library_option
@db_option
@click.option("--yes", is_flag=True, help="Do not ask.")
def roll_out(blueprint: Path, words: tuple[str, ...], folders: tuple[Path, ...], db: str | None, *, yes: bool) -> None:
    """Apply BLUEPRINT to every robot of the class; each keeps its own profile (name, serial number, version ...).

    What would change is shown first. A robot that cannot be changed does not hold up the others; `msbot class undo`
    reverts the changes.
    """
    from msbot.cli.blueprint.changes import agreed
    from msbot.config import open_blueprint
    from msbot_school.classroom.rollout import RollOut, plan_for
    from msbot_school.classroom.rollout_run import RollOutRun, StepState

    wanted, library = open_blueprint(blueprint, *folders)
    robots = robots_of_class(db, words)
    if not robots:
        raise ConfigError("no robot fits: `msbot class list` shows which there are")
    plans = [plan_for(robot, wanted) for robot in robots]
    for plan in plans:
        changes = "; ".join(plan.changes[:MOST_CHANGES])
        more = f"; and {len(plan.changes) - MOST_CHANGES} more" if len(plan.changes) > MOST_CHANGES else ""
        click.echo(f"{plan.robot.describe}: {plan.obstacle or changes + more or 'nothing to change'}")
    to_change = [plan for plan in plans if plan.changes]
    failed = sum(bool(plan.obstacle) for plan in plans)
    if to_change and not yes and not agreed():
        raise click.Abort
    source = blueprint.resolve()
    roll = RollOut(str(source), source.parent, library, folders, user_name())
    run = RollOutRun(str(source), [roll.job(plan) for plan in to_change])
    for number, plan in enumerate(to_change):
        step = run.do(number)
        is_done = step.state is StepState.CHANGED
        failed += not is_done
        done = step.words if is_done else f"NOT changed, as far as is known: {step.words}"
        click.echo(f"[{number + 1}/{len(to_change)}] {plan.robot.describe}: {done}")
    if failed:
        raise ConfigError(
            f"{failed} of {amount(len(plans), 'robot')} {'was' if failed == 1 else 'were'} not changed; "
            "`msbot class undo` takes the others back"
        )
    if to_change:
        click.echo(
            f"{amount(len(to_change), 'robot is', 'robots are')} as {blueprint} says; `msbot class undo` takes it back"
        )


@command.command("undo")
@db_option
def undo(db: str | None) -> None:
    """Undo the latest roll-out; robots changed since are named and left alone."""
    from msbot_school.classroom.rollout import undo_job
    from msbot_school.classroom.rollout_run import RollOutLog, RollOutRun, StepState

    book = RollOutLog()
    last = book.last()
    if last is None:
        raise ConfigError("there is no roll-out that could be taken back")
    click.echo(f"{last.blueprint}, rolled out on {datetime.fromtimestamp(last.at):%Y-%m-%d %H:%M}:")
    robots, count, left = robots_of_class(db), len(last.done), 0
    jobs = [undo_job(last.at, change, robots, user_name(), book) for change in last.done]
    run = RollOutRun(last.blueprint, jobs, is_undo=True)
    for number in range(count):
        step = run.do(number)
        is_done = step.state is StepState.CHANGED
        left += not is_done
        words = step.words if is_done else f"NOT taken back: {step.words}"
        click.echo(f"[{number + 1}/{count}] {step.robot}: {words}")
    if left:
        raise ConfigError(f"{left} of {amount(count, 'robot')} {'was' if left == 1 else 'were'} not taken back")
