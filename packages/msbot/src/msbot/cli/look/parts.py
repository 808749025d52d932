"""`msbot parts`: what a robot's database knows about its parts."""

from __future__ import annotations

import json
from datetime import datetime

import click

from msbot.cli.change.robot_access import database_to_read, until_stored
from msbot.cli.look.looking import looking_at
from msbot.cli.look.one_robot import one_robot
from msbot.cli.robot_options import robot_options
from msbot.registry import PartRecord
from msbot_agent.cli.options import json_option


@click.command("parts")
@robot_options
@json_option
def command(db: str | None, robot: str | None, *, as_json: bool) -> None:
    """List every part the robot has seen: its slot, its state and since when.

    States come from the journal of transitions, which the master writes; heartbeats are never stored.
    """
    path = database_to_read(db, robot)
    until_stored(path)
    with looking_at(path) as look:
        robots = look.robots()
        several = robot is None and len(robots) > 1
        rows = look.parts(None if robot is None else one_robot(look.database, robots, robot))
    if as_json:
        click.echo(json.dumps([_as_json(row) for row in rows]))
        return
    if not rows:
        click.echo("No part has been seen yet.")
        return
    from rich.console import Console
    from rich.table import Table

    table = Table()
    for title in (*["robot"] * several, "part", "number", "slot", "state", "since", "reason"):
        table.add_column(title)
    for row in rows:
        since = _when(datetime.fromtimestamp(row.changed_ns / 1e9), datetime.now())
        table.add_row(*[row.robot] * several, row.name, row.part_number, row.slot or "-", row.state, since, row.reason)
    Console().print(table)


def _when(at: datetime, now: datetime) -> str:
    """When something was, as briefly as can be: so the reason has room on a narrow terminal."""
    return at.strftime("%H:%M:%S" if at.date() == now.date() else "%Y-%m-%d %H:%M")


def _as_json(row: PartRecord) -> dict[str, str | int | None]:
    return {
        "robot": row.robot,
        "name": row.name,
        "part_number": row.part_number,
        "uid": row.uid.hex(),
        "slot": row.slot,
        "state": row.state,
        "reason": row.reason,
        "address": row.address,
        "changed_at_ms": row.changed_ns // 1_000_000,
    }
