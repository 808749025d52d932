"""Maintaining a database: migrate it, copy it, restore a copy, look for contradictions.

A backup is always one SQLite file with all rows, whatever the database is: it can be restored to a file or to a server,
and inspected with any SQLite tool.
"""

from __future__ import annotations

import os
import shutil
import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

from sqlalchemy import Connection, Engine, delete, func, insert, select, text

from msbot.config import binding_faults
from msbot.part.join.pnp_messages import SAFE_MARK
from msbot.process.worker_pool import WorkLimits, run_limited
from msbot.registry.blueprint import blueprint_reader
from msbot.registry.database import statements
from msbot.registry.database.database_errors import told_as_registry_error
from msbot.registry.database.engine import MAGIC, WRITE, Address, check_file, make_engine, make_private, parse_address
from msbot.registry.database.schema import Migrations, own_migrations, read_version
from msbot.registry.database.tables import edits, journal, library, metadata, parts, settings, slots, users
from msbot.registry.edits import wires
from msbot.registry.edits.edit_log import read_edits
from msbot.registry.edits.users import ROLES
from msbot.registry.read_only_database import is_locked
from msbot.registry.records import RobotRecord
from msbot.registry.registry import BUSY_TIMEOUT_S, Registry, open_registry
from msbot.registry.running import run_lock
from msbot.registry.running.robot_memory import read_memory
from msbot_agent.text.sentence import said, without
from msbot_agent.text.untrusted_input import open_input_file
from msbot_xrce.counting import amount
from msbot_xrce.errors import ConfigError, MsbotError, RegistryError
from msbot_xrce.lazy import dataclass

# Contradictions in a database, in sentences. MsBOT itself cannot cause any of them.


MOST_TOLD = 100
"""At most this many findings are reported."""


def find(connection: Connection) -> list[str]:
    """Everything that is wrong, the worst first."""
    found = list(_damage(connection))
    if found:
        return found[:MOST_TOLD]
    for robot in statements.list_robots(connection):
        name = f"robot {robot.name}"
        found += [f"{name}: {sentence}" for sentence in _of_robot(connection, robot.id)]
    found += [*_of_users(connection), *_of_edits(connection)]
    return found[:MOST_TOLD]


def _damage(connection: Connection) -> Iterator[str]:
    """Damage that SQLite finds in its own file; a server looks after itself."""
    if connection.dialect.name != "sqlite":
        return
    for (words,) in connection.exec_driver_sql("PRAGMA integrity_check"):
        if words != "ok":
            yield f"the file is damaged: {words}"
    for table, number, other, _ in connection.exec_driver_sql("PRAGMA foreign_key_check"):
        yield f"row {number} of {table} refers to a row of {other} that is not there"


def _of_robot(connection: Connection, robot_id: int) -> Iterator[str]:
    mine = slots.c.robot_id == robot_id
    unknown = select(slots.c.name, slots.c.part_number).where(
        mine, slots.c.in_blueprint, slots.c.part_number.not_in(select(library.c.number))
    )
    for row in connection.execute(unknown):
        yield f"slot {row.name} wants part number {row.part_number}, which is not in the library"
    bare = select(slots.c.name).where(mine, slots.c.configuration_version < 1)
    for name in connection.execute(bare).scalars():
        yield f"the configuration of slot {name} has no version"
    yield from _of_settings(connection, robot_id)
    wired = blueprint_reader.read_bindings(connection, robot_id)
    yield from binding_faults(wired, wires.read_slots(connection, robot_id), wires.read_library(connection, robot_id))
    for column in (parts.c.slot_id, parts.c.placed_slot_id):
        foreign = select(parts.c.identity).join(slots, column == slots.c.id)
        for identity in connection.execute(
            foreign.where(parts.c.robot_id == robot_id, slots.c.robot_id != robot_id)
        ).scalars():
            yield f"part {identity} is in a slot of another robot"


def _of_settings(connection: Connection, robot_id: int) -> Iterator[str]:
    """Check that every parameter of every slot has the library's value, and that every value has a parameter."""
    query = (
        select(slots.c.name, library.c.parameters, library.c.ports, slots.c.id)
        .join(library, slots.c.part_number == library.c.number)
        .where(slots.c.robot_id == robot_id, slots.c.in_blueprint)
    )
    for slot in connection.execute(query.order_by(slots.c.position)).all():
        known = {parameter["name"] for parameter in slot.parameters}
        rows = connection.execute(select(settings.c.name, settings.c.origin).where(settings.c.slot_id == slot.id)).all()
        ports = {port["name"] for port in slot.ports}
        for name in sorted({row.name for row in rows} - known):
            port, is_safe, _ = name.partition(SAFE_MARK)
            if not is_safe or port not in ports:
                yield f"slot {slot.name} has a value for {name}, which its part type does not have"
        for name in sorted(known - {row.name for row in rows if row.origin == "library"}):
            yield f"slot {slot.name} has no default for {name}"


