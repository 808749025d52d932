"""`msbot export`: write a robot of the database as a blueprint."""

from __future__ import annotations

from pathlib import Path

import click

from msbot.cli.look.one_robot import one_robot
from msbot.cli.robot_options import db_option, existing_database, robot_option
from msbot.config import blueprint_toml
from msbot.registry import open_registry
from msbot_xrce.errors import ConfigError


@click.command("export")
@click.argument("file", type=click.Path(path_type=Path), required=False)
@click.option("--without-hand", is_flag=True, help="As it was applied last, without what was changed by hand.")
@robot_option
@db_option
def command(file: Path | None, robot: str | None, db: str | None, *, without_hand: bool) -> None:
    """Write a robot of the database to FILE as a blueprint, or to standard output; an existing file stays as it is.

    What was set by hand is in it, with a remark who did it: applied again, it belongs to the blueprint.
    """
    address = existing_database(db)
    with open_registry(address, read_only=True) as registry:
        record = one_robot(registry.database, registry.robots.all(), robot)
        blueprint = registry.robots.blueprint(record, by_hand=not without_hand)
        notes = {} if without_hand else registry.robots.made_by_hand(record)
        where = registry.database
    text = f"# Robot {record.name}, written by `msbot export` from {where}.\n\n{blueprint_toml(blueprint, notes)}"
    if file is None:
        click.echo(text, nl=False)
        return
    try:
        with file.open("x", encoding="utf-8") as stream:
            stream.write(text)
    except FileExistsError:
        raise ConfigError(f"{file}: exists already and is not overwritten; name another file") from None
    except OSError as error:
        raise ConfigError(f"{file}: cannot be written ({error.strerror}); name another file") from None
    click.echo(f"{file} is written: robot {record.name}.")
