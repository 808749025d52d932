"""`msbot hardware`: what is plugged into this computer."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from pathlib import Path

import click

from msbot.cli.robot_options import library_here, library_option
from msbot_agent.cli.group import complain
from msbot_agent.cli.options import json_option


@click.group("hardware")
def command() -> None:
    """The hardware of this computer."""


@command.command("scan")
@library_option
@json_option
def scan_command(folders: tuple[Path, ...], *, as_json: bool) -> None:
    """Find chips, USB modules, thermometers, converters and CAN interfaces, and how each becomes a part."""
    from msbot.hardware import Machine, scan

    result = scan(Machine(), library_here(folders))
    if as_json:
        click.echo(json.dumps(asdict(result), ensure_ascii=False))
    else:
        for thing in result.found:
            click.echo(f"{thing.where}: {thing.words}")
            for line in thing.lines:
                click.echo(f"    {line}")
        for fault in result.faults:
            complain(fault)
        if not result.found and not result.faults:
            click.echo("Nothing is plugged in that can be found: parts at plain pins do not answer.")
    sys.exit(1 if result.faults else 0)
