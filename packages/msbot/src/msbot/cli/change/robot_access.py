"""How a command reaches a robot: through its running master if there is one, else through its database."""

from __future__ import annotations

import json
import logging
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import click

from msbot.cli.database_place import database_here, existing_database, is_there, no_database
from msbot.cli.robot_options import user_name, wants_json
from msbot.registry.records import database_identity
from msbot_agent.agent import MASTER, RunningProcess, running_processes
from msbot_agent.log import TerminalHandler
from msbot_agent.process.user_folders import running_folder
from msbot_agent.startup.extensions import own_version
from msbot_agent.text.similar_names import did_you_mean, nearest
from msbot_xrce.errors import ConfigError

if TYPE_CHECKING:
    from msbot.master import Master
    from msbot.registry import RobotRecord


FOLLOWED = ("bind", "unbind", "set", "reset")
"""Operations after which parts of a running robot do something else at once."""
MOST_NAMED = 4
"""Robots that run elsewhere, in one sentence."""
MOST_DIFFERENCES = 10
"""Ports with other messages than the library's that a master tells other programs of."""


def master_details(
    master: Master, db: str, *, mark: str = "", page: str = "", trouble: str | None = None
) -> dict[str, str]:
    """What a master says about itself to other programs of its user.

    Args:
        master: the robot.
        db: its database, so that `perform` finds it.
        mark: that of its blueprint in force.
        page: the address of its page; empty when it has none.
        trouble: what is wrong with its database.
    """
    known = {
        "robot": master.profile.name,
        "serial_number": master.profile.serial_number,
        "version": master.profile.version,
        "blueprint": mark,
        "msbot": own_version(),
        "database": database_identity(db),
        "page": page,
        "stop_group": master.stop_group,
        "slots": str(len(master.inventory.slots.names())),
        "active": str(len(master.inventory.members())),
    }
    differences = [f"{part} {words}" for part, words in master.all_type_differences()]
    known |= {"type_differences": "\n".join(differences[:MOST_DIFFERENCES])} if differences else {}
    return known | {"trouble": trouble} if trouble else known


def robot_words(details: Mapping[str, object]) -> str:
    """A robot by everything that tells it from another one of the same name: what `--robot` and `--db` take.

    Args:
        details: what its master says about itself.
    """
    serial = details.get("serial_number")
    number = f"serial number {serial}, " if serial else ""
    return f"{details.get('robot')} ({number}{details.get('database')})"


def perform(db: str | None, robot: str | None, do: str, args: Mapping[str, object]) -> dict[str, object]:
    """Have an operation carried out on a robot, and return the answer.

    Args:
        db: its database; None: robot.db here, or else the one robot that runs on this computer.
        robot: its name; None: the only one.
        do: the operation, see `msbot.operations.table`.
        args: its arguments.

    Raises:
        ConfigError: it is not clear which robot is meant, or the operation says what is wrong.
        RegistryError: the database cannot be used.
    """
    logging.basicConfig(level=logging.WARNING, handlers=[TerminalHandler("%(message)s")])
    request = {"do": do, "args": {name: value for name, value in args.items() if value is not None}, "who": user_name()}
    path = db or database_here()
    is_named = db is not None or is_there(path)
    running = _find(database_identity(path) if is_named else None, robot)
    waits_s = _waits_s(do, args)
    answer = _on_database(path, robot, request) if running is None else running.ask(request, waits_s=waits_s)
    if "error" in answer:
        raise ConfigError(str(answer["error"]))
    if running is None and do in FOLLOWED:
        answer["runs"] = False
    return answer


def _waits_s(do: str, args: Mapping[str, object]) -> float:
    """How long the operation itself may wait, before its answer counts as missing."""
    seconds = args.get("seconds")
    return float(seconds) if do == "call" and isinstance(seconds, int | float) else 0.0


def say(db: str | None, robot: str | None, do: str, args: Mapping[str, object]) -> dict[str, Any]:
    """Have an operation carried out, print its outcome in words, or with `--json` as JSON, and return it."""
    answer = perform(db, robot, do, args)
    runs = answer.pop("runs", True)
    if wants_json():
        click.echo(json.dumps(answer))
        return answer
    undo = f" (`msbot undo {answer['edit']}` takes it back)" if "edit" in answer and do != "undo" else ""
    click.echo(f"{answer['words']}{undo}")
    if not runs:
        click.echo("no master runs this robot now: it is saved, and counts when one does")
    return answer


def running_master(db: str | None, robot: str | None) -> RunningProcess | None:
    """The master that is running the robot of that database, or None.

    Raises:
        ConfigError: several could be meant.
    """
    path = db or database_here()
    is_named = db is not None or is_there(path)
    return _find(database_identity(path) if is_named else None, robot)


