"""What the pages show of the database: journal, robots, blueprint, users, backups; all SQL stays in the registry."""

from __future__ import annotations

import asyncio
import os
import shutil
import tempfile
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from functools import partial
from pathlib import Path
from typing import BinaryIO, NoReturn

from msbot.config import Blueprint, Library, blueprint_mark, blueprint_toml, compare_text, parse_blueprint
from msbot.operations.dispatch import InProcessOperations
from msbot.operations.operation import Outcome
from msbot.operations.rights import Role, role_named
from msbot.process.daemon_threads import DaemonThreads
from msbot.process.persistent_worker import PersistentWorker
from msbot.process.worker_pool import WorkLimits
from msbot.registry import EditKind, EditRecord, JournalEntry, Registry, RobotRecord, UserRecord
from msbot.registry.edits import users as user_edits
from msbot.registry.maintenance import database_maintenance, waiting_restore
from msbot.registry.records import database_identity
from msbot.registry.robots import RobotInClass
from msbot_agent.text.sentence import said
from msbot_web.access.users import User
from msbot_web.models.class_models import RobotTile
from msbot_web.models.robot_models import JournalLine, Robot
from msbot_xrce.errors import RegistryError
from msbot_xrce.lazy import dataclass

MARKS_AT_ONCE = 20
"""Blueprints of the class that one look reads; the others follow with the next looks."""
PIECE = 1 << 18
"""Octets of a backup that are read at a time."""


@dataclass(frozen=True, slots=True)
class BackupDownload:
    """A backup that is on the disk and goes out in pieces."""

    size: int
    """In octets."""
    octets: FileChunks
    """Its content."""


class FileChunks:
    """A file, piece by piece; it is closed at its end, or as soon as nobody wants any more of it.

    Args:
        file: what is read.
        aside: where it is read.
    """

    def __init__(self, file: BinaryIO, aside: DaemonThreads) -> None:
        self._file = file
        self._aside = aside

    def __aiter__(self) -> FileChunks:
        return self

    async def __anext__(self) -> bytes:
        piece = await asyncio.get_running_loop().run_in_executor(self._aside, self._file.read, PIECE)
        if not piece:
            self._file.close()
            raise StopAsyncIteration
        return piece

    def __del__(self) -> None:
        self._file.close()


@dataclass(frozen=True, slots=True)
class StoredData:
    """What the database knows, as functions, so that a robot without a database also has pages."""

    journal: Callable[[int, str | None, bool], Awaitable[list[JournalLine]]]
    """(most lines, of which part, whether parts are found by names only) -> the newest lines, newest first."""
    robots: Callable[[], Awaitable[list[RobotTile]]]
    export: Callable[[], Awaitable[str]]
    """The present blueprint as TOML."""
    diff: Callable[[str], Awaitable[list[str]]]
    """What another blueprint would change; raises ConfigError when it is wrong."""
    parse: Callable[[str], Awaitable[Blueprint]]
    """Reads a blueprint's text and checks it; raises ConfigError when it is wrong."""
    apply: Callable[[str, str], Awaitable[Outcome]]
    """(TOML, who) -> what was changed."""
    backup: Callable[[], Awaitable[BackupDownload]]
    restore: Callable[[AsyncIterator[bytes], str], Awaitable[str]]
    """(backup as it comes in, who) -> what happens now, in words."""
    people_edits: Callable[[int], Awaitable[Sequence[EditRecord]]]
    """What was changed about people and keys, newest first."""
    trouble: Callable[[], str]
    database: str = ""
    """Which database it is, see `database_identity`; empty: none."""
    address: str = ""
    """The database as it was opened, maybe with a password; empty: none."""


