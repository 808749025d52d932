"""`msbot diff`: compare a blueprint with the database."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import click

from msbot.cli.blueprint.differences_view import as_json as differences_json
from msbot.cli.blueprint.differences_view import empty_like, plan_lines
from msbot.cli.robot_options import DEFAULT_BLUEPRINT, database_beside, db_option, is_there, library_option
from msbot.config import Blueprint, Difference, Library, differences, open_blueprint
from msbot.registry import open_registry, without_password


@click.command("diff")
@click.argument("blueprint", type=click.Path(path_type=Path), default=DEFAULT_BLUEPRINT)
@library_option
@db_option
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object: apply and by_hand.")
def command(blueprint: Path, folders: tuple[Path, ...], db: str | None, *, as_json: bool) -> None:
    """Show what `msbot apply` would change, and what was changed by hand. Status 1 when apply would change something.

    `+` is added, `-` removed, `~` changed.
    """
    wanted, library = open_blueprint(blueprint, *folders)
    address = db or database_beside(blueprint)
    to_apply, by_hand, is_new = _compare(wanted, library, address)
    words = without_password(address)
    if as_json:
        told = {"apply": differences_json(to_apply), "by_hand": differences_json(by_hand), "new": is_new}
        click.echo(json.dumps(told))
    else:
        for line in _words(blueprint, words, to_apply, by_hand, is_new=is_new):
            click.echo(line)
    if to_apply or is_new:
        sys.exit(1)


def _compare(
    wanted: Blueprint, library: Library, address: str
) -> tuple[tuple[Difference, ...], tuple[Difference, ...], bool]:
    """What apply would change, what was changed by hand, and whether the robot is new to the database."""
    if is_there(address):
        with open_registry(address, read_only=True) as registry:
            robot = registry.robots.find(wanted)
            if robot is not None:
                applied = registry.robots.blueprint(robot, by_hand=False)
                to_apply = (*differences(applied, wanted), *registry.robots.type_differences(library))
                return to_apply, differences(applied, registry.robots.blueprint(robot)), False
    return differences(empty_like(wanted), wanted), (), True


def _words(
    blueprint: Path, address: str, to_apply: tuple[Difference, ...], by_hand: tuple[Difference, ...], *, is_new: bool
) -> list[str]:
    lines = []
    if is_new:
        lines += [
            f"{address} does not have this robot; `msbot apply {blueprint}` would make it:"
            if is_there(address)
            else f"there is no database {address} yet; `msbot apply {blueprint}` would make it, with this robot:",
            *plan_lines(to_apply),
        ]
    elif to_apply:
        lines += [f"`msbot apply {blueprint}` would change in {address}:", *plan_lines(to_apply)]
    else:
        lines.append(f"{address} has what {blueprint} says.")
    if by_hand:
        lines += ["Changed by hand, which stays (`msbot export` writes it down):", *plan_lines(by_hand)]
    return lines
