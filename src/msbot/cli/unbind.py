"""`msbot unbind`: take a port off a topic."""

from __future__ import annotations

import click

from msbot.cli.control import robot_options, say


@click.command("unbind")
@click.argument("topic")
@click.argument("port", required=False, metavar="[SLOT.PORT]")
@robot_options
def command(topic: str, port: str | None, db: str | None, robot: str | None) -> None:
    """Take a port off TOPIC, or all its ports; the parts follow at once."""
    say(db, robot, "unbind", {"topic": topic, "port": port})
