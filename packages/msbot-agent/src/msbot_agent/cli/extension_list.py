"""`msbot extensions`: what other packages bring, and whether it works."""

from __future__ import annotations

import json
import logging
from collections import defaultdict
from itertools import groupby
from types import FunctionType

import click

from msbot_agent.cli import COMMANDS
from msbot_agent.cli.exit_status import ExitStatus
from msbot_agent.cli.options import json_option
from msbot_agent.startup.extensions import GROUPS, Extension, extensions


@click.command("extensions")
@json_option
def command(*, as_json: bool) -> None:
    """List the installed extensions, what each contains, and why something is left out.

    Exit status: 0 = everything works, 1 = something is left out or does not work.
    """
    logging.disable()  # what is left out is said below
    _load_all()
    found = list(extensions().listed())
    if as_json:
        click.echo(
            json.dumps(
                {
                    "extensions": [
                        {
                            "package": one.package,
                            "group": one.group,
                            "name": one.name,
                            "left_out": why,
                            "problems": extensions().problems(one),
                        }
                        for one, why in found
                    ]
                }
            )
        )
    elif not found:
        click.echo("No extension is installed. How to write one: msbot help write_an_extension")
    else:
        _print(found)
    if any(why or extensions().problems(one) for one, why in found):
        click.get_current_context().exit(ExitStatus.NO)


def _load_all() -> None:
    """Have everything loaded as it is when it is used."""
    from msbot_agent.cli.command_services import CommandService
    from msbot_agent.link import link_kinds
    from msbot_agent.space import brought_kinds

    brought = extensions()
    for name, one in brought.names("commands", COMMANDS).items():
        if not one.is_own:
            brought.get("commands", name, click.Command)
    for group in ("services", "agent_services"):
        brought.all(group, CommandService)
    link_kinds()
    brought_kinds()
    for load in brought.all("loaders", FunctionType).values():
        load()


def _print(found: list[tuple[Extension, str]]) -> None:
    width = max(len(group) for group in GROUPS)
    for package, members in groupby(found, key=lambda pair: pair[0].package):
        rows = defaultdict[str, list[tuple[str, str]]](list)
        for one, why in members:
            rows[one.group].append((one.name, f"left out: {why}" if why else "; ".join(extensions().problems(one))))
        click.echo(package)
        for group, named in rows.items():
            well = [name for name, why in named if not why]
            if well:
                click.echo(f"  {group:<{width}}  {', '.join(well)}")
            for name, why in named:
                if why:
                    click.echo(f"  {group:<{width}}  {name}  {why}")
