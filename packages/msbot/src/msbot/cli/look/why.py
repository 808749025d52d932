"""`msbot why`: the reason for a part's state, with the evidence."""

from __future__ import annotations

import json
from datetime import datetime
from pathlib import Path

import click

from msbot.cli.change.robot_access import perform, running_master, until_stored
from msbot.cli.look.folding import for_terminal
from msbot.cli.look.looking import Look, looking_at
from msbot.cli.look.one_robot import one_robot
from msbot.cli.robot_options import DEFAULT_BLUEPRINT, database_beside, existing_database, robot_options
from msbot.registry import JournalEntry, RobotRecord
from msbot_agent.cli.numbers import WholeRange
from msbot_agent.cli.options import json_option
from msbot_xrce.errors import ConfigError, RegistryError


@click.command("why")
@click.argument("part")
@click.option("--last", type=WholeRange(min=1), default=3, show_default=True, help="How many changes to explain.")
@robot_options
@json_option
def command(part: str, last: int, db: str | None, robot: str | None, *, as_json: bool) -> None:
    """Say why PART (a name, slot, part number or UID) is, or is not, in the robot.

    Prints its latest changes of state, newest last, each with the rules that were tried and what came of them, and
    its present state if the robot runs.
    """
    master = running_master(db, robot)
    lines: list[str] = []
    troubles: list[str] = []
    if master is not None:
        found = perform(db, robot, "why", {"part": part})
        lines, troubles = _texts(found["lines"]), _texts(found["troubles"])
        if db is None and not Path(database_beside(DEFAULT_BLUEPRINT)).exists():
            db = master.details.get("database")
    try:
        entries, several = _read(part, last, db, robot, must_be_there=not lines)
    except RegistryError as error:
        if not lines:
            raise
        click.echo(f"msbot: {error}; this is what the master knows:", err=True)
        if as_json:
            click.echo(json.dumps({"history": [], "now": lines, "troubles": troubles}))
            return
        for line in lines:
            click.echo(for_terminal(line))
        return
    if as_json:
        history = [_as_json(entry) for entry in entries]
        click.echo(json.dumps({"history": history, "now": lines, "troubles": troubles}))
        return
    for entry in entries:
        when = datetime.fromtimestamp(entry.at_ns / 1e9).strftime("%Y-%m-%d %H:%M:%S")
        first, *evidence = entry.event.sentences()
        click.echo(for_terminal(f"{when}  {entry.robot}: {first}" if several else f"{when}  {first}"))
        for line in evidence:
            click.echo(for_terminal(line))
    if lines:
        click.echo(for_terminal(f"now: {lines[0]}"))
    for line in troubles:
        click.echo(for_terminal(f"now: {line}"))


def _as_json(entry: JournalEntry) -> dict[str, object]:
    event = entry.event
    return {
        "at_ms": entry.at_ns // 1_000_000,
        "robot": entry.robot,
        "part": event.part,
        "slot": event.slot,
        "from": None if event.from_state is None else event.from_state.value,
        "to": event.to_state.value,
        "reason": event.reason,
        "evidence": [list(pair) for pair in event.evidence],
    }


def _texts(found: object) -> list[str]:
    assert isinstance(found, list)
    return found


def _read(
    part: str, last: int, db: str | None, robot: str | None, *, must_be_there: bool
) -> tuple[list[JournalEntry], bool]:
    """The lines of the journal, and whether they may be those of several robots."""
    path = existing_database(db)
    until_stored(path)
    with looking_at(path) as look:
        robots = look.robots()
        meant = None if robot is None else one_robot(look.database, robots, robot)
        entries = look.journal(last, part, meant)
        if not entries and must_be_there:
            raise ConfigError(f"no part {part!r} is in the journal; {_seen(look, meant)}")
    return entries, meant is None and len(robots) > 1


def _seen(look: Look, robot: RobotRecord | None) -> str:
    names = sorted({record.name for record in look.parts(robot)})
    return f"seen so far: {', '.join(names)}" if names else "nothing has been plugged in yet"