def other_robots(db: str | None, robot: str | None) -> str:
    """How to go on where no master runs the robot that is meant: which robots run elsewhere, or how one is started."""
    others = [process.details for process in running_processes() if process.what == MASTER]
    if not others or robot is not None:
        return ": `msbot master robot.toml` or `msbot demo` starts one"
    meant = db or database_here()
    names = ", ".join(map(robot_words, others[:MOST_NAMED]))
    return f" for {meant}; on this computer runs {names}: --db FILE names its database"


class MasterConnection:
    """The running master, for commands that ask it again and again.

    Raises:
        ConfigError: no master runs here, or several could be meant.
    """

    def __init__(self, db: str | None, robot: str | None) -> None:
        master = running_master(db, robot)
        if master is None:
            raise ConfigError(f"no master runs here{other_robots(db, robot)}")
        self._master: RunningProcess = master

    def ask(self, do: str, **given: object) -> dict[str, Any]:
        """The answer to an operation.

        Raises:
            ConfigError: what the master says is wrong, or it does not answer.
        """
        args = {name: value for name, value in given.items() if value is not None}
        answer = self._master.ask({"do": do, "args": args, "who": user_name()})
        if "error" in answer:
            raise ConfigError(str(answer["error"]))
        return answer


def masters_of(db: str) -> list[RunningProcess]:
    """The masters on this computer that use a database."""
    database = database_identity(db)
    return [one for one in running_processes() if one.what == MASTER and one.details.get("database") == database]


def until_stored(db: str) -> None:
    """Before a database is read, have the masters that use it store what is waiting.

    A warning on standard error says what cannot be stored: what is then read is older than the robot's state.
    """
    logging.basicConfig(level=logging.WARNING, handlers=[TerminalHandler("%(message)s")])
    for master in masters_of(db):
        try:
            trouble = master.ask({"do": "stored", "args": {}, "who": user_name()}).get("trouble")
        except ConfigError as error:
            trouble = str(error)
        if trouble:
            click.echo(f"msbot: what follows may be older than the robot: {trouble}", err=True)


def database_to_read(db: str | None, robot: str | None) -> str:
    """The database that a command reads: the one named, robot.db here, or that of the master running here.

    Raises:
        ConfigError: there is none, or several could be meant.
    """
    if db is None and not is_there(database_here()):
        master = running_master(None, robot)
        if master is not None:
            return master.details["database"]
    return existing_database(db)


def _find(database: str | None, robot: str | None) -> RunningProcess | None:
    found = [
        process
        for process in running_processes()
        if process.what == MASTER
        and (database is None or process.details.get("database") == database)
        and (robot is None or robot in (process.details.get("robot"), process.details.get("serial_number")))
    ]
    if len(found) > 1:
        names = ", ".join(robot_words(one.details) for one in found)
        raise ConfigError(f"{len(found)} masters run here: say which robot is meant with --robot or --db: {names}")
    return found[0] if found else None


def _on_database(path: str, robot: str | None, request: Mapping[str, object]) -> dict[str, object]:
    if not is_there(path):
        raise ConfigError(f"no master runs here, and {no_database(path)}")
    from msbot.operations.dispatch import perform, stored_operations  # a running robot needs no SQLAlchemy here
    from msbot.registry import open_registry

    with open_registry(path, create=False) as registry:
        meant = one_robot(registry.database, registry.robots.all(), robot)
        if registry.runs.is_run(meant):
            raise ConfigError(
                f"robot {meant.name} runs, but its master is not among the programs in {running_folder()}: call this "
                "as the user and with the XDG_RUNTIME_DIR of the master, or on the computer where it runs"
            )

        async def act() -> dict[str, object]:
            return await perform(stored_operations(registry, meant), request)

        from msbot_agent.process.end_signals import run_to_end

        return run_to_end(act())


def one_robot(database: str, robots: Sequence[RobotRecord], name: str | None) -> RobotRecord:
    """The robot that is meant, of those of a database: by name or serial number, or the only one.

    Raises:
        ConfigError: there is none, or it is not clear which.
    """
    if not robots:
        raise ConfigError(
            f"there is no robot in the database {database} yet: `msbot apply robot.toml` or `msbot master robot.toml` "
            "puts one there"
        )
    found = [robot for robot in robots if name is None or name in (robot.name, robot.serial_number)]
    known = ", ".join(f"{robot.name} ({robot.serial_number})" for robot in robots)
    if not found:
        near = nearest(name or "", [word for robot in robots for word in (robot.name, robot.serial_number)])
        hint = did_you_mean(near) if near else f"there are {known}"
        raise ConfigError(f"the database {database} has no robot {name!r}; {hint}")
    if len(found) > 1:
        raise ConfigError(f"the database {database} has several robots: say which with --robot; {known}")
    return found[0]
