"""`msbot go`: STOP is over."""

from __future__ import annotations

import json

import click

from msbot.cli.change.stop_route import say_go
from msbot.cli.options import robot_options


@click.command("go")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@robot_options
def command(db: str | None, robot: str | None, *, as_json: bool) -> None:
    """End STOP: the parts may work again."""
    answer = say_go(db, robot)
    if as_json:
        click.echo(json.dumps({"stopped": answer["stopped"], "stored": answer["stored"]}))
        return
    click.echo("STOP is over: the parts may work again")
    if answer["trouble"]:
        click.echo(f"{answer['trouble']}; after a restart of the master STOP may hold again")
    elif not answer["stored"]:
        click.echo("this is not stored yet: if the master is started anew before, STOP may hold again")
