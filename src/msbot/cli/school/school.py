"""`msbot class`: all robots of a class: list and search them, one STOP for all, one blueprint for many."""

from __future__ import annotations

import json
import time
from datetime import datetime
from pathlib import Path

import click

from msbot.cli.change.stop import LOOK_S, PATIENCE_S
from msbot.cli.options import db_option, json_option, library_option, user_name
from msbot.cli.school.class_robots import ClassRobot, class_robots
from msbot.errors import ConfigError, MsbotError
from msbot.runtime.stop_datagram import IS_THERE, ask_masters


@click.group("class")
def command() -> None:
    """All robots of a class: those whose masters run on this computer, and all of a database.

    The database is that of --db, for example a PostgreSQL server that the whole school shares, or robot.db here.
    """


@command.command("list")
@click.argument("words", nargs=-1)
@db_option
@json_option
def list_robots(words: tuple[str, ...], db: str | None, *, as_json: bool) -> None:
    """List the robots in whose line all WORDS are found."""
    robots = class_robots(db, words)
    if as_json:
        click.echo(json.dumps([_as_dict(robot) for robot in robots]))
        return
    if not robots:
        click.echo("No robot fits." if words else "There is no robot: no master runs here, and there is no robot.db.")
        return
    width = max(len(robot.words) for robot in robots)
    version = max(len(robot.version) for robot in robots)
    for robot in robots:
        page = "" if robot.master is None else robot.master.details.get("page", "")
        line = f"{robot.words:{width}}  {robot.version:{version}}  {robot.state}"
        click.echo(f"{line}  {page}".rstrip())
    running = sum(robot.master is not None for robot in robots)
    click.echo(f"{len(robots)} robots, {running} of them run here.")


def _as_dict(robot: ClassRobot) -> dict[str, object]:
    details = {} if robot.master is None else robot.master.details
    return {
        "name": robot.name,
        "serial_number": robot.serial_number,
        "version": robot.version,
        "database": robot.database,
        "runs_here": robot.master is not None,
        "runs_elsewhere": robot.runs_elsewhere,
        "page": details.get("page", ""),
        "slots": int(details.get("slots", "0")),
        "active": int(details.get("active", "0")),
    }


@command.command("stop")
@click.option("--reason", default="", help="Why, for the people who see it.")
@db_option
@json_option
def stop(reason: str, db: str | None, *, as_json: bool) -> None:
    """STOP to every robot whose master runs on this computer; says who has confirmed it, and who has not."""
    if not IS_THERE:
        raise ConfigError("this system has no socket for STOP: say `msbot stop --robot NAME` for each robot")
    answers, silent = ask_masters({"do": "stop", "who": user_name(), "reason": reason})
    until = time.monotonic() + PATIENCE_S
    while any(answer.get("not_confirmed") for answer in answers) and time.monotonic() < until:
        time.sleep(LOOK_S)
        answers, _ = ask_masters({"do": "status", "who": user_name(), "reason": ""})
    answers.sort(key=lambda one: (str(one.get("robot")), str(one.get("serial_number"))))
    if as_json:
        names = (
            "robot",
            "serial_number",
            "database",
            "stopped",
            "told",
            "confirmed",
            "silent",
            "not_confirmed",
            "error",
        )
        click.echo(json.dumps([{name: answer[name] for name in names if name in answer} for answer in answers]))
    else:
        for answer in answers:
            click.echo(stop_line(answer))
    told = {(answer.get("robot"), answer.get("serial_number")) for answer in answers}
    # What needs the database comes after STOP: it may be slow, or away.
    elsewhere = [
        robot.words
        for robot in class_robots(db)
        if robot.runs_elsewhere and (robot.name, robot.serial_number) not in told
    ]
    if silent:
        raise ConfigError(f"NOT delivered to {silent} masters that run here and do not answer: cut their power")
    if elsewhere:
        raise ConfigError(f"NOT told, their masters run on other computers: {', '.join(elsewhere)}. Say STOP there")
    if not answers:
        raise ConfigError("NOT delivered: no master of yours runs on this computer")


