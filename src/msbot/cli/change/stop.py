"""`msbot stop`: all parts go to their safe states; shows which have obeyed and which have not."""

from __future__ import annotations

import json
import time
from datetime import datetime

import click

from msbot.cli.change.stop_route import say_stop, stop_status
from msbot.cli.options import robot_options

PATIENCE_S = 2.0
"""How long the command waits for the parts to confirm."""
LOOK_S = 0.02


@click.command("stop")
@click.option("--reason", default="", help="Why, for the people who see it.")
@click.option("--status", "only_status", is_flag=True, help="Only tell whether STOP holds.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@robot_options
def command(reason: str, db: str | None, robot: str | None, *, only_status: bool, as_json: bool) -> None:
    """STOP: every part goes to its safe state at once, and stays there until `msbot go`."""
    if only_status:
        _show_status(stop_status(db, robot), as_json=as_json)
        return
    said = say_stop(db, robot, reason)
    status = said
    until = time.monotonic() + PATIENCE_S
    while status["silent"] and status["stopped"] and time.monotonic() < until:
        time.sleep(LOOK_S)
        status = stop_status(db, robot)
    if as_json:
        click.echo(json.dumps({name: status[name] for name in ("told", "confirmed", "silent", "stored")}))
        return
    for line in _words(status):
        click.echo(line)


def _show_status(status: dict[str, object], *, as_json: bool) -> None:
    if as_json:
        click.echo(json.dumps({name: status[name] for name in ("stopped", "by", "since")}))
        return
    since = status["since"]
    if not status["stopped"] or not isinstance(since, int | float):
        click.echo("no STOP holds")
        return
    why = f": {status['reason']}" if status["reason"] else ""
    click.echo(f"STOP since {datetime.fromtimestamp(since):%Y-%m-%d %H:%M:%S}, said by {status['by']}{why}")
    for line in _words(status):
        click.echo(line)


def _words(status: dict[str, object]) -> list[str]:
    confirmed, silent = status["confirmed"], status["silent"]
    assert isinstance(confirmed, list)
    assert isinstance(silent, list)
    lines = []
    if not status["told"]:
        lines.append("STOP holds; no part is in the robot")
    elif silent:
        lines.append(f"STOP: {len(confirmed)} of {status['told']} parts have confirmed it")
        lines.append(f"NOT confirmed: {', '.join(silent)}: they may still move")
    else:
        slowest = max(float(one["ms"]) for one in confirmed)
        who = "the one part has" if len(confirmed) == 1 else f"all {len(confirmed)} parts have"
        lines.append(f"STOP: {who} confirmed it within {slowest:.1f} ms")
    if status["trouble"]:
        lines.append(f"{status['trouble']}; it holds as long as this master runs")
    return lines
