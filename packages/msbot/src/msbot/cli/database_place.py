"""Which database a command uses when it names none, and what is said where there is none."""

from __future__ import annotations

from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import click

from msbot.registry.records import database_identity
from msbot_xrce.errors import ConfigError

DEFAULT_BLUEPRINT = Path("robot.toml")


def database_beside(blueprint: Path) -> str:
    """The database that belongs to a blueprint: same folder, same name, ending .db."""
    return str(blueprint.with_suffix(".db"))


def database_here() -> str:
    """The database of a command that names none: robot.db here; without a robot.toml that of the one blueprint here
    that has a database beside it."""
    own = database_beside(DEFAULT_BLUEPRINT)
    if is_there(own) or DEFAULT_BLUEPRINT.exists():
        return own
    beside = [path for one in sorted(Path().glob("*.toml")) if (path := one.with_suffix(".db")).exists()]
    return str(beside[0]) if len(beside) == 1 else own


def is_there(db: str) -> bool:
    """Whether that database exists; whether one on a server does is told when it is opened."""
    where = database_identity(db) if "://" in db else db
    return "://" in where or Path(where).exists()


def no_database(db: str) -> str:
    """What is said of a database that does not exist, wherever one is not made on purpose."""
    others = sorted(str(file) for file in Path(db).parent.glob("*.db")) if "://" not in db else []
    if others:
        return f"there is no database {db}; name the one that is meant: --db {' or --db '.join(others[:3])}"
    return (
        f"there is no database {db}: `msbot master robot.toml` or `msbot apply robot.toml` makes one; "
        "name another one with --db"
    )


def existing_database(db: str | None) -> str:
    """The database of a command that does not mean to make one.

    Raises:
        ConfigError: there is none yet.
    """
    path = db or database_here()
    if not is_there(path):
        raise ConfigError(no_database(path))
    return path


def tell_of_password(db: str) -> None:
    """Tell on standard error that the address of a database has a password in it, which others then read.

    For programs that run long, and what is written for them: `ps` shows every user their command line.
    """
    try:
        address = urlsplit(db)
        if not address.password and not parse_qs(address.query).get("password"):
            return
        port = address.port or 5432
    except ValueError:
        return  # it is no address: who opens it says so
    line = f"{address.hostname or '*'}:{port}:{address.path.lstrip('/') or '*'}:{address.username or '*'}:PASSWORD"
    click.echo(
        f"every user of this computer can read the password in --db (`ps`): leave it out, and write {line} into "
        "~/.pgpass (chmod 600), or set $PGPASSWORD",
        err=True,
    )
