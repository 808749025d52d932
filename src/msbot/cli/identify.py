"""`msbot identify`: have a part show itself."""

from __future__ import annotations

import click

from msbot.cli.control import robot_options, say


@click.command("identify")
@click.argument("part")
@robot_options
def command(part: str, db: str | None, robot: str | None) -> None:
    """Have PART show itself to the people in the room: blink, beep, whatever it can."""
    say(db, robot, "identify", {"part": part})
