"""`msbot slot`: new roles in a robot, written into its blueprint and applied at once."""

from __future__ import annotations

import json
import os
from pathlib import Path

import click

from msbot.cli.blueprint.apply import put_in_force
from msbot.cli.change.robot_access import say
from msbot.cli.robot_options import (
    DEFAULT_BLUEPRINT,
    answer_options,
    database_beside,
    db_option,
    existing_database,
    library_option,
)
from msbot.config import Slot, open_blueprint, parse_blueprint, slot_toml
from msbot.registry import open_registry
from msbot_agent.cli.options import json_option
from msbot_xrce.errors import ConfigError


@click.group("slot")
def command() -> None:
    """The slots of a robot: its roles, which parts fill."""


@command.command("add")
@click.argument("name")
@click.argument("part")
@click.option("--description", default="", help="What it is for, in words.")
@click.option("--local-name", default="", metavar="LOCAL", help="Only the part that shows this local name asks for it.")
@click.option("--blueprint", type=click.Path(path_type=Path), default=DEFAULT_BLUEPRINT, show_default=True,
              help="The robot's blueprint; the slot is written to its end.")  # fmt: skip
@library_option
@db_option
@json_option
def add(
    name: str, part: str, *, description: str, local_name: str, blueprint: Path, folders: tuple[Path, ...],
    db: str | None, as_json: bool,
) -> None:  # fmt: skip
    """Give the robot a slot NAME that takes parts of the number PART.

    It is written to the end of robot.toml, whose other lines stay as they are, and put into force, in a running robot
    at once: a part of that number that waits gets it.
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


@command.command("remove")
@click.argument("slot")
@answer_options
def remove(slot: str, db: str | None, robot: str | None) -> None:
    """Take SLOT out of a robot that runs, with its ends of topics; a part in it is delisted.

    `msbot undo` brings it back. The blueprint's file stays as it is: `msbot export` writes what holds now.
    """
    say(db, robot, "remove_slot", {"slot": slot})


def _replace(path: Path, content: bytes) -> None:
    """Rewrite a file, whole or not at all."""
    draft = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        draft.write_bytes(content)
        draft.chmod(path.stat().st_mode)
        draft.replace(path)
    except OSError as error:
        draft.unlink(missing_ok=True)
        raise ConfigError(f"{path}: cannot be written ({error.strerror})") from None