def _of_users(connection: Connection) -> Iterator[str]:
    for name, role in connection.execute(select(users.c.name, users.c.role).where(users.c.role.not_in(ROLES))):
        yield f"user {name} has the role {role!r}, which does not exist"


def _of_edits(connection: Connection) -> Iterator[str]:
    undoing = edits.alias("undoing")
    query = select(edits.c.id).outerjoin(undoing, edits.c.undone_by == undoing.c.id)
    # The newest edits are kept, and an undo is newer than what it undoes.
    for number in connection.execute(query.where(edits.c.undone_by.is_not(None), undoing.c.id.is_(None))).scalars():
        yield f"edit {number} was undone by an edit that is not there"
    strange = select(func.count()).select_from(journal).where(journal.c.to_state.not_in(list(statements.STATES)))
    if count := connection.execute(strange).scalar():
        lines = amount(count, "line of the journal tells", "lines of the journal tell")
        yield f"{lines} of a state that does not exist"


# Is an uploaded file a harmless backup of MsBOT? A process with limits finds out.
#
# A file may be damaged, contain a view that never ends, or change who is administrator. So another process opens it,
# with little time and memory, and reads every row as the robot would.


LIMITS = WorkLimits(cpu_s=30, memory_mb=1024, wall_s=120.0)
"""The largest backup that may be uploaded, of 256 MB, takes some 10 s and 200 MB of memory."""


class UnusableBackup(RegistryError):
    """The file is no backup that could be restored; the text says why."""


def check_backup(path: Path, *, needs_administrator: bool) -> None:
    """Check a file in a process of its own; brings the schema of an older backup up to date.

    Args:
        path: a copy of the file that nobody else uses.
        needs_administrator: refuse a backup with which nobody could log in as administrator.

    Raises:
        UnusableBackup: it cannot be used; the text says why.
    """
    try:
        fault = run_limited(fault_of, LIMITS, str(path), needs_administrator)
    except ConfigError as error:
        raise UnusableBackup(said("this backup is not used: {error}", error=str(error))) from None
    if fault:
        raise UnusableBackup(said("this backup is not used: {fault}", fault=fault))


def fault_of(path: str, needs_administrator: bool) -> str:
    """The worst thing that is wrong with it; empty: nothing."""
    with open_input_file(Path(path)) as stream:
        if stream.read(len(MAGIC)) != MAGIC:
            return said("it is not a database")
    try:
        if strange := _strange(path):
            return strange
        with open_registry(path, create=False) as registry:
            for robot in registry.robots.all():
                _read(registry, robot)
            registry.edits.latest(None, 10_000)
            findings = registry.storage.read(find)
            if findings:
                return findings[0]
            administrators = [user for user in registry.users.all() if user.role == "administrator"]
            if needs_administrator and not administrators:
                return said("it has no administrator, so nobody could sign in: restore it with `msbot db restore`")
    except MsbotError as error:
        return without(str(error), ("words", "path", "database"), Path(path).name)
    except Exception as error:  # whatever the file contains, nothing of it may reach the robot
        return said("it cannot be read ({kind}: {error})", kind=type(error).__name__, error=str(error))
    return ""


def _strange(path: str) -> str:
    """Anything but tables and indexes: reading such an object could run for ever."""
    with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as connection:
        query = "SELECT type, name, coalesce(sql, '') FROM sqlite_master"
        for kind, name, sql in connection.execute(query):
            if kind not in ("table", "index") or str(sql).upper().startswith("CREATE VIRTUAL"):
                return said("it has a {kind} {name!r}, and MsBOT makes none of that sort", kind=kind, name=name)
    return ""


def _read(registry: Registry, robot: RobotRecord) -> None:
    """Read all that a master and its pages would read."""
    registry.storage.read(lambda connection: read_memory(connection, robot.id))
    registry.storage.read(lambda connection: statements.list_parts(connection, robot.id))
    registry.storage.read(lambda connection: statements.read_journal(connection, robot.id, None, 100_000))
    registry.storage.read(lambda connection: read_edits(connection, robot.id, 10_000))
    registry.robots.made_by_hand(robot)


