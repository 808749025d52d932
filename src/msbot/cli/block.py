"""`msbot block`: let a part in no more."""

from __future__ import annotations

import click

from msbot.cli.control import robot_options, say


@click.command("block")
@click.argument("part")
@click.option("--reason", default="", help="Why; `msbot why` will say it.")
@robot_options
def command(part: str, reason: str, db: str | None, robot: str | None) -> None:
    """Let PART in no more: a name, slot or UID, or a part number for all parts of that kind."""
    say(db, robot, "block", {"part": part, "reason": reason})
