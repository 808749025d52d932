"""`msbot unblock`: let a blocked part in again."""

from __future__ import annotations

import click

from msbot.cli.control import robot_options, say


@click.command("unblock")
@click.argument("part")
@robot_options
def command(part: str, db: str | None, robot: str | None) -> None:
    """Let PART, or all parts of a number, in again; they come back by themselves."""
    say(db, robot, "unblock", {"part": part})
