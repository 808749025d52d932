"""The SQL database manager (thesis 5.4.2): the one object through which all other rooms use the database."""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Self

from sqlalchemy import Engine

from msbot.registry.class_groups import ClassGroups
from msbot.registry.database.engine import (
    Address,
    check_file,
    make_engine,
    make_private,
    parse_address,
    use_write_ahead_log,
)
from msbot.registry.database.schema import Migrations, bring_up_to_date, own_migrations, read_version
from msbot.registry.database.storage import Storage
from msbot.registry.edits.editing import Edits
from msbot.registry.edits.users import PartKeys, Users
from msbot.registry.hand_ins import HandIns
from msbot.registry.lesson_ticks import LessonTicks
from msbot.registry.programs import Programs
from msbot.registry.robots import Robots
from msbot.registry.running.runs import Runs
from msbot_xrce.errors import RegistryError

BUSY_TIMEOUT_S = 2.0
"""How long another program may hold the database before it counts as locked."""


def open_registry(
    address: str | Path,
    *,
    create: bool = True,
    read_only: bool = False,
    busy_timeout_s: float = BUSY_TIMEOUT_S,
    epoch_ns: Callable[[], int] = time.time_ns,
    migrations: Migrations | None = None,
) -> Registry:
    """Open a database; create it or bring it up to date if needed.

    Args:
        address: a path, `sqlite:///path` or `postgresql://user@host/name`.
        create: create the database if it does not exist.
        read_only: change nothing, not even the schema.
        busy_timeout_s: how long to wait for another program.
        epoch_ns: wall clock, nanoseconds since 1970.
        migrations: used instead of MsBOT's own, for tests.

    Raises:
        RegistryError: it cannot be used; the text says why and what to do.
    """
    where = parse_address(address)
    check_file(where, create=create and not read_only, read_only=read_only)
    rights = None
    if where.path is not None and not read_only:
        rights = where.path.stat().st_mode if where.path.exists() else None
        make_private(where.path)  # before it is opened: its log gets the rights that it has then
    engine = make_engine(where, busy_timeout_s=busy_timeout_s, read_only=read_only)
    try:
        _prepare(engine, where, migrations or own_migrations(), read_only=read_only)
        return Registry(Storage(engine, where, epoch_ns, busy_timeout_s=busy_timeout_s, read_only=read_only))
    except BaseException:
        engine.dispose()
        if where.path is not None and rights is not None:  # it may be another program's
            with contextlib.suppress(OSError):
                os.chmod(where.path, rights)
        raise


def _prepare(engine: Engine, where: Address, migrations: Migrations, *, read_only: bool) -> None:
    version = read_version(engine, where, migrations)
    if version == migrations.newest:
        return
    if read_only:
        raise RegistryError(
            f"the database {where.words} was written by an older MsBOT (schema {version}, this one knows "
            f"{migrations.newest}): `msbot db migrate --db {where.words}`"
            if version
            else f"the database {where.words} is empty: `msbot master ROBOT.toml --db {where.words}` puts a robot there"
        )
    use_write_ahead_log(engine, where)
    bring_up_to_date(engine, where, migrations)


class Registry:
    """An open database; made by `open_registry`, closed by `close` or at the end of a `with`."""

    def __init__(self, storage: Storage) -> None:
        self.storage = storage
        """Reads with a time limit, and knows what is not stored yet."""
        self.runs = Runs(storage)
        self.robots = Robots(storage, self.runs)
        self.edits = Edits(storage)
        self.users = Users(storage)
        self.keys = PartKeys(storage, self.edits)
        self.programs = Programs(storage)
        self.lesson_ticks = LessonTicks(storage)
        self.hand_ins = HandIns(storage)
        self.class_groups = ClassGroups(storage)

    @property
    def database(self) -> str:
        """The database in words, without a password."""
        return self.storage.describe

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Store what is waiting and close the database."""
        self.runs.end()
        # What `end` wrote has been stored: so the database has just answered.
        if self.storage.close():
            self.runs.give_back()
        else:
            self.runs.release()
