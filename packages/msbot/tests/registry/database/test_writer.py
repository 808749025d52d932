"""The writer thread: order, batches, and what happens while the database cannot be written."""

import logging
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from threading import Event

import pytest
from sqlalchemy import Connection, Engine, event, text

from msbot.registry.database import database_writer as writer_module
from msbot.registry.database.database_writer import DatabaseWriter, Note
from msbot.registry.database.engine import make_engine, parse_address, use_write_ahead_log


@pytest.fixture
def engine(path: Path) -> Iterator[Engine]:
    address = parse_address(path)
    engine = make_engine(address, busy_timeout_s=0.005, read_only=False)
    use_write_ahead_log(engine, address)
    with engine.connect() as connection, connection.begin():
        connection.execute(text("CREATE TABLE lines (n INTEGER PRIMARY KEY)"))
    yield engine
    engine.dispose()


@pytest.fixture
def writer(engine: Engine) -> Iterator[DatabaseWriter]:
    writer = DatabaseWriter(engine, "robot.db", first_retry_s=60)
    yield writer
    writer.close()


def _line(number: int) -> Note:
    def write(connection: Connection) -> None:
        connection.execute(text("INSERT INTO lines VALUES (:n)"), {"n": number})

    return write


def _lines(path: Path) -> list[int]:
    with closing(sqlite3.connect(path)) as connection:
        return [row[0] for row in connection.execute("SELECT n FROM lines ORDER BY rowid")]


def _lock(path: Path) -> sqlite3.Connection:
    connection = sqlite3.connect(path, isolation_level=None)
    connection.execute("BEGIN IMMEDIATE")
    return connection


def test_changes_are_stored_in_order(writer: DatabaseWriter, path: Path) -> None:
    for number in range(1000):
        writer.put(_line(number))
    assert writer.flush()
    assert _lines(path) == list(range(1000))
    assert (writer.pending, writer.trouble, writer.lost) == (0, None, 0)


def test_many_changes_share_a_transaction(writer: DatabaseWriter, path: Path) -> None:
    started, go_on, seen = Event(), Event(), []

    def first(connection: Connection) -> None:
        started.set()
        go_on.wait()

    def look(connection: Connection) -> None:
        seen.append(_lines(path))

    writer.put(first)
    assert started.wait(10)
    for number in range(3):
        writer.put(_line(number))
        writer.put(look)
    go_on.set()
    assert writer.flush()
    assert seen == [[], [], []]
    assert _lines(path) == [0, 1, 2]