class RegistryUsers:
    """The `UserStore` of a database.

    Args:
        registry: the database.
        robot: the robot of it that runs here, from whose memory they are read then.
    """

    def __init__(self, registry: Registry, robot: RobotRecord | None = None) -> None:
        self._registry = registry
        self._robot = robot

    def users(self) -> list[User]:
        """See `UserStore.users`."""
        registry, robot = self._registry, self._robot
        return [_user(one) for one in (registry.users.all() if robot is None else registry.runs.store(robot).users)]

    async def keep_users(self, users: Sequence[User], who: str) -> None:
        """See `UserStore.keep_users`."""
        kept = [user_edits.Person(user.name, user.role.word, user.password_hash, user.tokens) for user in users]
        await self._registry.edits.make_soon(None, who, partial(user_edits.keep, people=kept))

    async def remove_user(self, name: str, who: str) -> None:
        """See `UserStore.remove_user`."""
        await self._registry.edits.make_soon(None, who, partial(user_edits.remove, name=name))


def registry_data(
    registry: Registry,
    robot: RobotRecord,
    operations: InProcessOperations,
    library: Callable[[], Library],
    *,
    address: str,
) -> StoredData:
    """The records of a robot with a database.

    Args:
        registry: the database.
        robot: which robot of it.
        operations: what a new blueprint goes through.
        library: gives the part types that it is checked against.
        address: the database as it was opened: for backups.
    """

    aside = DaemonThreads(1, "msbot backup")  # one at a time: each takes a copy of everything
    # What strangers write is read by another process, which stays for a while: a roll-out asks twice.
    workshop = PersistentWorker(WorkLimits())

    async def diff(toml: str) -> list[str]:
        present = await registry.storage.in_time(registry.robots.blueprint, robot, by_hand=False)
        return [str(difference) for difference in await workshop.run(compare_text, toml, library(), present)]

    async def parse(toml: str) -> Blueprint:
        return await workshop.run(parse_blueprint, toml, library())

    async def apply(toml: str, who: str) -> Outcome:
        return await operations.applying.put_in_force(await parse(toml), who=who)

    async def backup() -> BackupDownload:
        file = await asyncio.get_running_loop().run_in_executor(aside, _backup, address)
        size = os.fstat(file.fileno()).st_size
        if words := database_maintenance.too_large_for_page(size):
            registry.edits.note(robot, EditKind.RESTORE, words, "msbot")
        return BackupDownload(size, FileChunks(file, aside))

    async def restore(backup: AsyncIterator[bytes], who: str) -> str:
        known = registry.runs.store(robot).users
        has_administrator = any(user.role == Role.ADMINISTRATOR.word for user in known)  # the demo has none
        loop = asyncio.get_running_loop()
        with tempfile.TemporaryDirectory(prefix="msbot-restore-") as folder:
            path = Path(folder, "backup.db")
            with await loop.run_in_executor(aside, path.open, "wb") as file:
                async for octets in backup:
                    await loop.run_in_executor(aside, file.write, octets)
            hold = partial(waiting_restore.hold, address, path, needs_administrator=has_administrator)
            await loop.run_in_executor(aside, hold)
        registry.edits.note(robot, EditKind.RESTORE, said("a backup takes effect when the master restarts"), who)
        return said("The backup is checked and kept: it takes effect when the master restarts.")

    async def people_edits(limit: int) -> Sequence[EditRecord]:
        return await registry.storage.in_time(registry.edits.latest, None, limit)

    async def export() -> str:
        blueprint = await registry.storage.in_time(registry.robots.blueprint, robot)
        return blueprint_toml(blueprint, await registry.storage.in_time(registry.robots.made_by_hand, robot))

    return StoredData(
        journal=journal_lines(registry, robot),
        robots=robot_tiles(registry, robot),
        export=export,
        diff=diff,
        parse=parse,
        apply=apply,
        backup=backup,
        restore=restore,
        people_edits=people_edits,
        trouble=lambda: registry.storage.health.trouble or "",
        database=database_identity(address),
        address=address,
    )


def no_stored_data(robot: Callable[[], Robot]) -> StoredData:
    """The records of a robot without a database: all that needs one says so."""

    async def refuse(*_: object) -> NoReturn:
        raise RegistryError(said("this robot runs without a database: start it with --db"))

    async def no_edits(_limit: int) -> Sequence[EditRecord]:
        return []

    async def no_lines(_limit: int, _part: str | None, _by_name: bool) -> list[JournalLine]:
        return []

    async def tile() -> list[RobotTile]:
        one = robot()
        return [
            RobotTile(
                name=one.name,
                serial_number=one.serial_number,
                running=True,
                here=True,
                owner="",
                slots=len(one.slots),
                active=0,
                last_event="",
                last_event_age_s=None,
            )
        ]

    return StoredData(
        journal=no_lines,
        robots=tile,
        export=refuse,
        diff=refuse,
        parse=refuse,
        apply=refuse,
        backup=refuse,
        restore=refuse,
        people_edits=no_edits,
        trouble=str,
    )


