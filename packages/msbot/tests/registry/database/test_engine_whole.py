"""Every kind of connection, and every state of the file that may become a database, in tables."""

from __future__ import annotations

import os
import sqlite3
from contextlib import closing
from itertools import product
from pathlib import Path

import pytest
from sqlalchemy import URL, create_engine

from msbot.registry.database import engine as engine_module
from msbot.registry.database.engine import (
    AT_ONCE,
    WAIT_S,
    WRITE,
    check_file,
    in_use,
    make_engine,
    make_lease_engine,
    make_private,
    parse_address,
    use_write_ahead_log,
)
from msbot_xrce.errors import RegistryError


@pytest.mark.parametrize("is_reader", [False, True])
def test_how_a_transaction_begins(path: Path, is_reader: bool) -> None:
    engine = make_engine(parse_address(path), busy_timeout_s=0.07, read_only=is_reader)
    said: list[str] = []
    with closing(engine.raw_connection()) as raw:
        connection = raw.driver_connection
        assert connection is not None
        connection.set_trace_callback(said.append)
        names = ("foreign_keys", "synchronous", "query_only", "busy_timeout")
        found = [connection.execute(f"PRAGMA {name}").fetchone()[0] for name in names]
        assert found == [1, 2, int(is_reader), 70]
        assert connection.isolation_level is None
    for writes, wait_s, at_once in product(
        (None, False, *([] if is_reader else [True])), (None, 0.25), (None, False, True)
    ):
        del said[:]
        options = {WRITE: writes, WAIT_S: wait_s, AT_ONCE: at_once}
        with engine.connect().execution_options(**{k: v for k, v in options.items() if v is not None}) as begun:
            begun.exec_driver_sql("SELECT 1")
        wait_ms = 70 if wait_s is None else 250
        first = [f"PRAGMA busy_timeout = {wait_ms}", "BEGIN IMMEDIATE"] if writes else [] if at_once else ["BEGIN"]
        assert said == [*first, "SELECT 1", *(["ROLLBACK"] if first else [])], options
    engine.dispose()


def test_a_server_is_asked_with_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[tuple[URL, dict[str, object]]] = []

    def make(url: URL, **options: object) -> object:
        made.append((url, options))
        return create_engine("sqlite://")

    monkeypatch.setattr(engine_module, "create_engine", make)
    address = parse_address("postgresql://user@host/robots")
    as_text = {"client_encoding": "utf8"}  # a database made with the locale C gives octets otherwise
    for busy_s, read_only in ((0.01, False), (2.4, False), (2.6, True)):
        make_engine(address, busy_timeout_s=busy_s, read_only=read_only)
    make_lease_engine(address)
    assert made == [
        (address.url, {"connect_args": {"connect_timeout": 1, **as_text}, "pool_pre_ping": True}),
        (address.url, {"connect_args": {"connect_timeout": 2, **as_text}, "pool_pre_ping": True}),
        (
            address.url,
            {
                "connect_args": {"connect_timeout": 3, "options": "-c default_transaction_read_only=on", **as_text},
                "pool_pre_ping": True,
            },
        ),
        (
            address.url,
            {
                "connect_args": {
                    "connect_timeout": 2,
                    "tcp_user_timeout": 1500,
                    "options": "-c statement_timeout=1500 -c idle_in_transaction_session_timeout=1000",
                    **as_text,
                },
                "pool_size": 1,
                "isolation_level": "AUTOCOMMIT",
            },
        ),
    ]

    def without(*_: object, **__: object) -> object:
        raise ImportError("psycopg")

    monkeypatch.setattr(engine_module, "create_engine", without)
    for lease in (False, True):
        with pytest.raises(RegistryError) as caught:
            make_lease_engine(address) if lease else make_engine(address, busy_timeout_s=1, read_only=False)
        assert str(caught.value) == "PostgreSQL needs a driver: pip install 'msbot[postgres]'"


def test_a_file_of_any_name_is_that_file_and_a_deleted_one_is_not_made_again(tmp_path: Path) -> None:
    names = ["a b.db", "a?mode=memory.db", "100%.db", "#1.db", "a%20b.db"]
    for name in names:
        address = parse_address(tmp_path / name)
        engine = make_engine(address, busy_timeout_s=1, read_only=False)
        use_write_ahead_log(engine, address)
        with engine.connect() as connection:
            assert connection.exec_driver_sql("PRAGMA journal_mode").scalar() == "wal"
            connection.exec_driver_sql("CREATE TABLE lines (n INTEGER)")
            connection.commit()
        engine.dispose()
    assert sorted(file.name for file in tmp_path.iterdir()) == sorted(names)
    (tmp_path / names[0]).unlink()
    engine = make_engine(parse_address(tmp_path / names[1]), busy_timeout_s=1, read_only=False)
    (tmp_path / names[1]).unlink()
    with pytest.raises(Exception, match="unable to open database file"), engine.connect():
        pass
    assert sorted(file.name for file in tmp_path.iterdir()) == sorted(names[2:])


