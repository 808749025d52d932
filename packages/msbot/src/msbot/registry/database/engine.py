"""From the value of `--db` to a connection: a file (SQLite) or a server (PostgreSQL)."""

from __future__ import annotations

import contextlib
import os
import re
import shlex
import sqlite3
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Final
from urllib.parse import quote

from sqlalchemy import URL, Connection, Engine, create_engine, event, make_url
from sqlalchemy.exc import ArgumentError
from sqlalchemy.pool import ConnectionPoolEntry, QueuePool

from msbot.registry.database.database_errors import ELSE, told_as_registry_error
from msbot_agent.text.sentence import said
from msbot_agent.text.untrusted_input import open_input_file
from msbot_xrce.errors import RegistryError
from msbot_xrce.lazy import dataclass

WRITE = "msbot_write"
"""Execution option of connections that take SQLite's write lock at once, so that two of them cannot deadlock."""

MAGIC = b"SQLite format 3\x00"
"""The first octets of every SQLite file."""

WAIT_S = "msbot_wait_s"
"""Execution option of writing connections: wait only this long for another program."""
AT_ONCE = "msbot_at_once"
"""Execution option of connections without a transaction: each statement sees what is stored when it runs."""


@dataclass(frozen=True, slots=True)
class Address:
    """Where a database is."""

    url: URL
    words: str
    """The address for messages, without a password."""
    path: Path | None
    """The file, for SQLite."""


def parse_address(text: str | Path) -> Address:
    """Read a path, `sqlite:///path` or `postgresql://user@host/name`.

    Raises:
        RegistryError: it is none of these.
    """
    if isinstance(text, Path) or "://" not in text:
        if not str(text) or str(text) == ":memory:":
            raise RegistryError(
                said("a database in memory would forget everything: name a file, for example --db robot.db")
            )
        return _file_address(Path(text))
    try:
        url = make_url(text)
    except (ArgumentError, ValueError):
        hidden = re.sub(r":[^:@/]*@", ":***@", text)
        raise RegistryError(
            said("the database address {hidden!r} cannot be read; {examples}", hidden=hidden, examples=_EXAMPLES)
        ) from None
    backend = url.get_backend_name()
    if backend == "sqlite":
        if not url.database or url.database == ":memory:":
            raise RegistryError(
                said("a database in memory would forget everything: name a file, as in sqlite:///robot.db")
            )
        return _file_address(Path(url.database))
    if backend == "postgresql":
        return Address(url.set(drivername="postgresql+psycopg"), url.render_as_string(hide_password=True), None)
    raise RegistryError(
        said(
            "the database {address!r} is of an unknown kind; {examples}",
            address=url.render_as_string(hide_password=True),
            examples=_EXAMPLES,
        )
    )


def without_password(text: str) -> str:
    """The address as messages show it, without its password.

    Raises:
        RegistryError: it is not an address of a database.
    """
    return parse_address(text).words


_EXAMPLES = said("write a file name, sqlite:///robot.db or postgresql://user@host/name")


def _file_address(path: Path) -> Address:
    return Address(URL.create("sqlite+pysqlite", database=str(path)), str(path), path)


def check_file(address: Address, *, create: bool, read_only: bool) -> None:
    """Find out before SQLite does why a file cannot be the database; writes nothing.

    Raises:
        RegistryError: the folder is missing, the file is something else, or it may not be used.
    """
    path = address.path
    if path is None:
        return
    folder = path.parent
    if not folder.is_dir():
        raise RegistryError(
            said(
                "the folder {folder} of the database does not exist: create it (`mkdir -p {quoted}`), {otherwise}",
                folder=folder,
                quoted=shlex.quote(str(folder)),
                otherwise=ELSE,
            )
        )
    if path.is_dir():
        raise RegistryError(
            said(
                "the database {path} is a folder: name a file in it, for example {value}",
                path=path,
                value=path / "robot.db",
            )
        )
    if not path.exists():
        if not create:
            raise RegistryError(
                said(
                    "there is no database {path}: `msbot master` makes one when it runs, {otherwise}",
                    path=path,
                    otherwise=ELSE,
                )
            )
        if not os.access(folder, os.W_OK):
            raise RegistryError(
                said(
                    "the database {path} cannot be made: allow writing to {folder} (`chmod u+w`), {otherwise}",
                    path=path,
                    folder=folder,
                    otherwise=ELSE,
                )
            )
        return
    if not read_only and not (os.access(path, os.W_OK) and os.access(folder, os.W_OK)):
        _refuse_file_of_another(path)
        raise RegistryError(
            said(
                "the database {path} is read-only: allow writing to the file and its folder (`chmod u+w`), {otherwise}",
                path=path,
                otherwise=ELSE,
            )
        )
    _check_magic(path)


def _refuse_file_of_another(path: Path) -> None:
    """Say whose a database is that this user may not use, as that of a service; changing its rights would be wrong.

    Raises:
        RegistryError: it belongs to another user.
    """
    if not hasattr(os, "geteuid"):
        return
    owner = path.stat().st_uid
    if owner == os.geteuid():
        return
    try:
        from pwd import getpwuid  # not everywhere

        name = getpwuid(owner).pw_name
    except (ImportError, KeyError):
        name = f"'#{owner}'"  # sudo(8): a number
    raise RegistryError(
        said(
            "the database {path} belongs to another user: put `sudo -u {name}` before the command, {otherwise}",
            path=path,
            name=name,
            otherwise=ELSE,
        )
    )


