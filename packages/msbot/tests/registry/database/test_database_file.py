"""The guard of the database's file: whatever happens to the file, what is told, what is there, what stays open."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from sqlalchemy import Engine, text

from msbot.registry.database import storage as database_file
from msbot.registry.database.engine import (
    check_file,
    identity_of,
    in_use,
    make_engine,
    parse_address,
    use_write_ahead_log,
)
from msbot.registry.database.storage import DatabaseFile
from msbot_xrce.errors import RegistryError

FILES = ["robot.db", "robot.db-shm", "robot.db-wal"]
GONE = "was deleted while the robot ran, and cannot be restored ({}): look at its folder"
OTHER = "was replaced by another file while the robot ran: stop the master, and look which of the two is wanted"
OVERWRITTEN = "was overwritten by something else while the robot ran: stop the master, and put a backup in its place"


@pytest.fixture
def engine(path: Path) -> Iterator[Engine]:
    engine = make_engine(parse_address(path), busy_timeout_s=0.01, read_only=False)
    use_write_ahead_log(engine, parse_address(path))
    with engine.connect() as connection, connection.begin():
        connection.execute(text("CREATE TABLE lines (n INTEGER)"))
        connection.execute(text("INSERT INTO lines VALUES (7)"))
    yield engine
    engine.dispose()


@pytest.fixture
def guard(path: Path, engine: Engine) -> Iterator[DatabaseFile]:
    guard = DatabaseFile(engine, path)
    yield guard
    guard.close()
    guard.close()
    engine.dispose()
    assert {identity: count for identity, count in in_use.items() if count} == {}
    assert _open_below(path.parent) == []


def _open_below(folder: Path) -> list[str]:
    found = []
    for number in os.listdir("/proc/self/fd"):
        try:
            target = os.readlink(f"/proc/self/fd/{number}")
        except FileNotFoundError:  # the listing itself
            continue
        found += [Path(target).name] if target.startswith(str(folder)) else []
    return sorted(found)


def _files(path: Path) -> list[str]:
    return sorted(file.name for file in path.parent.iterdir())


def _lines(path: Path) -> list[int]:
    with closing(sqlite3.connect(path)) as connection:
        return [number for (number,) in connection.execute("SELECT n FROM lines")]


def _told(guard: DatabaseFile) -> str:
    with pytest.raises(RegistryError) as caught:
        guard.check()
    return str(caught.value)


def test_a_file_that_is_well_is_held_by_one_connection_and_known_to_be_in_use(
    guard: DatabaseFile, engine: Engine, path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for _ in range(3):
        guard.check()
    assert in_use == {**in_use, identity_of(path): 1}
    second = DatabaseFile(engine, path)
    assert in_use[identity_of(path)] == 2
    second.close()
    assert in_use[identity_of(path)] == 1
    engine.dispose()
    assert sorted({*_open_below(path.parent)}) == FILES
    monkeypatch.setattr(
        "msbot.registry.database.engine.open_input_file", None
    )  # closing it would take SQLite's locks away
    check_file(parse_address(path), create=False, read_only=False)


def test_a_deleted_file_is_written_again_as_often_as_it_takes(
    guard: DatabaseFile, engine: Engine, path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    for line in (7, 8):
        before = identity_of(path)
        path.rename(path.with_name("stays"))  # so that no new file can have its number
        log = path.with_name("robot.db-wal")
        assert log.stat().st_size > 0
        guard.check()
        assert log.stat().st_size == 0, "that of the file that is gone would be read with the new one"
        assert (in_use[before], in_use[identity_of(path)]) == (0, 1)
        assert _files(path) == [*FILES, "stays"]
        assert path.stat().st_mode & 0o777 == 0o600
        assert (_lines(path), engine.pool.checkedin()) == ([line], 0)  # type: ignore[attr-defined]  # a QueuePool
        with engine.connect() as connection:  # what is written goes to the new one
            connection.execute(text("UPDATE lines SET n = n + 1"))
            connection.commit()
        guard.check()
        path.with_name("stays").unlink()
    words = f"the database {path} was deleted while the robot ran; it is restored with all it had"
    assert caplog.messages == [words] * 2


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), sqlite3.OperationalError("disk I/O error")])
def test_a_deleted_file_that_cannot_be_written_again_is_tried_again_next_time(
    guard: DatabaseFile, path: Path, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    path.unlink()

    def fail(target: Path) -> None:
        target.touch()
        raise error

    with monkeypatch.context() as patch:
        patch.setattr(database_file, "make_private", fail)
        assert _told(guard) == GONE.format(error)
        assert set(_files(path)) <= {*FILES[1:]}
    guard.check()
    assert _lines(path) == [7]


def test_a_file_that_was_replaced_is_left_alone_and_what_was_there_is_rescued_once(
    guard: DatabaseFile, engine: Engine, path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for number in (1, 2):
        path.with_name(f"robot.db.rescued.{number}").write_text("of another time")
    path.rename(path.with_name("aside"))
    path.write_text("another file")
    with monkeypatch.context() as patch:

        def refuse(_: Path) -> None:
            raise OSError(28, "No space left on device")

        patch.setattr(database_file, "make_private", refuse)
        assert _told(guard) == OTHER
    kept = path.with_name("robot.db.rescued.3")
    for _ in range(2):
        assert _told(guard) == f"{OTHER}; what the robot had is kept in {kept}"
    assert _files(path) == ["aside", *FILES, *(f"robot.db.rescued.{number}" for number in (1, 2, 3))]
    assert (_lines(kept), kept.stat().st_mode & 0o777, path.read_text()) == ([7], 0o600, "another file")


def test_what_was_written_over_the_file_is_told_and_so_is_a_disk_that_does_not_answer(
    guard: DatabaseFile, path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with path.open("r+b") as stream:
        content = stream.read()
        stream.seek(0)
        stream.write(b"something else")
    assert [_told(guard), _told(guard)] == [OVERWRITTEN] * 2
    path.write_bytes(content)
    guard.check()

    def fail(_: Path) -> tuple[int, int]:
        raise OSError(5, "Input/output error")

    with monkeypatch.context() as patch:
        patch.setattr(database_file, "identity_of", fail)
        assert _told(guard) == "cannot be reached (Input/output error): look at the disk and its folder"
    guard.check()
