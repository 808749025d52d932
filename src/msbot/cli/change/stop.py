"""`msbot stop`: all parts go to their safe states; shows which have obeyed and which have not."""

from __future__ import annotations

import json
import time
from datetime import datetime

import click

from msbot.cli.change.stop_route import say_stop, stop_status
from msbot.cli.options import robot_options
from msbot.errors import ConfigError
from msbot.runtime.amount import amount

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
    while status["not_confirmed"] and status["stopped"] and time.monotonic() < until:
        time.sleep(LOOK_S)
        status = stop_status(db, robot)
    status["unreached"] = said["unreached"]
    if as_json:
        names = ["told", "confirmed", "silent", "stored", *(name for name in ("left_out",) if status.get(name))]
        click.echo(json.dumps({name: status[name] for name in names}))
    else:
        for line in _words(status):
            click.echo(line)
    if status["unreached"]:
        raise ConfigError(f"NOT delivered to {_others(status)}: cut the power of their robots")


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
    if status["unreached"]:
        click.echo(f"not known: {_others(status)}")


def _words(status: dict[str, object]) -> list[str]:
    confirmed, silent = status["confirmed"], status["silent"]
    assert isinstance(confirmed, list)
    assert isinstance(silent, list)
    count, left_out = status["not_confirmed"], status.get("left_out", 0)
    assert isinstance(count, int)
    lines = []
    if not status["stopped"]:
        return ["STOP has been ended meanwhile: `msbot go`, or the page"]
    if not status["told"]:
        lines.append("STOP holds; no part is in the robot")
    elif count:
        told = status["told"]
        assert isinstance(told, int)
        lines.append(
            f"STOP: {told - count} of {amount(told, 'part')} {'has' if told - count == 1 else 'have'} confirmed it"
        )
        others = f" and {amount(count - len(silent), 'other')}" if count > len(silent) else ""
        lines.append(f"NOT confirmed: {', '.join(silent)}{others}: {'it' if count == 1 else 'they'} may still move")
    else:
        slowest = max((float(one["ms"]) for one in confirmed), default=0.0)
        time_words = "" if left_out else f" within {slowest:.1f} ms"
        who = "the one part has" if status["told"] == 1 else f"all {status['told']} parts have"
        lines.append(f"STOP: {who} confirmed it{time_words}")
    if status["trouble"]:
        lines.append(f"{status['trouble']}; it holds as long as this master runs")
    elif not status["stored"]:
        lines.append("STOP is not stored yet: as long as it is not, it ends with this master")
    return lines


def _others(status: dict[str, object]) -> str:
    """Masters that may be meant, in words."""
    count = status["unreached"]
    return "a master that runs here and does not answer" if count == 1 else f"{count} masters that do not answer"
