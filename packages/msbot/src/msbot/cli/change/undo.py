"""`msbot undo`: undo a change."""

from __future__ import annotations

import json
from datetime import datetime

import click

from msbot.cli.change.robot_access import perform, say
from msbot.cli.robot_options import answer_options, wants_json
from msbot_agent.cli.numbers import WholeRange


@click.command("undo")
@click.argument("number", type=WholeRange(1, 2**53), required=False)
@click.option("--list", "show", is_flag=True, help="Show what was changed lately, the newest last, and change nothing.")
@click.option("--last", type=WholeRange(1, 10_000), default=20, show_default=True, help="How many --list shows.")
@answer_options
def command(number: int | None, last: int, db: str | None, robot: str | None, *, show: bool) -> None:
    """Take change NUMBER back, or the newest one; what a spare took over by itself is a change, too."""
    if not show:
        say(db, robot, "undo", {"edit": number})
        return
    edits = perform(db, robot, "edits", {"limit": last})["edits"]
    assert isinstance(edits, list)
    if wants_json():
        click.echo(json.dumps(edits[::-1]))
        return
    for edit in reversed(edits):
        when = datetime.fromtimestamp(edit["at_ns"] / 1e9).strftime("%Y-%m-%d %H:%M:%S")
        undone = "  (taken back)" if edit["undone"] else ""
        click.echo(f"{edit['id']:>5}  {when}  {edit['who']}: {edit['words']}{undone}")
    if not edits:
        click.echo("Nothing was changed yet.")
