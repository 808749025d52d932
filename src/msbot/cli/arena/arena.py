"""`msbot arena`: check and show the worlds that simulated robots drive in."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import click

from msbot.cli.options import json_option
from msbot.errors import ConfigError


@click.group("arena")
def command() -> None:
    """Worlds for simulated robots: list those that MsBOT brings, check a world file, show what is in one."""


@command.command("list")
@json_option
def list_worlds(*, as_json: bool) -> None:
    """List the worlds that MsBOT brings."""
    from msbot.cli.arena.view import world_json
    from msbot.sim.arena.world_reader import open_world, shipped_worlds

    worlds = [(name, open_world(name)) for name in shipped_worlds()]
    if as_json:
        click.echo(json.dumps([{"name": name, **world_json(world)} for name, world in worlds]))
        return
    for name, world in worlds:
        click.echo(f"{name:<10} {world.name}: {world.description}")


@command.command("check")
@click.argument("world", metavar="FILE")
@json_option
def check(world: str, *, as_json: bool) -> None:
    """Check a world file: every mistake is told with file, line and what would be right (exit status 2)."""
    from msbot.config import FoundProblems, problems_json
    from msbot.sim.arena.world_reader import open_world

    try:
        plan = open_world(world)
    except FoundProblems as found:
        if not as_json:
            raise
        click.echo(json.dumps({"problems": problems_json(found)}))
        sys.exit(2)
    if as_json:
        click.echo(json.dumps({"problems": []}))
        return
    click.echo(f"No mistake: {plan.name}, {plan.width_m:g} x {plan.height_m:g} m.")


@command.command("show")
@click.argument("world", metavar="FILE|NAME")
@click.option("--svg", metavar="FILE", type=click.Path(path_type=Path), help="Write its picture to an SVG file.")
@json_option
def show(world: str, svg: Path | None, *, as_json: bool) -> None:
    """Show what is in a world: its size, things, and robots."""
    from msbot.cli.arena.view import world_json, world_page
    from msbot.sim.arena.drawing import world_svg
    from msbot.sim.arena.world_reader import open_world

    plan = open_world(world)
    if svg is not None:
        try:
            svg.write_text(world_svg(plan), encoding="utf-8")
        except OSError as error:
            raise ConfigError(f"cannot write {svg}: {error.strerror}") from None
    click.echo(json.dumps(world_json(plan)) if as_json else world_page(plan))
