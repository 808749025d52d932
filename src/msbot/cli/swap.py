"""`msbot swap`: give a slot to another part."""

from __future__ import annotations

import click

from msbot.cli.control import robot_options, say


@click.command("swap")
@click.argument("slot")
@click.option("--to", "to_part", required=True, metavar="PART", help="The part that gets the slot.")
@robot_options
def command(slot: str, to_part: str, db: str | None, robot: str | None) -> None:
    """Give SLOT, with its settings, wiring and history, to another part.

    The part that held it gets the other one's slot, or stands by.
    """
    say(db, robot, "swap", {"slot": slot, "to": to_part})
