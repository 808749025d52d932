"""Which robots a class has: those whose masters run on this computer, all of a database, and those on other computers
that there is an access to."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from hashlib import sha256
from typing import TYPE_CHECKING, ParamSpec, Protocol, TypeVar

from msbot.registry.records import database_identity
from msbot_agent.agent import MASTER, RunningProcess, running_processes
from msbot_agent.text.untrusted_input import parse_count
from msbot_school.classroom.remote_access import RemoteAccess
from msbot_school.classroom.remote_masters import LOOK_S, ParallelRequest, RemoteMasterError, read_status
from msbot_xrce.counting import amount
from msbot_xrce.lazy import dataclass

if TYPE_CHECKING:
    from msbot.registry import Registry, RobotRecord

_P = ParamSpec("_P")
_T = TypeVar("_T")


@dataclass(frozen=True, slots=True)
class RemoteRobot:
    """A robot on another computer, as its master said."""

    access: RemoteAccess
    status: Mapping[str, object]
    """What `GET /api/status` answered; empty: nothing."""
    trouble: str = ""
    """Why there was no answer."""

    def text(self, name: str) -> str:
        """A value of the status as text; empty when there is none."""
        return str(self.status.get(name, ""))[:200]


@dataclass(frozen=True, slots=True)
class ClassRobot:
    """One robot of the class."""

    name: str
    serial_number: str
    version: str
    """What its blueprint says."""
    database: str
    """Where it is stored, as `--db` takes it; of a robot elsewhere, the address of its page."""
    master: RunningProcess | None
    """Its master, if that runs on this computer."""
    runs_elsewhere: bool = False
    """Its master runs on another computer, or for another user, and there is no access to it."""
    blueprint: str = ""
    """The mark of its blueprint in force; empty: not known."""
    msbot: str = ""
    """The version of MsBOT that runs it; empty: none does, or it is not known."""
    far: RemoteRobot | None = None
    """Its master on another computer, if there is an access to it."""

    @property
    def describe(self) -> str:
        """The robot, told from others of its name."""
        return f"{self.name} {self.serial_number}"

    @property
    def database_mark(self) -> str:
        """A mark of its database: robots with the same mark share one; empty: it has none, or it is not known."""
        if self.far is not None:
            return self.far.text("database")
        return database_mark(database_identity(self.database)) if self.database else ""

    @property
    def page(self) -> str:
        """The address of its page; empty: it has none, or it is not known."""
        if self.far is not None:
            return self.far.access.address
        return "" if self.master is None else self.master.details.get("page", "")

    @property
    def answers(self) -> bool:
        """Whether its master was heard just now."""
        return self.master is not None or (self.far is not None and not self.far.trouble)

    @property
    def slots(self) -> int:
        """How many slots it has, as its master says."""
        return self._count("slots")

    @property
    def active(self) -> int:
        """How many of them have a part that is in, as its master says."""
        return self._count("active")

    @property
    def state(self) -> str:
        """Who runs it, in words."""
        if self.far is not None and self.far.trouble:
            return f"does not answer: {self.far.trouble}"
        if self.far is not None:
            return f"runs at {self.page}, {self.active} of {amount(self.slots, 'slot')} active"
        if self.master is not None:
            return f"runs here, {self.active} of {amount(self.slots, 'slot')} active"
        return (
            "runs on another computer, or is just starting; no access" if self.runs_elsewhere else "no master runs it"
        )

    @property
    def stop_group(self) -> str:
        """Its STOP group, as its master says; empty: none, or no master runs it."""
        if self.far is not None:
            return self.far.text("stop_group")
        return "" if self.master is None else self.master.details.get("stop_group", "")

    def fits(self, words: Sequence[str]) -> bool:
        """Whether all words are found in what is said of it."""
        text = f"{self.describe} {self.version} {self.blueprint} {self.state} {self.database} {self.msbot}"
        whole = f"{text} {self.stop_group}".casefold()
        return all(word.casefold() in whole for word in words)

    def _count(self, name: str) -> int:
        if self.far is not None:
            found = self.far.text(name)
        else:
            found = "" if self.master is None else self.master.details.get(name, "")
        return parse_count(found)


class DatabaseReader(Protocol):
    """Calls a function that opens a database file, where that does no harm.

    A process that has a database file open must not open and close it once more: closing it ends the locks by which
    SQLite keeps the file whole. A master has another process do it.
    """

    def __call__(self, function: Callable[_P, _T], /, *args: _P.args, **kwargs: _P.kwargs) -> _T:
        """What the function returns, or raises."""


def directly(function: Callable[_P, _T], /, *args: _P.args, **kwargs: _P.kwargs) -> _T:
    """As it is, in a program that has no database open."""
    return function(*args, **kwargs)


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
    return next((one for one in registry.robots.all() if (one.name, one.serial_number) == (name, serial_number)), None)


def database_mark(identity: str) -> str:
    """What a master tells others of its database, so that they see whether it is theirs: no path, no address."""
    return sha256(identity.encode()).hexdigest()[:16]


def class_robots(
    database: str | None,
    accesses: Sequence[RemoteAccess],
    words: Sequence[str] = (),
    *,
    path: str = "",
    read: DatabaseReader = directly,
) -> list[ClassRobot]:
    """All robots of the class that fit the words: of the masters here, of a database, and of the accesses.

    Args:
        database: a database that exists; None: none.
        accesses: to masters on other computers; all are asked at once, for 3 s at most.
        words: all of them are found in what is said of a robot.
        path: the way to a database that the user has named: it may have a password, what a master says has none.
        read: calls what reads the database.

    Raises:
        RegistryError: the database cannot be used.
    """
    asking = ParallelRequest(accesses, read_status, LOOK_S)
    local = list(_local(path))
    found = {_key(robot.name, robot.serial_number, database_identity(robot.database)): robot for robot in local}
    for far in far_robots(accesses, asking):
        key = (far.name, far.serial_number, "" if far.far is None else far.far.text("database"))
        if key not in found:  # else it is one of this computer: the way over the network is not needed
            found[key] = far
    if database is not None:
        for stored in read(_stored, database, frozenset(found)):
            found[_key(stored.name, stored.serial_number, database_identity(database))] = stored
    return sorted(
        (robot for robot in found.values() if robot.fits(words)), key=lambda robot: (robot.name, robot.serial_number)
    )


def far_robots(accesses: Sequence[RemoteAccess], asking: ParallelRequest[dict[str, object]]) -> Iterator[ClassRobot]:
    """The robots on other computers, as far as their masters answer."""
    answers = asking.answers()
    for access in accesses:
        answer = answers[access.address]
        if isinstance(answer, RemoteMasterError):
            far = RemoteRobot(access, {}, str(answer))
            yield ClassRobot(access.robot, access.serial_number, "", access.address, None, far=far)
            continue
        far = RemoteRobot(access, answer)
        yield ClassRobot(
            far.text("robot") or access.robot,
            far.text("serial_number") or access.serial_number,
            far.text("version"),
            access.address,
            None,
            blueprint=far.text("blueprint"),
            msbot=far.text("msbot"),
            far=far,
        )


def _key(name: str, serial_number: str, identity: str) -> tuple[str, str, str]:
    return name, serial_number, database_mark(identity)


def _local(path: str) -> Iterator[ClassRobot]:
    for one in running_processes():
        if one.what != MASTER:
            continue
        details = one.details
        identity = details.get("database", "")
        yield ClassRobot(
            details.get("robot", ""),
            details.get("serial_number", ""),
            details.get("version", ""),
            path if path and database_identity(path) == identity else identity,
            one,
            blueprint=details.get("blueprint", ""),
            msbot=details.get("msbot", ""),
        )


def _stored(path: str, known: frozenset[tuple[str, str, str]]) -> list[ClassRobot]:
    """The robots of a database that are not known otherwise."""
    from msbot.config import blueprint_mark  # running robots have told theirs

    identity = database_identity(path)
    with open_database(path) as registry:
        return [
            ClassRobot(
                record.name,
                record.serial_number,
                record.version,
                path,
                None,
                registry.runs.is_run(record),
                blueprint_mark(registry.robots.blueprint(record)),
            )
            for record in registry.robots.all()
            if _key(record.name, record.serial_number, identity) not in known
        ]