def test_while_another_program_holds_the_database_changes_wait_in_memory(
    writer: DatabaseWriter, path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with closing(_lock(path)):
        writer.put(_line(1))
        assert not writer.flush()
        writer.put(_line(2))
        assert not writer.flush()
        assert writer.trouble == (
            "the database robot.db is locked by another program: close the other msbot or database tool that writes "
            "to it, or choose another --db; changes kept in memory until it can be written: 2"
        )
    assert writer.flush()
    assert _lines(path) == [1, 2]
    assert writer.trouble is None
    assert caplog.messages == [
        "the database robot.db is locked by another program: close the other msbot or database tool that writes to "
        "it, or choose another --db; until then changes are kept in memory",
        "the database robot.db can be written again",
    ]


def test_the_writer_tries_again_by_itself(engine: Engine, path: Path) -> None:
    writer = DatabaseWriter(engine, "robot.db", first_retry_s=0.001)
    stored = Event()

    def last(connection: Connection) -> None:
        stored.set()

    with closing(_lock(path)):
        writer.put(_line(1))
        writer.flush()
        writer.put(last)
    assert stored.wait(10)
    writer.close()
    assert not writer._thread.is_alive(), "whoever has closed it may take the file away"
    assert _lines(path) == [1]


@pytest.mark.parametrize(
    ("pragma", "undo", "words"),
    [
        ("query_only = ON", "query_only = OFF", "is read-only: allow writing to the file and its folder"),
        ("max_page_count = 1", "max_page_count = 100000", "has no room: the disk is full; delete something"),
    ],
)
def test_a_full_disk_or_a_read_only_file_stops_nobody(
    writer: DatabaseWriter, engine: Engine, path: Path, pragma: str, undo: str, words: str
) -> None:
    present = pragma

    @event.listens_for(engine, "checkout")
    def set_pragma(connection: sqlite3.Connection, _entry: object, _proxy: object) -> None:
        connection.execute(f"PRAGMA {present}")

    def much(connection: Connection) -> None:
        connection.execute(text("CREATE TABLE much (bytes BLOB)"))
        connection.execute(text("INSERT INTO much VALUES (zeroblob(100000))"))

    writer.put(much)
    writer.put(_line(1))
    assert not writer.flush()
    assert writer.trouble is not None
    assert words in writer.trouble
    assert writer.pending == 2
    present = undo
    assert writer.flush()
    assert _lines(path) == [1]
    assert writer.trouble is None


def test_a_change_the_database_does_not_take_is_given_up_alone(
    writer: DatabaseWriter, path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    def mistake(connection: Connection) -> None:
        raise KeyError("a mistake in the program")

    started, go_on = Event(), Event()

    def first(connection: Connection) -> None:
        started.set()
        go_on.wait()

    writer.put(first)
    assert started.wait(10)
    for change in (_line(1), _line(1), _line(2), mistake, _line(3)):
        writer.put(change)
    go_on.set()
    assert writer.flush()
    assert _lines(path) == [1, 2, 3]
    assert writer.lost == 2
    assert caplog.messages == ["the database robot.db does not take a change"] * 2


def test_when_too_many_wait_the_oldest_is_given_up_and_counted(engine: Engine, path: Path) -> None:
    writer = DatabaseWriter(engine, "robot.db", capacity=2, first_retry_s=60)
    with closing(_lock(path)):
        writer.put(_line(0))
        assert not writer.flush()
        for number in range(1, 6):
            writer.put(_line(number))
        assert writer.lost == 3
        assert writer.pending == 3
    writer.close()
    assert _lines(path) == [0, 4, 5]


def test_flush_gives_up_in_time(writer: DatabaseWriter, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(writer_module, "SILENT_S", 60.0)
    started, go_on = Event(), Event()

    def slow(connection: Connection) -> None:
        started.set()
        go_on.wait()

    writer.put(slow)
    assert started.wait(10)
    assert not writer.flush(timeout_s=0)
    assert writer.fault is None, "it is asked, and has not been silent for long"
    go_on.set()
    assert writer.flush()


def test_closing_stores_what_waits_and_ends(engine: Engine, path: Path) -> None:
    writer = DatabaseWriter(engine, "robot.db")
    for number in range(600):
        writer.put(_line(number))
    writer.close()
    assert _lines(path) == list(range(600))


def test_closing_while_locked_tells_what_is_lost(engine: Engine, path: Path, caplog: pytest.LogCaptureFixture) -> None:
    writer = DatabaseWriter(engine, "robot.db", first_retry_s=60)
    with closing(_lock(path)):
        writer.put(_line(1))
        assert not writer.flush()
        writer.put(_line(2))
        writer.close()
    assert _lines(path) == []
    assert caplog.records[-1].levelno == logging.ERROR
    assert caplog.messages[-1].startswith(
        "the database robot.db was closed before all changes were stored, 2 are lost: it is locked by another program"
    )


def test_a_change_after_closing_is_counted(engine: Engine, path: Path, caplog: pytest.LogCaptureFixture) -> None:
    writer = DatabaseWriter(engine, "robot.db")
    writer.close()
    writer.put(_line(1))
    assert writer.lost == 1
    assert caplog.messages == ["a change came after the database robot.db was closed; it is lost"]
    assert _lines(path) == []
