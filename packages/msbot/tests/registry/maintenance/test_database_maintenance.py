"""Backups that can be brought back anywhere, migrations on demand, contradictions that are found."""

import logging
import sqlite3
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest
from sqlalchemy import Table, select, text

from msbot.config import Blueprint, Library
from msbot.pnp import Group, PartState
from msbot.registry import ProgramSource, Registry, lesson_ticks, open_registry
from msbot.registry.database.tables import metadata
from msbot.registry.hand_ins import HandIn
from msbot.registry.maintenance import database_maintenance
from msbot_agent.text.sentence import said
from msbot_xrce.errors import ConfigError, RegistryError
from tests.registry.database.test_schema import NEXT, NOW, _migrations
from tests.registry.events import CLAIM, UID, changed
from tests.registry.hand import Hand


@pytest.fixture(autouse=True)
def in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """A backup is read here: `test_backup_check.py` sees to the other process, which takes long to start."""
    monkeypatch.setattr(database_maintenance, "run_limited", lambda function, _limits, *arguments: function(*arguments))


@pytest.fixture
def full(registry: Registry, blueprint: Blueprint, library: Library) -> Registry:
    """A registry with rows in every table."""
    robot = registry.robots.apply_blueprint(blueprint, library)
    store = registry.runs.begin(robot)
    store.remember(UID, "AA", CLAIM)
    store.journal(changed(PartState.ACTIVE))
    Hand(registry).place(robot, UID, "BB", "Ann")
    Hand(registry).undo(robot, None, "Ann")
    Hand(registry).block(robot, "number", "WXYZ", "hot", "Ann")
    Hand(registry).keep_user("ann", "administrator", "ann", password_hash="salt", tokens=(("desk", "abc"),))
    registry.keys.store(UID, b"\x00secret", "ann")
    registry.programs.store("ann", "blink", ProgramSource("from msbot import Part"))
    registry.lesson_ticks.note(["ann"], "ring", "1.1", 5)
    registry.hand_ins.store(HandIn("ann", "ring", 6, 5, "blink", "from msbot import Part", "done", {"1.3": "ten"}))
    registry.class_groups.replace(robot, [Group("Red", ("ann",), ("AA",))])
    registry.runs.node_ids(robot, "can:0").assign(7, UID)
    registry.storage.flush()
    return registry


def _rows(registry: Registry, table: Table) -> list[tuple[object, ...]]:
    order = list(table.primary_key.columns)
    with registry.storage.engine.connect() as connection:
        return [tuple(row) for row in connection.execute(select(table).order_by(*order))]


def _content(registry: Registry) -> dict[str, list[tuple[object, ...]]]:
    return {table.name: _rows(registry, table) for table in metadata.sorted_tables}


def test_a_backup_holds_all_rows_and_is_one_file(full: Registry, address: str, tmp_path: Path) -> None:
    target = tmp_path / "copy.db"
    rows = database_maintenance.back_up(address, target)
    before = _content(full)
    assert rows == sum(len(content) for content in before.values())
    assert [name for name, content in before.items() if not content and name not in ("settings", "master_leases")] == []
    assert sorted(path.name for path in tmp_path.glob("copy.db*")) == ["copy.db"]
    assert target.read_bytes()[18:20] == b"\1\1"  # no write-ahead log beside it, which a copy on a stick would lack
    with open_registry(target) as copy:
        assert _content(copy) == before


def test_a_backup_is_never_written_over_a_file(full: Registry, address: str, tmp_path: Path) -> None:
    target = tmp_path / "copy.db"
    target.write_text("mine")
    with pytest.raises(RegistryError, match="exists already and is not overwritten"):
        database_maintenance.back_up(address, target)
    assert target.read_text() == "mine"


def test_a_backup_that_cannot_be_written_leaves_nothing(full: Registry, address: str, tmp_path: Path) -> None:
    with pytest.raises(RegistryError, match=r"the folder .* does not exist"):
        database_maintenance.back_up(address, tmp_path / "no" / "copy.db")


def test_a_backup_is_brought_back_and_what_was_there_is_kept(
    full: Registry, address: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, epoch_ns: object
) -> None:
    monkeypatch.chdir(tmp_path)
    backup = tmp_path / "copy.db"
    full.close()
    database_maintenance.back_up(address, backup)
    with open_registry(address) as registry:
        before = _content(registry)
        registry.keys.remove(UID, "ann")
        later = _content(registry)
    kept = database_maintenance.restore(backup, address)
    assert kept is not None
    with open_registry(address) as registry, open_registry(kept) as copy:
        assert _content(registry) == before
        assert _content(copy) == later
        # Counters go on behind the rows.
        assert registry.keys.store(UID, b"new", "ann").id == before["edits"][-1][0] + 1  # type: ignore[operator]  # an int


def test_a_backup_goes_to_a_new_database(full: Registry, address: str, tmp_path: Path) -> None:
    database_maintenance.back_up(address, tmp_path / "copy.db")
    assert database_maintenance.restore(tmp_path / "copy.db", str(tmp_path / "new.db")) is None
    with open_registry(tmp_path / "new.db") as registry:
        assert _content(registry) == _content(full)


def test_nothing_is_replaced_under_a_running_robot(full: Registry, address: str, tmp_path: Path) -> None:
    database_maintenance.back_up(address, tmp_path / "copy.db")
    with pytest.raises(
        RegistryError, match=r"robot MSBOT_MASTER is being run with the database .*: stop its master first"
    ):
        database_maintenance.restore(tmp_path / "copy.db", address)


