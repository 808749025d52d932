"""What a shell completes besides commands and options: the names that a robot has, and those of part types.

Click calls these when somebody presses Tab. They look into the database that the command would use, with Python's own
sqlite3, and never say what is wrong: where nothing can be found in time, nothing is completed.
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
    from msbot.registry import RobotRecord
    from msbot.registry.read_only_database import ReadOnlyDatabase

PATIENCE_S = 0.25
"""Whoever presses Tab waits no longer for names."""
MOST_NAMES = 500
_PLAIN = re.compile(r"[\w.:@%/+,=-]{1,100}")
"""Names that no shell takes for more than one word, or for something to do; others are not completed."""

Names = Callable[["ReadOnlyDatabase", "RobotRecord", click.Context], Iterable[str]]
Completer = Callable[[click.Context, click.Parameter, str], list[CompletionItem]]


def in_time(find: Callable[[], Iterable[str]], incomplete: str) -> list[CompletionItem]:
    """The names that begin like that, as far as they are found in time.

    Args:
        find: finds all names; it runs in a thread, which is left behind when it takes too long.
        incomplete: what is typed already; case does not matter.
    """
    found = list[str]()

    def look() -> None:
        with suppress(Exception):  # a shell in which somebody types is no place for what is wrong with a database
            found.extend(find())

    worker = threading.Thread(target=look, daemon=True)
    worker.start()
    worker.join(PATIENCE_S)
    begins = incomplete.casefold()
    names = [one for one in dict.fromkeys(found) if _PLAIN.fullmatch(one) and one.casefold().startswith(begins)]
    return [CompletionItem(one) for one in names[:MOST_NAMES]]


def _of_robots(names: Names, context: click.Context, _: click.Parameter, incomplete: str) -> list[CompletionItem]:
    return in_time(lambda: _look(names, context), incomplete)


def _look(names: Names, context: click.Context) -> Iterator[str]:
    from msbot.registry.read_only_database import look_into

    look = look_into(_database(context))
    if look is None:
        return
    with look:
        wanted = context.params.get("robot")
        for robot in look.robots():
            if names is _robots or wanted in (None, robot.name, robot.serial_number):
                yield from names(look, robot, context)


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


def _robots(_: ReadOnlyDatabase, robot: RobotRecord, __: click.Context) -> Iterable[str]:
    return robot.name, robot.serial_number


def _slots(look: ReadOnlyDatabase, robot: RobotRecord, _: click.Context) -> Iterable[str]:
    return look.slot_names(robot)


def _parts(look: ReadOnlyDatabase, robot: RobotRecord, _: click.Context) -> Iterable[str]:
    yield from look.slot_names(robot)
    for part in look.parts(robot):
        yield part.name
        if not part.slot:
            yield part.uid.hex()


def _part_numbers(look: ReadOnlyDatabase, robot: RobotRecord, _: click.Context) -> Iterable[str]:
    return (part.part_number for part in look.parts(robot))


def _topics(look: ReadOnlyDatabase, robot: RobotRecord, _: click.Context) -> Iterable[str]:
    return look.topics(robot)


def _ports(look: ReadOnlyDatabase, robot: RobotRecord, _: click.Context) -> Iterable[str]:
    for slot, ports, _parameters in look.slot_types(robot):
        yield from (f"{slot}.{port}" for port in ports)


def _parameters(look: ReadOnlyDatabase, robot: RobotRecord, context: click.Context) -> Iterable[str]:
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
