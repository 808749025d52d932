"""`msbot apply`: apply a changed blueprint."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import click

from msbot.cli.blueprint.differences_view import as_json as differences_json
from msbot.cli.blueprint.differences_view import empty_like, plan_lines
from msbot.cli.robot_options import DEFAULT_BLUEPRINT, database_beside, db_option, library_option, user_name
from msbot.config import Blueprint, Library, differences, open_blueprint
from msbot.registry import Registry, open_registry
from msbot_xrce.errors import ConfigError


@click.command("apply")
@click.argument("blueprint", type=click.Path(path_type=Path), default=DEFAULT_BLUEPRINT)
@library_option
@db_option
@click.option("--yes", is_flag=True, help="Do not ask.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object; needs --yes.")
def command(blueprint: Path, folders: tuple[Path, ...], db: str | None, *, yes: bool, as_json: bool) -> None:
    """Show what BLUEPRINT (robot.toml) would change in the database, ask, and change it.

    While a master runs the robot it is changed through it, and holds at once. What was changed by hand stays;
    `msbot undo` takes everything back.
    """
    if as_json and not yes:
        raise click.UsageError("--json does not ask: add --yes")
    wanted, library = open_blueprint(blueprint, *folders)
    with open_registry(db or database_beside(blueprint)) as registry:
        robot = registry.robots.find(wanted)
        present = empty_like(wanted) if robot is None else registry.robots.blueprint(robot, by_hand=False)
        plan = (*differences(present, wanted), *registry.robots.type_differences(library))
        words = "nothing to change"
        if not as_json:
            _show(registry, blueprint, plan_lines(plan), is_new=robot is None)
        if plan or robot is None:
            if not yes and not agreed():
                raise click.Abort
            words = put_in_force(registry, wanted, library, blueprint, folders)
    if as_json:
        click.echo(json.dumps({"changed": differences_json(plan), "words": words}))
    elif plan or robot is None:
        click.echo(words)


def _show(registry: Registry, blueprint: Path, lines: list[str], *, is_new: bool) -> None:
    if is_new:
        click.echo(f"{registry.database} gets a new robot:")
    elif lines:
        click.echo(f"{blueprint} changes in {registry.database}:")
    else:
        click.echo(f"{registry.database} has what {blueprint} says: nothing to change.")
    for line in lines:
        click.echo(line)


def agreed() -> bool:
    """Ask whether to change it.

    Raises:
        ConfigError: nobody is there to ask.
    """
    if not sys.stdin.isatty():
        raise ConfigError("nobody is there to ask: add --yes to change it without asking")
    return click.confirm("Change it?")


def put_in_force(
    registry: Registry, wanted: Blueprint, library: Library, blueprint: Path, folders: tuple[Path, ...]
) -> str:
    """Store a blueprint; a running robot changes at once. Returns what was done, in words.

    Raises:
        ConfigError: it is another robot's blueprint, or the master refuses it.
        RegistryError: it cannot be stored; nothing has changed.
    """
    robot = registry.robots.find(wanted)
    if robot is not None and registry.runs.is_run(robot):
        from msbot.cli.change.robot_access import perform

        arguments = {"path": str(blueprint.resolve()), "folders": [str(folder.resolve()) for folder in folders]}
        return str(perform(registry.database, robot.name, "apply", arguments)["words"])
    if robot is not None:
        registry.runs.begin(robot)  # so that no master starts in between
    made = registry.robots.apply_blueprint(wanted, library, user_name())
    if robot is None:
        return f"robot {made.name} is in the database now"
    return f"robot {made.name} is as {blueprint} says; `msbot undo` takes it back"
