"""`msbot why`: the reason for a part's state, with the evidence."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

import click

from msbot.cli.control import perform, robot_options, running_master
from msbot.cli.options import DEFAULT_BLUEPRINT, database_beside, existing_database
from msbot.errors import ConfigError, RegistryError
from msbot.registry import JournalEntry, Registry, open_registry


@click.command("why")
@click.argument("part")
@click.option("--last", type=click.IntRange(min=1), default=3, show_default=True, help="How many changes to explain.")
@robot_options
def command(part: str, last: int, db: str | None, robot: str | None) -> None:
    """Say why PART (a name, slot, part number or UID) is, or is not, in the robot.

    Prints its latest changes of state, newest last, each with the rules that were tried and what came of them, and
    how it stands now if the robot runs.
    """
    master = running_master(db, robot)
    lines: list[str] = []
    if master is not None:
        found = perform(db, robot, "why", {"part": part})["lines"]
        assert isinstance(found, list)
        lines = found
        if db is None and not Path(database_beside(DEFAULT_BLUEPRINT)).exists():
            db = master.details.get("database")
    try:
        entries = _read(part, last, db, must_be_there=not lines)
    except RegistryError as error:
        if not lines:
            raise
        click.echo(f"msbot: {error}; this is what the master knows:", err=True)
        for line in lines:
            click.echo(line)
        return
    for entry in entries:
        when = datetime.fromtimestamp(entry.at_ns / 1e9).strftime("%Y-%m-%d %H:%M:%S")
        first, *evidence = entry.event.sentences()
        click.echo(f"{when}  {first}")
        for line in evidence:
            click.echo(line)
    if lines:
        click.echo(f"now: {lines[0]}")


def _read(part: str, last: int, db: str | None, *, must_be_there: bool) -> list[JournalEntry]:
    with open_registry(existing_database(db), read_only=True) as registry:
        entries = registry.journal(last, part)
        if not entries and must_be_there:
            raise ConfigError(f"no part {part!r} is in the journal; {_seen(registry)}")
    return entries


def _seen(registry: Registry) -> str:
    names = sorted({record.name for record in registry.parts()})
    return f"seen so far: {', '.join(names)}" if names else "nothing has been plugged in yet"
