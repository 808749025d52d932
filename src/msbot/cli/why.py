"""`msbot why`: the reason for a part's state, with the evidence."""

from __future__ import annotations

from datetime import datetime

import click

from msbot.cli.options import db_option, existing_database
from msbot.errors import ConfigError
from msbot.registry import Registry, open_registry


@click.command("why")
@click.argument("part")
@click.option("--last", type=click.IntRange(min=1), default=3, show_default=True, help="How many changes to explain.")
@db_option
def command(part: str, last: int, db: str | None) -> None:
    """Say why PART (a name, slot, part number or UID) is, or is not, in the robot.

    Prints its latest changes of state, newest last, each with the rules that were tried and what came of them.
    """
    with open_registry(existing_database(db), read_only=True) as registry:
        entries = registry.journal(last, part)
        if not entries:
            raise ConfigError(f"no part {part!r} is in the journal; {_seen(registry)}")
    for entry in entries:
        when = datetime.fromtimestamp(entry.at_ns / 1e9).strftime("%Y-%m-%d %H:%M:%S")
        first, *evidence = entry.event.sentences()
        click.echo(f"{when}  {first}")
        for line in evidence:
            click.echo(line)


def _seen(registry: Registry) -> str:
    names = sorted({record.name for record in registry.parts()})
    return f"seen so far: {', '.join(names)}" if names else "nothing has been plugged in yet"
