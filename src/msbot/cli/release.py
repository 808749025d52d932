"""`msbot release`: take the part out of a slot."""

from __future__ import annotations

import click

from msbot.cli.control import robot_options, say


@click.command("release")
@click.argument("slot")
@robot_options
def command(slot: str, db: str | None, robot: str | None) -> None:
    """Take the part out of SLOT: it stands by, and a spare gets the slot if there is one."""
    say(db, robot, "release", {"slot": slot})
