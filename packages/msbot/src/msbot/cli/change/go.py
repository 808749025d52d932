"""`msbot go`: STOP is over."""

from __future__ import annotations

import json

import click

from msbot.cli.change.stop_route import Meant, say_go
from msbot.cli.robot_options import robot_options, stop_group_option
from msbot_agent.cli.numbers import WholeRange


@click.command("go")
@click.option("--stop", "number", type=WholeRange(1), help="End this STOP, and none that was said after it.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@stop_group_option
@robot_options
def command(db: str | None, robot: str | None, *, number: int | None, as_json: bool, stop_group: str | None) -> None:
    """End STOP at one robot: its parts may work again. Where several run, say which one."""
    answer = say_go(Meant(db, robot, stop_group), number)
    if as_json:
        click.echo(json.dumps({"stopped": answer["stopped"], "stored": answer["stored"]}))
        return
    click.echo("STOP is over: the parts may work again")
    if answer["trouble"]:
        click.echo(f"{answer['trouble']}; after a restart of the master STOP may hold again")
    elif not answer["stored"]:
        click.echo("this is not stored yet: if the master is started anew before, STOP may hold again")