KINDS = ("missing", "empty", "short", "text", "database", "in use", "no folder", "folder", "unreadable")


@pytest.mark.parametrize("kind", KINDS)
def test_which_file_may_become_a_database(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str) -> None:
    path = tmp_path / "no" / "robot.db" if kind == "no folder" else tmp_path / "robot.db"
    content = {
        "empty": b"",
        "short": b"SQLite",
        "text": b"[robot]\nname = 'mine'",
        "database": engine_module.MAGIC,
        "in use": b"[robot] whatever it is",
        "unreadable": b"SQLite format 3\x00",
    }
    if kind in content:
        path.write_bytes(content[kind])
    elif kind == "folder":
        path.mkdir()
    if kind == "in use":
        monkeypatch.setitem(in_use, engine_module.identity_of(path), 1)
    if kind == "unreadable":

        def refuse(*_: object) -> None:
            raise PermissionError(13, "Permission denied")

        monkeypatch.setattr("msbot.registry.database.engine.open_input_file", refuse)
    may: set[Path] = set()
    monkeypatch.setattr(os, "access", lambda asked, mode: mode != os.W_OK or Path(asked) in may)
    before = sorted(tmp_path.iterdir())
    for create, read_only, allowed in product(
        (False, True), (False, True), ((), (path,), (path.parent,), (path, path.parent))
    ):
        may = {*allowed}
        expected = _why_not(kind, path, create=create, read_only=read_only, may=may)
        if expected:
            with pytest.raises(RegistryError) as caught:
                check_file(parse_address(path), create=create, read_only=read_only)
            assert str(caught.value) == expected
        else:
            check_file(parse_address(path), create=create, read_only=read_only)
        assert sorted(tmp_path.iterdir()) == before


def _why_not(kind: str, path: Path, *, create: bool, read_only: bool, may: set[Path]) -> str:
    folder, otherwise = path.parent, "or choose another --db"
    words = {
        "no folder": f"the folder {folder} of the database does not exist: create it (`mkdir -p {folder}`), "
        + otherwise,
        "folder": f"the database {path} is a folder: name a file in it, for example {path}/robot.db",
    }
    if kind in words:
        return words[kind]
    if kind == "missing":
        if not create:
            return f"there is no database {path}: `msbot master` makes one when it runs, {otherwise}"
        if folder in may:
            return ""
        return f"the database {path} cannot be made: allow writing to {folder} (`chmod u+w`), {otherwise}"
    if not read_only and may != {path, folder}:
        return f"the database {path} is read-only: allow writing to the file and its folder (`chmod u+w`), {otherwise}"
    if kind == "unreadable":
        return f"the database {path} cannot be read (Permission denied): mend that, {otherwise}"
    if kind in ("short", "text"):
        return f"{path} is not a database: some other file has this name; move it away, {otherwise}"
    return ""


def test_only_the_owner_may_read_a_database(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    new, old = tmp_path / "new.db", tmp_path / "old.db"
    old.write_text("content")
    old.chmod(0o664)
    before = len(os.listdir("/proc/self/fd"))
    make_private(new)
    make_private(old)
    assert [(file.read_text(), file.stat().st_mode & 0o777) for file in (new, old)] == [("", 0o600), ("content", 0o600)]
    assert len(os.listdir("/proc/self/fd")) == before

    def refuse(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "chmod", refuse)
    make_private(old)  # somebody else's
    with pytest.raises(FileNotFoundError):
        make_private(tmp_path / "no" / "robot.db")


def test_use_of_the_log_leaves_no_connection_open(path: Path) -> None:
    address = parse_address(path)
    sqlite3.connect(path).close()
    engine = make_engine(address, busy_timeout_s=1, read_only=False)
    use_write_ahead_log(engine, address)
    assert engine.pool.checkedout() == 0  # type: ignore[attr-defined]  # a QueuePool
    engine.dispose()
    path.write_bytes(b"something else, and long enough" * 40)
    engine = make_engine(address, busy_timeout_s=1, read_only=False)
    with pytest.raises(RegistryError, match=r"^the database .*robot\.db is not a database"):
        use_write_ahead_log(engine, address)
    assert engine.pool.checkedout() == 0  # type: ignore[attr-defined]  # a QueuePool
    engine.dispose()