in_use: Counter[tuple[int, int]] = Counter()
"""Files (device, number) that this process has open as databases.

Nothing but SQLite may open and close them: when a process closes a file, POSIX releases all locks that the process has
on it, and the next program to open the database would think that nobody uses it and delete the log that is being
written.
"""


def identity_of(path: Path) -> tuple[int, int]:
    """Which file it is, whatever its name.

    Raises:
        OSError: it is not there, or cannot be inspected.
    """
    found = path.stat()
    return found.st_dev, found.st_ino


def _check_magic(path: Path) -> None:
    try:
        if in_use[identity_of(path)]:
            return
        with open_input_file(path) as stream:
            beginning = stream.read(len(MAGIC)) or b""
    except OSError as error:
        if isinstance(error, PermissionError):
            _refuse_file_of_another(path)
        raise RegistryError(
            said(
                "the database {path} cannot be read ({strerror}): mend that, {otherwise}",
                path=path,
                strerror=error.strerror,
                otherwise=ELSE,
            )
        ) from None
    if beginning and beginning != MAGIC:
        raise RegistryError(
            said(
                "{path} is not a database: some other file has this name; move it away, {otherwise}",
                path=path,
                otherwise=ELSE,
            )
        )


def sqlite_address(path: Path, *, may_make: bool = False) -> str:
    """The file as an SQLite address; SQLite must not create it again: a deleted one would come back empty."""
    return f"file:{quote(str(path))}?mode={'rwc' if may_make else 'rw'}"


def make_private(path: Path) -> None:
    """Make a file private to its owner, creating it if needed: it contains keys and password hashes.

    Raises:
        OSError: it cannot be created.
    """
    try:
        os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o600))
    except FileExistsError:
        with contextlib.suppress(OSError):  # a file of somebody else, or a system without such rights
            os.chmod(path, 0o600)


_AS_TEXT: Final[Mapping[str, object]] = {"client_encoding": "utf8"}
"""A database made with the locale C would give octets in place of text."""
_SERVER_READ_ONLY = "-c default_transaction_read_only=on"


def make_engine(address: Address, *, busy_timeout_s: float, read_only: bool) -> Engine:
    """An engine for the address; nothing is opened yet.

    Raises:
        RegistryError: the driver is not installed.
    """
    if address.path is None:
        try:
            options: dict[str, object] = {"connect_timeout": max(1, round(busy_timeout_s)), **_AS_TEXT}
            if read_only:
                options["options"] = _SERVER_READ_ONLY
            # A server that was restarted is noticed before a statement fails.
            return create_engine(address.url, connect_args=options, pool_pre_ping=True)
        except ImportError:
            raise RegistryError(said("PostgreSQL needs a driver: pip install 'msbot[postgres]'")) from None
    path, was_there = address.path, address.path.exists()

    def connect() -> sqlite3.Connection:
        nonlocal was_there
        where = sqlite_address(path, may_make=not was_there)
        connection = sqlite3.connect(where, uri=True, timeout=busy_timeout_s, check_same_thread=False)
        was_there = True
        return connection

    engine = create_engine("sqlite+pysqlite://", creator=connect, poolclass=QueuePool)

    @event.listens_for(engine, "connect")
    def set_up(connection: sqlite3.Connection, _entry: ConnectionPoolEntry) -> None:
        # The driver would begin transactions on its own, and only before some statements.
        connection.isolation_level = None
        connection.execute("PRAGMA foreign_keys = ON")
        connection.execute("PRAGMA synchronous = FULL")
        if read_only:
            connection.execute("PRAGMA query_only = ON")

    @event.listens_for(engine, "begin")
    def begin(connection: Connection) -> None:
        options = connection.get_execution_options()
        if options.get(WRITE, False):
            wait_ms = round(1000 * options.get(WAIT_S, busy_timeout_s))
            connection.exec_driver_sql(f"PRAGMA busy_timeout = {wait_ms}")
            connection.exec_driver_sql("BEGIN IMMEDIATE")
        elif not options.get(AT_ONCE, False):
            connection.exec_driver_sql("BEGIN")

    return engine


_QUICK_ANSWERS = "-c statement_timeout=1500 -c idle_in_transaction_session_timeout=1000"


def make_lease_engine(address: Address) -> Engine:
    """An engine for the lease of a master: each question is answered within some two seconds, or fails.

    Raises:
        RegistryError: the driver is not installed.
    """
    options = {"connect_timeout": 2, "tcp_user_timeout": 1500, "options": _QUICK_ANSWERS, **_AS_TEXT}
    try:
        return create_engine(address.url, connect_args=options, pool_size=1, isolation_level="AUTOCOMMIT")
    except ImportError:
        raise RegistryError("PostgreSQL needs a driver: pip install 'msbot[postgres]'") from None


def use_write_ahead_log(engine: Engine, address: Address) -> None:
    """Let readers and the writer work at the same time; the file remembers it.

    Raises:
        RegistryError: the file cannot be used.
    """
    if address.path is None:
        return
    with told_as_registry_error(address.words):
        connection = engine.raw_connection()
        try:
            connection.cursor().execute("PRAGMA journal_mode = WAL")
        finally:
            connection.close()
