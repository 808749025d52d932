"""`msbot clients`: the sessions of every agent and master that runs on this computer."""

from __future__ import annotations

import json
import logging

import click

from msbot_agent.agent import read_statuses
from msbot_agent.log.terminal_log import TerminalHandler


@click.command("clients")
@click.option("--json", "as_json", is_flag=True, help="Print a JSON list of agents instead of tables.")
def command(*, as_json: bool) -> None:
    """List the clients of every agent and master that you run on this computer.

    For each: its key and session, where it is, its objects, its streams, what it sent and got, and what was dropped.
    """
    from msbot_agent.cli.agent.clients_view import as_dict, show

    logging.basicConfig(level=logging.WARNING, handlers=[TerminalHandler("%(message)s")])
    statuses = read_statuses()
    if as_json:
        click.echo(json.dumps([as_dict(status) for status in statuses]))
    elif not statuses:
        click.echo("No agent or master of yours is running on this computer.")
    else:
        show(statuses)