_ROWS = 1000
"""How many rows are copied at a time."""
MOST_OF_PAGE = 256 * 1024 * 1024
"""Octets of the largest backup that a page takes back."""


def too_large_for_page(size: int) -> str:
    """What to know about a backup of so many octets; empty: nothing, a page takes it back."""
    if size <= MOST_OF_PAGE:
        return ""
    return said(
        "the backup has {size} MB, and a page takes back {most} MB: `msbot db restore` takes it, while no master runs",
        size=(size >> 20) + 1,
        most=MOST_OF_PAGE >> 20,
    )


@dataclass(frozen=True, slots=True)
class Migrated:
    """What `migrate` did."""

    before: int
    """Schema before; 0 when the database was empty."""
    after: int


def migrate(address: str, *, migrations: Migrations | None = None) -> Migrated:
    """Bring an older database up to date, after backing it up; one that is up to date is left alone.

    Raises:
        RegistryError: it is not there, is newer, or cannot be written.
    """
    known = migrations or own_migrations()
    where, engine = _open(address)
    try:
        before = read_version(engine, where, known)
    finally:
        engine.dispose()
    open_registry(address, create=False, migrations=known).close()
    return Migrated(before, known.newest)


def back_up(address: str, target: Path) -> int:
    """Copy a database to a new SQLite file while it is in use; returns the number of rows.

    Raises:
        RegistryError: it is not there or not up to date, the file exists, or cannot be written.
    """
    if target.exists():
        raise RegistryError(said("{target} exists already and is not overwritten: name another file", target=target))
    open_registry(address, read_only=True).close()
    where, engine = _open(address)
    part = target.with_name(f"{target.name}.part{os.getpid()}")
    try:
        try:
            open_registry(part).close()
        except RegistryError as error:
            raise RegistryError(without(str(error), ("words", "path", "database"), str(target))) from error
        copy = make_engine(parse_address(part), busy_timeout_s=BUSY_TIMEOUT_S, read_only=False)
        try:
            with told_as_registry_error(where.words), _snapshot(engine, where) as source:
                with told_as_registry_error(str(target)), _writing(copy) as connection, connection.begin():
                    rows = _copy(source, connection)
                with told_as_registry_error(str(target)), copy.connect() as connection:
                    # The copy should be a single file.
                    connection.exec_driver_sql("COMMIT")
                    connection.exec_driver_sql("PRAGMA journal_mode = DELETE")
        finally:
            copy.dispose()
        part.replace(target)
    finally:
        for ending in ("", "-wal", "-shm", "-journal"):  # a disk that is full leaves more than the file itself
            part.with_name(f"{part.name}{ending}").unlink(missing_ok=True)
        engine.dispose()
    return rows


def find_backup(source: Path) -> None:
    """See that there is a file that may be a backup.

    Raises:
        RegistryError: there is none, or it cannot be read.
    """
    if not source.exists():
        raise RegistryError(
            said("there is no backup {source}: name a file that `msbot db backup` has written", source=source)
        )
    check_file(parse_address(source), create=False, read_only=True)


def restore(source: Path, address: str) -> Path | None:
    """Replace the content of a database by that of a backup; returns a copy of the old content if it had robots.

    A file that is damaged, or that a newer MsBOT has written, is set aside and returned.

    Raises:
        RegistryError: the backup or the database cannot be used, or a master is running one of its robots.
    """
    find_backup(source)
    with tempfile.TemporaryDirectory(prefix="msbot-restore-") as folder:
        copy = Path(folder) / source.name
        make_private(copy)
        shutil.copyfile(source, copy)
        check_backup(copy, needs_administrator=False)
        unread = _set_unread_aside(address)
        open_registry(address).close()
        where, engine = _open(address)
        try:
            kept = _keep_aside(address, where, engine)
            _replace(copy, where, engine)
        finally:
            engine.dispose()
    return unread or kept


def _set_unread_aside(address: str) -> Path | None:
    """A file that this version cannot read as the database gives way to the backup; nothing of it is deleted.

    Raises:
        RegistryError: a master is running a robot of it.
    """
    where = parse_address(address)
    path = where.path
    if path is None or not path.is_file():
        return None
    why = "damaged" if _is_damaged(path) else "newer" if _is_newer(path) else ""
    if not why:
        return None
    for lock in path.parent.glob(f"{path.name}.running*"):
        if is_locked(lock):
            raise RegistryError(
                said("a master is running a robot with the database {words}: stop it first", words=where.words)
            )
    number = 1
    while (aside := path.with_name(f"{path.name}.{why}.{number}")).exists():
        number += 1
    path.rename(aside)
    aside.chmod(0o600)
    log = path.with_name(f"{path.name}-wal")
    has_written = log.exists() and log.stat().st_size > 0  # an empty one is left by a look at the file
    for ending in ("-wal", "-shm"):  # they belong to that file, and would spoil the new one
        beside = path.with_name(f"{path.name}{ending}")
        if not has_written:
            beside.unlink(missing_ok=True)
        elif beside.exists():
            beside.rename(aside.with_name(f"{aside.name}{ending}"))
    return aside


