"""`msbot extensions`: what other packages bring, and whether it works."""

from __future__ import annotations

import json
import logging
from collections import defaultdict
from itertools import groupby

import click

from msbot.cli import COMMANDS
from msbot.cli.options import json_option
from msbot.runtime.extensions import GROUPS, Extension, extensions


@click.command("extensions")
@json_option
def command(*, as_json: bool) -> None:
    """List the extensions that are installed: what each brings, and why something of it is left out.

    Exit status: 0 = everything works, 1 = something is left out.
    """
    logging.disable()  # what is left out is said below
    _load_all()
    found = list(extensions().listed())
    if as_json:
        click.echo(
            json.dumps(
                {
                    "extensions": [
                        {"package": one.package, "group": one.group, "name": one.name, "left_out": why}
                        for one, why in found
                    ]
                }
            )
        )
    elif not found:
        click.echo("No extension is installed. How to write one: docs/howto/write_an_extension.md")
    else:
        _print(found)
    if any(why for _, why in found):
        click.get_current_context().exit(1)


def _load_all() -> None:
    """Have everything loaded as it is when it is used."""
    from msbot.config import load_library
    from msbot.doctor import all_checks
    from msbot.lab.faults.kinds import KINDS
    from msbot.lab.missions.mission_file import ready_missions
    from msbot.link import link_kinds
    from msbot.space import brought_kinds

    brought = extensions()
    brought.all("commands", click.Command, COMMANDS)
    link_kinds()
    brought_kinds()
    load_library()
    brought.folders("lessons")
    ready_missions()
    len(KINDS)
    list(all_checks())
    brought.all("routes", object)
    if brought.names("pages"):
        from msbot.web.pages.extension_page import brought_pages

        brought_pages()


def _print(found: list[tuple[Extension, str]]) -> None:
    width = max(len(group) for group in GROUPS)
    for package, members in groupby(found, key=lambda pair: pair[0].package):
        rows = defaultdict[str, list[tuple[str, str]]](list)
        for one, why in members:
            rows[one.group].append((one.name, why))
        click.echo(package)
        for group, named in rows.items():
            well = [name for name, why in named if not why]
            if well:
                click.echo(f"  {group:<{width}}  {', '.join(well)}")
            for name, why in named:
                if why:
                    click.echo(f"  {group:<{width}}  {name}  left out: {why}")
