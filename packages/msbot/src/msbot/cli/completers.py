"""What a shell completes besides commands and options: the names that a robot has, and those of part types.

Click calls these when somebody presses Tab. They look into the database that the command would use, a file with
Python's own sqlite3, and never say what is wrong: where nothing can be found in time, nothing is completed.
"""

from __future__ import annotations

import re
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click
from click.shell_completion import CompletionItem

if TYPE_CHECKING:
    from msbot.registry import Registry, RobotRecord
    from msbot.registry.read_only_database import ReadOnlyDatabase

PATIENCE_S = 0.25
"""Whoever presses Tab waits no longer for names."""
PATIENCE_SERVER_S = 2.0
"""The same where the database is at a server: SQLAlchemy and a driver are imported before."""
MOST_NAMES = 500
_PLAIN = re.compile(r"[\w.:@%/+,=-]{1,100}")
"""Names that no shell takes for more than one word, or for something to do; others are not completed."""

Names = Callable[["ReadOnlyDatabase | _Server", "RobotRecord", click.Context], Iterable[str]]
Completer = Callable[[click.Context, click.Parameter, str], list[CompletionItem]]


def in_time(find: Callable[[], Iterable[str]], incomplete: str, patience_s: float = PATIENCE_S) -> list[CompletionItem]:
    """The names that begin like that, as far as they are found in time.

    Args:
        find: finds all names; it runs in a thread, which is left behind when it takes too long.
        incomplete: what is typed already; case does not matter.
        patience_s: how long is waited for them.
    """
    found = list[str]()

    def look() -> None:
        with suppress(Exception):  # a shell in which somebody types is no place for what is wrong with a database
            found.extend(find())

    worker = threading.Thread(target=look, daemon=True)
    worker.start()
    worker.join(patience_s)
    begins = incomplete.casefold()
    names = [one for one in dict.fromkeys(found) if _PLAIN.fullmatch(one) and one.casefold().startswith(begins)]
    return [CompletionItem(one) for one in names[:MOST_NAMES]]


def _of_robots(names: Names, context: click.Context, _: click.Parameter, incomplete: str) -> list[CompletionItem]:
    database = _database(context)
    patience_s = PATIENCE_SERVER_S if "://" in database else PATIENCE_S
    return in_time(lambda: _look(names, context, database), incomplete, patience_s)


def _look(names: Names, context: click.Context, database: str) -> Iterator[str]:
    from msbot.registry.read_only_database import look_into

    if "://" in database:
        from msbot.registry import open_registry

        with open_registry(database, read_only=True) as registry:
            yield from _names_in(_Server(registry), names, context)
        return
    look = look_into(database)
    if look is not None:
        with look:
            yield from _names_in(look, names, context)


def _names_in(look: ReadOnlyDatabase | _Server, names: Names, context: click.Context) -> Iterator[str]:
    wanted = context.params.get("robot")
    for robot in look.robots():
        if names is _robots or wanted in (None, robot.name, robot.serial_number):
            yield from names(look, robot, context)


class _Server:
    """What is asked of a `ReadOnlyDatabase`, of a database that is no file."""

    def __init__(self, registry: Registry) -> None:
        self._registry = registry
        self.robots = registry.robots.all
        self.slot_names = registry.robots.slot_names
        self.parts = registry.robots.parts
        self.slot_types = registry.robots.slot_types

    def topics(self, robot: RobotRecord) -> list[str]:
        """Its topics."""
        return list(self._registry.robots.blueprint(robot).topics())


def _database(context: click.Context) -> str:
    from msbot.cli.database_place import database_here, is_there
    from msbot_agent.agent import MASTER, running_processes

    named = context.params.get("db")
    if named:
        return str(named)
    here = database_here()
    if is_there(here):
        return here
    masters = [one for one in running_processes() if one.what == MASTER]
    return masters[0].details["database"] if len(masters) == 1 else here


def _robots(_: ReadOnlyDatabase | _Server, robot: RobotRecord, __: click.Context) -> Iterable[str]:
    return robot.name, robot.serial_number


def _slots(look: ReadOnlyDatabase | _Server, robot: RobotRecord, _: click.Context) -> Iterable[str]:
    return look.slot_names(robot)


def _parts(look: ReadOnlyDatabase | _Server, robot: RobotRecord, _: click.Context) -> Iterable[str]:
    yield from look.slot_names(robot)
    for part in look.parts(robot):
        yield part.name
        if not part.slot:
            yield part.uid.hex()


def _part_numbers(look: ReadOnlyDatabase | _Server, robot: RobotRecord, _: click.Context) -> Iterable[str]:
    return (part.part_number for part in look.parts(robot))


def _topics(look: ReadOnlyDatabase | _Server, robot: RobotRecord, _: click.Context) -> Iterable[str]:
    return look.topics(robot)


def _ports(look: ReadOnlyDatabase | _Server, robot: RobotRecord, _: click.Context) -> Iterable[str]:
    for slot, ports, _parameters in look.slot_types(robot):
        yield from (f"{slot}.{port}" for port in ports)


def _parameters(look: ReadOnlyDatabase | _Server, robot: RobotRecord, context: click.Context) -> Iterable[str]:
    wanted = str(context.params.get("slot") or "").casefold()
    for slot, _ports, parameters in look.slot_types(robot):
        if slot.casefold() == wanted:
            yield from parameters


robots: Completer = partial(_of_robots, _robots)
slots: Completer = partial(_of_robots, _slots)
parts: Completer = partial(_of_robots, _parts)
seen_part_numbers: Completer = partial(_of_robots, _part_numbers)
topics: Completer = partial(_of_robots, _topics)
ports: Completer = partial(_of_robots, _ports)
parameters: Completer = partial(_of_robots, _parameters)


def part_numbers(_: click.Context, __: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """The part numbers of the library, and of types in files that the robot.toml here names."""

    def find() -> Iterable[str]:
        import msbot.config.library
        from msbot.config import library_folders

        shipped = Path(msbot.config.library.__path__[0], "types")
        yield from sorted(file.stem for file in shipped.glob("*.toml"))
        for folder in library_folders(Path("robot.toml")):
            yield from sorted(file.stem for file in folder.glob("*.toml"))

    return in_time(find, incomplete)


def recordings(_: click.Context, __: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Recordings, and the folders on the way to them."""
    folder = incomplete[: incomplete.rfind("/") + 1]

    def find() -> Iterable[str]:
        for path in sorted(Path(folder or ".").expanduser().iterdir()):
            if path.suffix == ".mcap" or path.is_dir():
                yield f"{folder}{path.name}{'/' if path.is_dir() else ''}"

    return in_time(find, incomplete)


BY_METAVAR = {"SLOT": slots, "PART": parts, "TOPIC": topics, "SLOT.PORT": ports}
"""What an argument of an operation takes, by what the help calls it."""
