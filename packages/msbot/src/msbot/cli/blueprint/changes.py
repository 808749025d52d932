"""`msbot diff`: compare a blueprint with the database."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import click

from msbot.cli import completers
from msbot.cli.blueprint.differences_view import as_json as differences_json
from msbot.cli.blueprint.differences_view import empty_like, plan_lines
from msbot.cli.change.robot_access import say
from msbot.cli.database_place import DEFAULT_BLUEPRINT, database_beside, existing_database, is_there
from msbot.cli.robot_options import db_option, library_option, robot_and_json_options, user_name
from msbot.config import Blueprint, Difference, Library, Slot, differences, open_blueprint, parse_blueprint, slot_toml
from msbot.registry import Registry, open_registry, without_password
from msbot_agent.cli.exit_status import ExitStatus
from msbot_agent.cli.options import json_option
from msbot_agent.process.user_folders import replace_file
from msbot_xrce.errors import ConfigError


@click.command("diff")
@click.argument("blueprint", type=click.Path(path_type=Path), default=DEFAULT_BLUEPRINT)
@library_option
@db_option
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object: apply and by_hand.")
def diff_command(blueprint: Path, folders: tuple[Path, ...], db: str | None, *, as_json: bool) -> None:
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
        sys.exit(ExitStatus.NO)


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


# `msbot apply`: apply a changed blueprint.


@click.command("apply")
@click.argument("blueprint", type=click.Path(path_type=Path), default=DEFAULT_BLUEPRINT)
@library_option
@db_option
@click.option("--yes", is_flag=True, help="Do not ask.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object; needs --yes.")
def apply_command(blueprint: Path, folders: tuple[Path, ...], db: str | None, *, yes: bool, as_json: bool) -> None:
    """Show what BLUEPRINT (robot.toml) would change, ask, and apply it.

    If a master runs the robot, the change is in force at once. What was changed by hand stays; `msbot undo` reverts
    the change.
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


# `msbot slot`: new roles in a robot, written into its blueprint and applied at once.


@click.group("slot")
def slot_command() -> None:
    """The slots of a robot: its roles, which parts fill."""


@slot_command.command("add")
@click.argument("name")
@click.argument("part", shell_complete=completers.part_numbers)
@click.option("--description", default="", help="What it is for, in words.")
@click.option("--local-name", default="", metavar="LOCAL", help="Local name of the part that the slot is meant for.")
@click.option(
    "--blueprint",
    type=click.Path(path_type=Path),
    default=DEFAULT_BLUEPRINT,
    show_default=True,
    help="The robot's blueprint; the slot is written to its end.",
)
@library_option
@db_option
@json_option
def add(
    name: str,
    part: str,
    *,
    description: str,
    local_name: str,
    blueprint: Path,
    folders: tuple[Path, ...],
    db: str | None,
    as_json: bool,
) -> None:
    """Append a slot NAME for part number PART to robot.toml and apply it at once.

    The other lines of robot.toml stay as they are. In a running robot, a waiting part of that number gets the slot
    at once.
    """
    _, library = open_blueprint(blueprint, *folders)
    before = blueprint.read_bytes()
    table = slot_toml(Slot(name, part, local_name, description))
    end = b"" if before.endswith(b"\n") else b"\n"
    after = before + end + f"\n{table}".encode()
    wanted = parse_blueprint(after.decode("utf-8-sig"), library, str(blueprint))
    # One that is named is meant to be there; a robot that is just being made gets one beside its blueprint.
    address = database_beside(blueprint) if db is None else existing_database(db)
    _replace(blueprint, after)
    try:
        with open_registry(address) as registry:
            words = put_in_force(registry, wanted, library, blueprint, folders)
    except Exception:
        _replace(blueprint, before)  # the file must say what is in force
        raise
    if as_json:
        click.echo(json.dumps({"words": words, "slot": name, "part": part}))
    else:
        click.echo(f"slot {name} is now in {blueprint}; {words}")


@slot_command.command("remove")
@click.argument("slot", shell_complete=completers.slots)
@robot_and_json_options
def remove(slot: str, db: str | None, robot: str | None) -> None:
    """Remove SLOT and its wires from a running robot; its part is delisted.

    `msbot undo` brings it back. The blueprint's file stays as it is: `msbot export` writes what holds now.
    """
    say(db, robot, "remove_slot", {"slot": slot})


def _replace(path: Path, content: bytes) -> None:
    """Rewrite the file, whole or not at all."""
    try:
        replace_file(path, content)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written ({error.strerror})") from None
