"""`msbot lesson`: lessons that check themselves, at the robot that runs here."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from msbot.cli.change.robot_access import database_to_read, perform, say, until_stored
from msbot.cli.robot_options import mistakes_told, robot_and_json_options, robot_options, wants_json
from msbot_agent.cli.group import complain
from msbot_agent.cli.options import json_option
from msbot_agent.cli.table import for_terminal, print_table
from msbot_school.cli.teaching_service import lessons_option
from msbot_xrce.counting import amount
from msbot_xrce.errors import ConfigError

if TYPE_CHECKING:
    from msbot_school.lessons.progress import LessonProgress


@click.group("lesson")
def command() -> None:
    """Lessons with checks that are ticked while somebody works at the robot.

    `msbot demo --lesson NAME` runs a robot for one; the page Learn shows it. Teachers add their own: one Markdown file
    each, in a folder that --lessons names.
    """


@command.command("list")
@lessons_option
@json_option
def list_lessons(lessons: tuple[Path, ...], *, as_json: bool) -> None:
    """List all lessons."""
    from msbot_school.lessons.catalog import LessonCatalog

    found, wrong = LessonCatalog(lessons).all()
    if as_json:
        click.echo(
            json.dumps(
                {
                    "lessons": [
                        {
                            "lesson": one.name,
                            "title": one.title,
                            "minutes": one.minutes,
                            "checks": len(one.checks),
                            "robot": one.robot or str(one.blueprint),
                        }
                        for one in found
                    ],
                    "wrong": wrong,
                }
            )
        )
        return
    print_table(
        ("lesson", "minutes", "checks", "title"),
        [(one.name, str(one.minutes), str(len(one.checks)), one.title) for one in found],
    )
    for words in wrong:
        complain(f"not read: {words}")


@command.command("check")
@click.argument("path", type=click.Path(path_type=Path))
@json_option
def check(path: Path, *, as_json: bool) -> None:
    """Check a lesson file; mistakes are reported with line and remedy."""
    from msbot_school.lessons.lesson_reader import read_lesson

    with mistakes_told(as_json=as_json):
        lesson = read_lesson(path)
    if as_json:
        click.echo(json.dumps({"problems": []}))
        return
    click.echo(f"{path}: {lesson.title}: {amount(len(lesson.steps), 'section')}, {amount(len(lesson.checks), 'check')}")


@command.command("start")
@click.argument("lesson")
@click.option("--yes", is_flag=True, help="Do not ask.")
@robot_and_json_options
def start(lesson: str, db: str | None, robot: str | None, *, yes: bool) -> None:
    """Set up the robot that runs here for a lesson, and begin.

    Its slots and wires become those of the lesson, and simulated parts take the empty slots; `msbot lesson stop`
    restores everything. If people's programs stop by it, it asks first. If no robot runs: `msbot demo --lesson NAME`.
    """
    stops = "" if yes else str(perform(db, robot, "who_stops", {"lesson": lesson}).get("words", ""))
    if stops and (wants_json() or not sys.stdin.isatty()):
        raise ConfigError(f"{stops}; add --yes to begin without asking")
    if stops:
        click.echo(f"{stops[:1].upper()}{stops[1:]}.")
        if not click.confirm("Begin the lesson?"):
            raise click.Abort
    say(db, robot, "start_lesson", {"lesson": lesson})


@command.command("stop")
@robot_and_json_options
def stop(db: str | None, robot: str | None) -> None:
    """End the lesson and restore the robot."""
    say(db, robot, "stop_lesson", {})


@command.command("status")
@json_option
@robot_options
def status(db: str | None, robot: str | None, *, as_json: bool) -> None:
    """Show which steps of the running lesson are done, who takes part, and what is missing."""
    found = perform(db, robot, "lesson", {})
    if as_json:
        click.echo(json.dumps(found))
        return
    if found.get("lesson") is None:
        click.echo("No lesson runs: `msbot lesson start NAME` begins one, `msbot lesson list` shows them.")
        return
    _show_status(found)


@command.command("report")
@click.option("--csv", "as_csv", is_flag=True, help="Print a table for a spreadsheet.")
@json_option
@robot_options
@lessons_option
def report(db: str | None, robot: str | None, *, lessons: tuple[Path, ...], as_csv: bool, as_json: bool) -> None:
    """Show everybody's progress in every lesson that they have begun."""
    from msbot.registry import open_registry
    from msbot_school.lessons.catalog import LessonCatalog
    from msbot_school.lessons.progress import csv_of, progress_of

    path = database_to_read(db, robot)
    until_stored(path)
    with open_registry(path, create=False) as registry:
        rows = progress_of(registry.lesson_ticks.all(), LessonCatalog(lessons).all()[0])
    if as_json:
        click.echo(json.dumps({"people": [row.as_json() for row in rows]}))
    elif as_csv:
        click.echo(csv_of(rows), nl=False)
    elif rows:
        done = ["done" if row.is_done else f"{row.ticked} of {row.checks}" for row in rows]
        print_table(
            ("who", "lesson", "checks"),
            [(row.person, row.title, f"{words}{_shared(row)}") for row, words in zip(rows, done, strict=True)],
        )
    else:
        click.echo("Nobody has begun a lesson yet.")


def _shared(row: LessonProgress) -> str:
    """What of it others did."""
    shared = row.group + row.helped
    return f", {row.own} alone, {shared} with {', '.join(row.partners)}" if shared else ""


def _show_status(found: Mapping[str, Any]) -> None:
    click.echo(for_terminal(f"{found['title']}: begun by {found['who']}, {found['since_s']:.0f} s ago"))
    checks = [(one["check"], ", ".join(one["ticked"]) or "-", one["says"]) for one in found["checks"]]
    if checks:
        print_table(("check", "ticked by", "what it asks for"), checks)
    if found["progress"]:
        click.echo()
        print_table(("who", "checks", "stuck at"), [_progress(one, len(checks)) for one in found["progress"]])
    if not found["people"]:
        click.echo("Nobody takes part.")
    if found.get("done"):
        click.echo("All done. `msbot lesson stop` puts the robot back.")


def _progress(one: Mapping[str, Any], checks: int) -> tuple[str, ...]:
    hint = one["hint"]
    stuck = "-" if hint is None else f"{hint['check']}: {'. '.join(filter(None, (hint['seen'], hint['look'])))}"
    return one["person"], "done" if one["done"] else f"{len(one['ticked'])} of {checks}", stuck
