"""Which robots a class has: those whose masters run on this computer, and all of a database."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from msbot.agent import RunningProcess, running_processes
from msbot.cli.change.robot_access import MASTER
from msbot.cli.options import DEFAULT_BLUEPRINT, database_beside, existing_database
from msbot.registry.database_identity import database_identity

if TYPE_CHECKING:
    from msbot.registry import Registry, RobotRecord


@dataclass(frozen=True, slots=True)
class ClassRobot:
    """One robot of the class."""

    name: str
    serial_number: str
    version: str
    """What its blueprint says."""
    database: str
    """Where it is stored, as `--db` takes it."""
    master: RunningProcess | None
    """Its master, if that runs on this computer."""
    runs_elsewhere: bool = False
    """Its master runs on another computer, or for another user."""

    @property
    def words(self) -> str:
        """The robot, told from others of its name."""
        return f"{self.name} {self.serial_number}"

    @property
    def state(self) -> str:
        """Who runs it, in words."""
        if self.master is not None:
            details = self.master.details
            return f"runs here, {details.get('active', '?')} of {details.get('slots', '?')} slots active"
        return "runs on another computer" if self.runs_elsewhere else "no master runs it"

    def fits(self, words: Sequence[str]) -> bool:
        """Whether all words are found in what is said of it."""
        text = f"{self.words} {self.version} {self.state} {self.database}".casefold()
        return all(word.casefold() in text for word in words)


@contextmanager
def open_database(database: str) -> Iterator[Registry]:
    """A database of robots that is there.

    Raises:
        RegistryError: it cannot be used.
    """
    from msbot.registry import open_registry  # a list of running masters needs no SQLAlchemy

    with open_registry(database, create=False) as registry:
        yield registry


def find_record(registry: Registry, name: str, serial_number: str) -> RobotRecord | None:
    """The robot of a database with that name and serial number."""
    return next(
        (one for one in registry.robots.all() if (one.name, one.serial_number) == (name, serial_number)), None
    )  # fmt: skip


def class_robots(db: str | None, words: Sequence[str] = ()) -> list[ClassRobot]:
    """All robots of the class that fit the words: of the masters here, and of the database that is named, or of
    robot.db here.

    Raises:
        ConfigError: the database that is named does not exist.
        RegistryError: it cannot be used.
    """
    running = {
        (one.details.get("robot", ""), one.details.get("serial_number", ""), one.details.get("database", "")): one
        for one in running_processes()
        if one.what == MASTER
    }
    path = db or database_beside(DEFAULT_BLUEPRINT)
    found = [
        # What a master says of its database has no password; the way that the user has named may have one.
        ClassRobot(
            name,
            serial,
            master.details.get("version", ""),
            path if database_identity(path) == database else database,
            master,
        )
        for (name, serial, database), master in running.items()
    ]
    if db is not None or Path(path).exists():
        found += _stored(existing_database(db), set(running))
    return sorted((robot for robot in found if robot.fits(words)), key=lambda robot: (robot.name, robot.serial_number))


def _stored(path: str, running: set[tuple[str, str, str]]) -> Iterator[ClassRobot]:
    identity = database_identity(path)
    with open_database(path) as registry:
        for record in registry.robots.all():
            if (record.name, record.serial_number, identity) not in running:
                is_run = registry.runs.is_run(record)
                yield ClassRobot(record.name, record.serial_number, record.version, path, None, is_run)
