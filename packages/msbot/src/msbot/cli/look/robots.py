"""`msbot robots`: the robots of a database."""

from __future__ import annotations

import json
from datetime import datetime

import click

from msbot.cli.change.robot_access import until_stored
from msbot.cli.look.looking import Look, looking_at
from msbot.cli.robot_options import db_option, existing_database
from msbot.pnp import PartState
from msbot.registry import RobotRecord


@click.command("robots")
@db_option
@click.option("--json", "as_json", is_flag=True, help="Print a JSON list instead of a table.")
def command(db: str | None, *, as_json: bool) -> None:
    """List the robots of a database, the one whose blueprint was applied last first."""
    path = existing_database(db)
    until_stored(path)
    with looking_at(path) as look:
        rows = [_row(look, robot) for robot in look.robots()]
    if as_json:
        click.echo(json.dumps(rows))
        return
    if not rows:
        click.echo("There is no robot in it yet: `msbot apply robot.toml` or `msbot master robot.toml` puts one there.")
        return
    from rich.console import Console
    from rich.table import Table

    table = Table()
    for title in ("robot", "serial number", "master", "slots", "blueprint applied"):
        table.add_column(title, no_wrap=True)
    for row in rows:
        applied = datetime.fromtimestamp(int(row["applied_at_ms"]) / 1000).strftime("%Y-%m-%d %H:%M")
        filled = f"{row['filled']} of {row['slots']} filled" if row["running"] else str(row["slots"])
        master = "runs" if row["running"] else "-"
        table.add_row(str(row["name"]), str(row["serial_number"]), master, filled, applied)
    Console().print(table)


def _row(look: Look, robot: RobotRecord) -> dict[str, str | int | bool]:
    active = {part.slot for part in look.parts(robot) if PartState(part.state).is_registered}
    return {
        "name": robot.name,
        "serial_number": robot.serial_number,
        "version": robot.version,
        "manufacturer": robot.manufacturer,
        "running": look.is_run(robot),
        "slots": len(look.slot_names(robot)),
        "filled": len(active),
        "applied_at_ms": robot.applied_ns // 1_000_000,
    }