def test_what_is_no_backup_is_refused(address: str, tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text("[robot] # the blueprint")
    with pytest.raises(RegistryError, match="is not a database"):
        database_maintenance.restore(tmp_path / "robot.toml", address)
    with pytest.raises(RegistryError, match=r"there is no backup .*: name a file that `msbot db backup` has written"):
        database_maintenance.restore(tmp_path / "nothing.db", address)


def test_an_older_database_is_migrated_on_demand(path: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.ERROR)
    open_registry(path).close()
    newer = _migrations(tmp_path, NEXT)
    assert database_maintenance.migrate(str(path)) == database_maintenance.Migrated(NOW, NOW)
    assert database_maintenance.migrate(str(path), migrations=newer) == database_maintenance.Migrated(NOW, NOW + 1)
    with pytest.raises(RegistryError, match="was written by a newer MsBOT"):
        database_maintenance.migrate(str(path))
    with pytest.raises(RegistryError, match="there is no database"):
        database_maintenance.migrate(str(tmp_path / "other.db"))


def test_a_backup_without_room_names_its_file_and_leaves_nothing(
    full: Registry, address: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_room(where: str | Path, *, read_only: bool = False) -> Registry:
        if isinstance(where, str):  # the database itself
            return open_registry(where, read_only=read_only)
        for ending in ("", "-wal", "-shm"):
            Path(f"{where}{ending}").touch()
        raise RegistryError(said("the database {database} {fault}", database=str(where), fault="has no room"))

    monkeypatch.setattr(database_maintenance, "open_registry", no_room)
    with pytest.raises(RegistryError) as refused:
        database_maintenance.back_up(address, tmp_path / "copy.db")
    assert str(refused.value) == f"the database {tmp_path / 'copy.db'} has no room"
    assert list(tmp_path.glob("copy.db*")) == []


def test_a_sound_database_has_no_findings(full: Registry, address: str) -> None:
    assert database_maintenance.check(address) == []


@pytest.mark.parametrize(
    ("statement", "sentence"),
    [
        ("DELETE FROM library WHERE number = 'ABCD'", "slot AA wants part number ABCD, which is not in the library"),
        ("UPDATE slots SET configuration_version = 0 WHERE name = 'CC'", "the configuration of slot CC has no version"),
        (
            "INSERT INTO settings (slot_id, name, origin, value, changed_ns, who) "
            "SELECT id, 'colour', 'hand', '1', 1, '' FROM slots WHERE name = 'AA'",
            "slot AA has a value for colour, which its part type does not have",
        ),
        (
            "UPDATE bindings SET port = 'nose' WHERE port = 'out' AND topic = 'HelloWorldTopic_1_to_2'",
            '"AA.nose": part ABCD',
        ),
    ],
)
def test_a_contradiction_is_found(full: Registry, address: str, statement: str, sentence: str) -> None:
    full.storage.write(lambda connection: connection.execute(text(statement)))
    (finding,) = database_maintenance.check(address)
    assert finding.startswith(f"robot MSBOT_MASTER: {sentence}")


@pytest.mark.parametrize("column", ["slot_id", "placed_slot_id"])
def test_a_part_in_a_slot_of_another_robot_is_found(
    full: Registry, address: str, blueprint: Blueprint, library: Library, column: str
) -> None:
    full.robots.apply_blueprint(replace(blueprint, robot=replace(blueprint.robot, name="OTHER")), library)
    assert database_maintenance.check(address) == []
    full.storage.write(
        lambda connection: connection.execute(
            text(
                f"UPDATE parts SET {column} = (SELECT max(slots.id) FROM slots JOIN robots ON robots.id = "
                "slots.robot_id WHERE robots.name = 'OTHER')"
            )
        )
    )
    (finding,) = database_maintenance.check(address)
    assert finding == f"robot MSBOT_MASTER: part {UID.hex()} is in a slot of another robot"


def test_edits_and_journal_are_looked_at(full: Registry, address: str) -> None:
    full.storage.write(lambda connection: connection.execute(text("UPDATE edits SET undone_by = 77 WHERE id = 3")))
    full.storage.write(lambda connection: connection.execute(text("UPDATE journal SET to_state = 'asleep'")))
    assert database_maintenance.check(address) == [
        "edit 3 was undone by an edit that is not there",
        "1 line of the journal tells of a state that does not exist",
    ]


def test_a_broken_reference_is_found(full: Registry, path: Path) -> None:
    full.close()
    with closing(sqlite3.connect(path)) as connection:
        connection.execute("UPDATE parts SET slot_id = 99")
        connection.commit()
    (finding,) = database_maintenance.check(str(path))
    assert finding == "row 1 of parts refers to a row of slots that is not there"


def test_a_damaged_file_is_found(full: Registry, path: Path) -> None:
    full.close()
    with closing(sqlite3.connect(path, isolation_level=None)) as connection:
        connection.execute("PRAGMA writable_schema = ON")
        connection.execute("UPDATE sqlite_master SET sql = replace(sql, 'UNIQUE', '') WHERE name = 'bindings'")
        connection.execute("DROP INDEX IF EXISTS ix_parts_slot_id")
        root = connection.execute("SELECT rootpage FROM sqlite_master WHERE name = 'journal'").fetchone()[0]
        connection.execute("UPDATE sqlite_master SET rootpage = ? WHERE name = 'ix_journal_robot_id'", (root,))
    with pytest.raises(RegistryError, match="is damaged"):
        database_maintenance.check(str(path))


def test_no_more_ticks_of_lessons_are_kept_than_agreed(full: Registry, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lesson_ticks, "MOST_TICKS", 3)
    full.lesson_ticks.note(["bob", "cid"], "ring", "1.1", 6)
    with pytest.raises(ConfigError, match="more than 3 ticks"):
        full.lesson_ticks.note(["dan"], "ring", "1.1", 7)
    assert len(full.lesson_ticks.all()) == 3