def _backup(address: str) -> BinaryIO:
    """A new backup, in a file without a name: it is gone when it is closed."""
    with tempfile.TemporaryDirectory(prefix="msbot-backup-") as folder:
        target = Path(folder) / "backup.db"
        database_maintenance.back_up(address, target)
        if os.name == "posix":
            return target.open("rb")  # an open file outlives its name
        kept = tempfile.TemporaryFile()  # noqa: SIM115 - whoever sends it closes it
        with target.open("rb") as made:
            shutil.copyfileobj(made, kept)
    kept.seek(0)
    return kept


def journal_lines(
    registry: Registry, robot: RobotRecord
) -> Callable[[int, str | None, bool], Awaitable[list[JournalLine]]]:
    """The journal of a robot, newest line first."""

    async def read(limit: int, part: str | None, by_name: bool) -> list[JournalLine]:
        entries = await registry.storage.in_time(registry.robots.journal, limit, part, robot=robot, by_name=by_name)
        return [journal_line(entry) for entry in reversed(entries)]

    return read


def robot_tiles(
    registry: Registry, here: RobotRecord, *, epoch_ns: Callable[[], int] = time.time_ns
) -> Callable[[], Awaitable[list[RobotTile]]]:
    """All robots of the database; `here` is the one this server runs."""

    marks: dict[int, tuple[int, str]] = {}
    """Number of a robot -> its newest edit, and the mark of its blueprint then: to read a blueprint takes long."""

    def read() -> list[RobotTile]:
        found = registry.robots.in_class()
        for gone in marks.keys() - {one.robot.id for one in found}:
            del marks[gone]
        old = [one for one in found if marks.get(one.robot.id, (None, ""))[0] != one.newest_edit]
        for one in old[:MARKS_AT_ONCE]:
            marks[one.robot.id] = (one.newest_edit, blueprint_mark(registry.robots.blueprint(one.robot)))
        for one in old[MARKS_AT_ONCE:]:
            marks.pop(one.robot.id, None)
        now_ns = epoch_ns()
        return [
            _tile(
                one,
                marks.get(one.robot.id, (0, ""))[1],
                now_ns,
                is_here=one.robot.id == here.id,
                is_run=one.robot.id == here.id or registry.runs.is_run(one.robot),
            )
            for one in found
        ]

    async def read_in_time() -> list[RobotTile]:
        return await registry.storage.in_time(read)

    return read_in_time


def _tile(one: RobotInClass, mark: str, now_ns: int, *, is_here: bool, is_run: bool) -> RobotTile:
    return RobotTile(
        name=one.robot.name,
        serial_number=one.robot.serial_number,
        running=is_run,
        here=is_here,
        owner=one.robot.manufacturer,
        slots=one.slots,
        active=one.filled if is_run else 0,
        last_event="" if one.newest is None else one.newest.event.sentences()[0],
        last_event_age_s=None if one.newest is None else max(now_ns - one.newest.at_ns, 0) / 1e9,
        version=one.robot.version,
        blueprint=mark,
    )


def journal_line(entry: JournalEntry) -> JournalLine:
    """A line of the journal as pages and API show it."""
    event = entry.event
    return JournalLine(
        number=entry.number,
        at_ms=entry.at_ns // 1_000_000,
        part=event.part if event.part != event.address else said("newcomer"),
        slot=event.slot or "",
        from_state="" if event.from_state is None else event.from_state.value,
        to_state=event.to_state.value,
        reason=event.reason,
        evidence=list(event.evidence),
    )


def _user(record: UserRecord) -> User:
    return User(record.name, role_named(record.role), record.password_hash, record.tokens, record.created_ns)
