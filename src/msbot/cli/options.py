"""What several commands share: where the database is, and how to say what went wrong."""

from __future__ import annotations

import getpass
from pathlib import Path

import click

from msbot.errors import ConfigError

DEFAULT_BLUEPRINT = Path("robot.toml")
DEFAULT_LINK = "udp:127.0.0.1:8888"

db_option = click.option(
    "--db",
    metavar="FILE",
    help="The robot's database; robot.db beside the blueprint unless told otherwise.",
)


def database_beside(blueprint: Path) -> str:
    """The database that belongs to a blueprint: same folder, same name, ending .db."""
    return str(blueprint.with_suffix(".db"))


def existing_database(db: str | None) -> str:
    """The database to read.

    Raises:
        ConfigError: there is none yet.
    """
    path = db or database_beside(DEFAULT_BLUEPRINT)
    if "://" not in path and not Path(path).exists():
        raise ConfigError(
            f"there is no database {path}: `msbot master` makes it when a robot runs; name another one with --db"
        )
    return path


def user_name() -> str:
    """Who gives a command, for the record of what people change."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return "somebody"