def _is_damaged(path: Path) -> bool:
    """Whether SQLite cannot read the file, or what it reads contradicts itself.

    A file of text was never a database: somebody has named the wrong one, and it stays where it is.
    """
    with path.open("rb") as file:
        if b"\0" not in (begin := file.read(4096)) and begin:
            return False
    try:
        with closing(sqlite3.connect(f"file:{path.absolute().as_posix()}?mode=ro", uri=True)) as connection:
            return bool(connection.execute("PRAGMA quick_check(1)").fetchone() != ("ok",))
    except sqlite3.DatabaseError as error:
        return error.sqlite_errorname.startswith(("SQLITE_CORRUPT", "SQLITE_NOTADB"))


def _is_newer(path: Path) -> bool:
    """Whether a newer MsBOT has written a file that SQLite can read."""
    try:
        with closing(sqlite3.connect(f"file:{path.absolute().as_posix()}?mode=ro", uri=True)) as connection:
            row = connection.execute("SELECT version_num FROM alembic_version").fetchone()
    except sqlite3.DatabaseError:
        return False  # it has no such table: it is new, or another program's
    return row is not None and str(row[0]).isdecimal() and int(row[0]) > own_migrations().newest


def check(address: str) -> list[str]:
    """What is wrong in a database, one sentence each; empty when nothing is.

    Raises:
        RegistryError: it is not there, not up to date, or cannot be read.
    """
    open_registry(address, read_only=True).close()
    where, engine = _open(address)
    try:
        with told_as_registry_error(where.words), engine.connect() as connection:
            return find(connection)
    finally:
        engine.dispose()


def _open(address: str) -> tuple[Address, Engine]:
    where = parse_address(address)
    check_file(where, create=False, read_only=True)
    return where, make_engine(where, busy_timeout_s=BUSY_TIMEOUT_S, read_only=False)


def _keep_aside(address: str, where: Address, engine: Engine) -> Path | None:
    with told_as_registry_error(where.words), engine.connect() as connection:
        robots = statements.list_robots(connection)
    for robot in robots:
        if run_lock.is_run(engine, where, robot):
            raise RegistryError(
                said(
                    "robot {name} is being run with the database {words}: stop its master first",
                    name=robot.name,
                    words=where.words,
                )
            )
    if not robots:
        return None
    beside = where.path or Path(f"{where.url.database}.db")
    number = 1
    while (kept := beside.with_name(f"{beside.name}.replaced.{number}.backup")).exists():
        number += 1
    back_up(address, kept)
    return kept


def _replace(copy: Path, where: Address, engine: Engine) -> None:
    source_engine = make_engine(parse_address(copy), busy_timeout_s=BUSY_TIMEOUT_S, read_only=True)
    try:
        with (
            told_as_registry_error(where.words),
            source_engine.connect() as source,
            _writing(engine) as connection,
            connection.begin(),
        ):
            for table in reversed(metadata.sorted_tables):
                connection.execute(delete(table))
            _copy(source, connection)
    finally:
        source_engine.dispose()


def _snapshot(engine: Engine, where: Address) -> Connection:
    """A connection that sees the database at one moment, however long it reads."""
    connection = engine.connect()
    return connection if where.path else connection.execution_options(isolation_level="REPEATABLE READ")


def _writing(engine: Engine) -> Connection:
    return engine.execution_options(**{WRITE: True}).connect()


def _copy(source: Connection, target: Connection) -> int:
    """Copy all rows into empty tables; counters continue after them."""
    count = 0
    for table in metadata.sorted_tables:
        for rows in source.execution_options(yield_per=_ROWS).execute(select(table)).partitions():
            target.execute(insert(table), [row._asdict() for row in rows])
            count += len(rows)
        if target.dialect.name == "postgresql" and "id" in table.columns:
            newest = target.execute(select(func.max(table.c.id))).scalar() or 0
            sequence = text(f"SELECT setval(pg_get_serial_sequence('{table.name}', 'id'), :next, false)")
            target.execute(sequence, {"next": newest + 1})
    return count
