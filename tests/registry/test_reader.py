"""Reading by one connection that stays open: always the newest, and a cut connection is opened anew."""

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from sqlalchemy import Connection, Engine, text
from sqlalchemy.exc import DBAPIError

from msbot.errors import RegistryError
from msbot.registry.engine import make_engine, parse_address, use_write_ahead_log
from msbot.registry.reader import Reader


@pytest.fixture
def engine(path: Path) -> Iterator[Engine]:
    address = parse_address(path)
    engine = make_engine(address, busy_timeout_s=0.01, read_only=False)
    use_write_ahead_log(engine, address)
    with sqlite3.connect(path) as connection:
        connection.execute("CREATE TABLE numbers (number INTEGER)")
    connection.close()
    yield engine
    engine.dispose()


def _count(connection: Connection) -> int:
    return int(connection.execute(text("SELECT count(*) FROM numbers")).scalar_one())


def test_every_look_sees_what_is_stored_and_disturbs_no_writer(engine: Engine, path: Path) -> None:
    reader = Reader(engine, "robot.db")
    with closing(sqlite3.connect(path)) as other:
        for expected in range(3):
            assert reader.read(_count) == expected
            other.execute("INSERT INTO numbers VALUES (1)")
            other.commit()
            busy, *_ = other.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()
            assert not busy
    reader.close()
    reader.close()
    assert reader.read(_count) == 3
    reader.close()


def test_an_error_is_told_with_the_remedy_and_the_next_look_works(engine: Engine) -> None:
    reader = Reader(engine, "robot.db")
    with pytest.raises(RegistryError, match=r"the database robot.db cannot be used \(no such table: letters\)"):
        reader.read(lambda connection: connection.execute(text("SELECT * FROM letters")))
    assert reader.read(_count) == 0
    reader.close()


def test_a_connection_that_was_cut_is_opened_anew_once(engine: Engine) -> None:
    reader = Reader(engine, "robot.db")
    looks: list[int] = []

    def cut(connection: Connection) -> int:
        looks.append(1)
        if len(looks) in (1, 3, 4):
            raise DBAPIError("SELECT", None, Exception("gone"), connection_invalidated=True)
        return _count(connection)

    assert reader.read(cut) == 0
    with pytest.raises(RegistryError, match="does not answer any more: is the server running"):
        reader.read(cut)
    assert len(looks) == 4
    assert reader.read(cut) == 0
    reader.close()