def stop_line(answer: dict[str, object]) -> str:
    """How STOP stands at one robot."""
    who = f"{answer.get('robot')} {answer.get('serial_number')}"
    if "error" in answer:
        return f"{who}: {answer['error']}"
    if not answer["stopped"]:
        return f"{who}: STOP has been ended meanwhile"
    told, missing, names = answer["told"], answer["not_confirmed"], answer["silent"]
    assert isinstance(told, int)
    assert isinstance(missing, int)
    assert isinstance(names, list)
    if not told:
        return f"{who}: STOP holds; no part is in the robot"
    if not missing:
        return f"{who}: STOP, confirmed by all {told} parts"
    return f"{who}: STOP, confirmed by {told - missing} of {told} parts; NOT by {', '.join(map(str, names))}"


@command.command("apply")
@click.argument("blueprint", type=click.Path(path_type=Path))
@click.option("--only", "words", multiple=True, metavar="WORD", help="Only robots in whose line of `msbot class list` "
              "this is found; may be given several times.")  # fmt: skip
@library_option
@db_option
@click.option("--yes", is_flag=True, help="Do not ask.")
def roll_out(blueprint: Path, words: tuple[str, ...], folders: tuple[Path, ...], db: str | None, *, yes: bool) -> None:
    """Put BLUEPRINT into force in every robot of the class; each keeps its own name, serial number and version.

    What would change is shown first. A robot that cannot be changed holds up no other one; `msbot class undo` takes
    back what was done.
    """
    from msbot.cli.blueprint.apply import agreed
    from msbot.cli.school.rollout import RollOut, plan_for
    from msbot.config import open_blueprint

    wanted, library = open_blueprint(blueprint, *folders)
    robots = class_robots(db, words)
    if not robots:
        raise ConfigError("no robot fits: `msbot class list` shows which there are")
    plans = [plan_for(robot, wanted) for robot in robots]
    for plan in plans:
        changes = ", ".join(f"{change.where} {change.change}" for change in plan.changes[:6])
        more = f" and {len(plan.changes) - 6} more" if len(plan.changes) > 6 else ""
        click.echo(f"{plan.robot.words}: {plan.obstacle or changes + more or 'nothing to change'}")
    to_change = [plan for plan in plans if plan.changes]
    failed = sum(bool(plan.obstacle) for plan in plans)
    if to_change and not yes and not agreed():
        raise click.Abort
    roll = RollOut(blueprint, library, folders)
    for number, plan in enumerate(to_change, 1):
        try:
            done = roll.put_in_force(plan)
        except MsbotError as error:
            failed += 1
            done = f"NOT changed: {error}"
        click.echo(f"[{number}/{len(to_change)}] {plan.robot.words}: {done}")
    if failed:
        raise ConfigError(f"{failed} of {len(plans)} robots were not changed; `msbot class undo` takes the others back")
    if to_change:
        click.echo(f"{len(to_change)} robots are as {blueprint} says; `msbot class undo` takes it back")


@command.command("undo")
@db_option
def undo(db: str | None) -> None:
    """Take back the latest roll-out, robot by robot; what was changed again since stays, and is named."""
    from msbot.cli.school.rollout import RollOutBook, take_back

    book = RollOutBook()
    last = book.last()
    if last is None:
        raise ConfigError("there is no roll-out that could be taken back")
    source, at, changes = last
    click.echo(f"{source}, rolled out on {datetime.fromtimestamp(at):%Y-%m-%d %H:%M}:")
    robots, back = class_robots(db), []
    for number, change in enumerate(changes, 1):
        try:
            words = take_back(change, robots)
            back.append(change)
        except MsbotError as error:
            words = f"NOT taken back: {error}"
        click.echo(f"[{number}/{len(changes)}] {change.robot} {change.serial_number}: {words}")
    book.taken_back(back)
    if len(back) < len(changes):
        raise ConfigError(f"{len(changes) - len(back)} of {len(changes)} robots were not taken back")
