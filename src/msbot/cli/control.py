"""How a command reaches a robot: its running master if there is one, else its database, while nobody runs it."""

from __future__ import annotations

import getpass
import logging
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TypeVar

import click

from msbot.agent import RunningProcess, running_processes
from msbot.cli.options import DEFAULT_BLUEPRINT, database_beside, db_option
from msbot.errors import ConfigError

MASTER = "master"

_C = TypeVar("_C", bound=Callable[..., object])


def robot_options(function: _C) -> _C:
    """The options of every command that changes a robot: which one."""
    robot = click.option("--robot", metavar="NAME", help="The robot's name, where several run or share a database.")
    return db_option(robot(function))


def details_of(robot: str, db: str, trouble: str | None = None) -> dict[str, str]:
    """What a master says of itself, so that `perform` finds it, and what is wrong with its database."""
    known = {"robot": robot, "database": database_identity(db)}
    return known | {"trouble": trouble} if trouble else known


def database_identity(db: str) -> str:
    """One spelling for each database: the whole path of a file; a server's address without user and password."""
    scheme, separator, rest = db.partition("://")
    if not separator:
        return str(Path(db).absolute())
    if scheme == "sqlite":
        return str(Path(rest.removeprefix("/")).absolute())
    return f"{scheme.partition('+')[0]}://{rest.rpartition('@')[2]}"


def perform(db: str | None, robot: str | None, do: str, args: Mapping[str, object]) -> dict[str, object]:
    """Have something done to a robot, and give the answer.

    Args:
        db: its database; None: robot.db here, or else the one robot that runs on this computer.
        robot: its name; None: it is clear which one is meant.
        do: the operation, see `msbot.operations.requests`.
        args: what it takes.

    Raises:
        ConfigError: it is not clear which robot is meant, or the operation says what is wrong.
        RegistryError: the database cannot be used.
    """
    logging.basicConfig(level=logging.WARNING, format="%(message)s")
    request = {"do": do, "args": {name: value for name, value in args.items() if value is not None}, "who": _user()}
    path = db or database_beside(DEFAULT_BLUEPRINT)
    is_named = db is not None or Path(path).exists()
    running = _find(database_identity(path) if is_named else None, robot)
    answer = _on_database(path, robot, request) if running is None else running.ask(request)
    if "error" in answer:
        raise ConfigError(str(answer["error"]))
    return answer


def say(db: str | None, robot: str | None, do: str, args: Mapping[str, object]) -> None:
    """Have something done, and print what came of it."""
    answer = perform(db, robot, do, args)
    undo = f" (`msbot undo {answer['edit']}` takes it back)" if "edit" in answer and do != "undo" else ""
    click.echo(f"{answer['words']}{undo}")


def running_master(db: str | None, robot: str | None) -> RunningProcess | None:
    """The master that runs the robot with that database, or None.

    Raises:
        ConfigError: several could be meant.
    """
    path = db or database_beside(DEFAULT_BLUEPRINT)
    is_named = db is not None or Path(path).exists()
    return _find(database_identity(path) if is_named else None, robot)


def _find(database: str | None, robot: str | None) -> RunningProcess | None:
    found = [
        process
        for process in running_processes()
        if process.what == MASTER
        and (database is None or process.details.get("database") == database)
        and (robot is None or process.details.get("robot") == robot)
    ]
    if len(found) > 1:
        names = ", ".join(f"{one.details.get('robot')} ({one.details.get('database')})" for one in found)
        raise ConfigError(f"{len(found)} masters run here: say which robot is meant with --robot or --db: {names}")
    return found[0] if found else None


def _on_database(path: str, robot: str | None, request: Mapping[str, object]) -> dict[str, object]:
    if "://" not in path and not Path(path).exists():
        raise ConfigError(
            f"no master runs here, and there is no database {path}: start `msbot master`, or name one with --db"
        )
    from msbot.operations import StoredOperations, perform  # so that a running robot is reached without SQLAlchemy
    from msbot.registry import open_registry

    with open_registry(path, create=False) as registry:
        robots = [one for one in registry.robots() if robot in (None, one.name)]
        if len(robots) != 1:
            names = ", ".join(one.name for one in registry.robots()) or "none"
            raise ConfigError(f"the database {path} has the robots {names}: say which one is meant with --robot")
        return perform(StoredOperations(registry, robots[0]), request)


def _user() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return "somebody"
