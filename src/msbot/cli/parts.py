"""`msbot parts`: what a robot's database knows of its parts."""

from __future__ import annotations

import json
from datetime import datetime

import click

from msbot.cli.options import db_option, existing_database
from msbot.registry import PartRecord, open_registry


@click.command("parts")
@db_option
@click.option("--json", "as_json", is_flag=True, help="Print a JSON list instead of a table.")
def command(db: str | None, *, as_json: bool) -> None:
    """List every part the robot has seen: its slot, its state and since when.

    States come from the journal of transitions, which the master writes; heartbeats are never stored.
    """
    with open_registry(existing_database(db), read_only=True) as registry:
        rows = registry.parts()
    if as_json:
        click.echo(json.dumps([_as_json(row) for row in rows]))
        return
    if not rows:
        click.echo("No part has been seen yet.")
        return
    from rich.console import Console
    from rich.table import Table

    table = Table()
    for title in ("part", "number", "slot", "state", "since", "reason"):
        table.add_column(title)
    for row in rows:
        since = datetime.fromtimestamp(row.changed_ns / 1e9).strftime("%Y-%m-%d %H:%M:%S")
        table.add_row(row.name, row.part_number, row.slot or "-", row.state, since, row.reason)
    Console().print(table)


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
