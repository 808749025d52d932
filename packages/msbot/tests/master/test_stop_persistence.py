"""STOP is kept in a file and in the store; the newer of the two holds, and a file that nobody can read means STOP."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from msbot.master import StopStore, stop_file
from msbot.master.stop_persistence import StopFile
from msbot.pnp import MemoryStore, StopRecord
from msbot_xrce.errors import ConfigError

STOP = StopRecord(3, True, "ann", "fire", 5)


def keep(keeper: StopStore, record: StopRecord) -> str:
    """Keep a record, the last one; gives the trouble."""
    trouble = kept(keeper, record)
    keeper.close()
    return trouble


def kept(keeper: StopStore, record: StopRecord) -> str:
    """Keep a record; gives the trouble."""
    done = threading.Event()
    found: list[str] = []

    def tell(_record: StopRecord, trouble: str) -> None:
        found.append(trouble)
        done.set()

    keeper.store(record, tell)
    assert done.wait(30)
    return found[0]


def test_what_was_kept_is_there_for_the_next_master(tmp_path: Path) -> None:
    path = tmp_path / "state" / "stop.json"
    assert keep(StopStore(MemoryStore(), path), STOP) == ""
    assert StopStore(MemoryStore(), path).load() == STOP, "the file alone is enough"
    assert path.stat().st_mode & 0o077 == 0
    assert [one.name for one in path.parent.iterdir()] == ["stop.json"], "no draft is left behind"


def test_the_store_alone_is_enough(tmp_path: Path) -> None:
    store = MemoryStore()
    assert keep(StopStore(store), STOP) == ""
    assert StopStore(store, tmp_path / "not there.json").load() == STOP


def test_an_older_backup_does_not_end_a_stop_and_an_older_file_does_not_either(tmp_path: Path) -> None:
    path = tmp_path / "stop.json"
    keep(StopStore(MemoryStore(), path), STOP)
    old = MemoryStore()
    old.stop = StopRecord(2, False)
    assert StopStore(old, path).load() == STOP
    newer = MemoryStore()
    newer.stop = StopRecord(3, False, "bob")
    assert StopStore(newer, path).load() == newer.stop


def test_a_file_that_cannot_be_read_means_stop(tmp_path: Path) -> None:
    path = tmp_path / "stop.json"
    path.write_text("{half")
    record = StopStore(MemoryStore(), path).load()
    assert record.holds
    assert str(path) in record.reason


def test_a_file_that_cannot_be_read_counts_more_than_an_older_go_of_the_database(tmp_path: Path) -> None:
    path = tmp_path / "stop.json"
    path.write_text("{half")
    database = MemoryStore()
    database.stop = StopRecord(5, False, "bob")
    record = StopStore(database, path).load()
    assert record.holds
    assert record.is_newer_than(database.stop)


def test_without_a_thread_a_robot_does_not_start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", refuse)
    with pytest.raises(ConfigError, match="no thread can be started"):
        StopStore(MemoryStore(), tmp_path / "stop.json")


def test_after_the_start_no_further_thread_is_needed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    keeper = StopStore(MemoryStore(), tmp_path / "stop.json")
    monkeypatch.setattr(threading.Thread, "start", None)
    assert keep(keeper, STOP) == ""


def test_a_failure_that_nobody_thought_of_is_said_and_the_next_stop_is_stored(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_file: StopFile, _record: StopRecord) -> None:
        raise failures.pop(0)

    path = tmp_path / "stop.json"
    keeper = StopStore(MemoryStore(), path)
    failures: list[Exception] = [KeyError("odd"), MemoryError(), MemoryError()]
    with monkeypatch.context() as broken:
        broken.setattr(StopFile, "write", fail)
        assert "STOP is not stored" in kept(keeper, STOP)
        assert "no memory" in kept(keeper, STOP)
    assert kept(keeper, STOP) == ""
    assert StopStore(MemoryStore(), path).load() == STOP


def test_a_lack_of_memory_is_mended_by_what_was_set_aside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    keeper, write, tries = StopStore(MemoryStore(), tmp_path / "stop.json"), StopFile.write, []

    def once(file: StopFile, record: StopRecord) -> None:
        tries.append(record)
        if len(tries) == 1:
            raise MemoryError
        write(file, record)

    monkeypatch.setattr(StopFile, "write", once)
    assert kept(keeper, STOP) == ""
    assert len(tries) == 2


def test_nothing_was_ever_said(tmp_path: Path) -> None:
    assert StopStore(MemoryStore(), tmp_path / "stop.json").load() == StopRecord()


class Away(MemoryStore):
    """A database that takes nothing."""

    def is_kept(self, timeout_s: float) -> bool:
        return False


@pytest.mark.parametrize(("store", "words"), [(MemoryStore(), ""), (Away(), "STOP is not stored: ")])
def test_without_the_file_the_database_must_confirm(store: MemoryStore, words: str, tmp_path: Path) -> None:
    (tmp_path / "a file").write_text("")
    trouble = keep(StopStore(store, tmp_path / "a file" / "stop.json"), STOP)
    assert trouble.startswith(words)
    assert bool(trouble) == bool(words)


@pytest.mark.parametrize(("store", "words"), [(MemoryStore(), ""), (Away(), "STOP is stored on this computer only: ")])
def test_where_another_master_may_take_over_the_database_must_confirm_too(
    store: MemoryStore, words: str, tmp_path: Path
) -> None:
    trouble = keep(StopStore(store, tmp_path / "stop.json", is_shared=True), STOP)
    assert trouble.startswith(words)
    assert bool(trouble) == bool(words)
    assert StopStore(MemoryStore(), tmp_path / "stop.json").load() == STOP, "the file has it in any case"


def test_each_robot_of_each_database_has_its_own_file(tmp_path: Path) -> None:
    files = {
        stop_file(name, serial, database, tmp_path)
        for name in ("R2", "R/2")
        for serial in ("1", "2")
        for database in ("/a/robot.db", "/b/robot.db")
    }
    assert len(files) == 8
    assert {path.parent for path in files} == {tmp_path / "stop"}
