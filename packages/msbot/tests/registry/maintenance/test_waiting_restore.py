"""A backup that waits beside the database until the master starts anew."""

import errno
import os
import shutil
from pathlib import Path

import pytest

from msbot.config import Blueprint, Library
from msbot.registry import Registry, open_registry
from msbot.registry.maintenance import database_maintenance, waiting_restore
from msbot_xrce.errors import RegistryError
from tests.registry.hand import Hand


@pytest.fixture(autouse=True)
def in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """A backup is read here: `test_backup_check.py` sees to the other process, which takes long to start."""
    monkeypatch.setattr(database_maintenance, "run_limited", lambda function, _limits, *arguments: function(*arguments))


@pytest.fixture
def backup(registry: Registry, path: Path, blueprint: Blueprint, library: Library, tmp_path: Path) -> Path:
    """A backup of the database while bob could sign in; he cannot any more."""
    registry.robots.apply_blueprint(blueprint, library)
    Hand(registry).keep_user("ann", "administrator", "ann", password_hash="salt", tokens=())
    Hand(registry).keep_user("bob", "student", "ann", password_hash="salt", tokens=())
    database_maintenance.back_up(str(path), tmp_path / "copy.db")
    Hand(registry).remove_user("bob", "ann")
    return tmp_path / "copy.db"


def test_what_is_handed_in_last_holds_from_the_next_start_on(
    backup: Path, registry: Registry, path: Path, tmp_path: Path
) -> None:
    database_maintenance.back_up(str(path), tmp_path / "newer.db")
    waiting_restore.hold(str(path), tmp_path / "newer.db")
    assert waiting_restore.hold(str(path), backup) == path.with_name("robot.db.restore")
    assert registry.users.find("bob") is None
    registry.close()
    kept = waiting_restore.bring_back_held(str(path))
    assert kept is not None
    assert kept.exists()
    with open_registry(path) as again:
        assert again.users.find("bob") is not None
    with open_registry(kept) as before:
        assert before.users.find("bob") is None
    assert waiting_restore.bring_back_held(str(path)) is None


@pytest.mark.parametrize("content", [b"", b"no database", b"SQLite format 3\x00" + bytes(100)])
def test_what_is_no_backup_is_refused_and_nothing_waits(
    content: bytes, registry: Registry, path: Path, tmp_path: Path
) -> None:
    (tmp_path / "handed.in").write_bytes(content)
    with pytest.raises(RegistryError, match="this backup is not used: ") as caught:
        waiting_restore.hold(str(path), tmp_path / "handed.in")
    assert "/" not in str(caught.value)  # the person has handed in a file, and knows nothing of where it was put
    assert waiting_restore.bring_back_held(str(path)) is None
    assert registry.robots.all() == []


def test_a_torn_backup_is_refused(backup: Path, path: Path) -> None:
    content = backup.read_bytes()
    backup.write_bytes(content[: len(content) // 2])
    with pytest.raises(RegistryError):
        waiting_restore.hold(str(path), backup)
    assert not path.with_name("robot.db.restore").exists()


def test_what_cannot_be_written_whole_leaves_what_waited_before(
    backup: Path, path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    database_maintenance.back_up(str(path), tmp_path / "newer.db")
    waiting = waiting_restore.hold(str(path), backup)
    before, copyfile = waiting.read_bytes(), shutil.copyfile

    def full(source: Path, target: Path) -> None:
        if target.parent == path.parent:
            target.write_bytes(b"SQLite")
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        copyfile(source, target)

    monkeypatch.setattr(shutil, "copyfile", full)
    with pytest.raises(RegistryError, match="No space left"):
        waiting_restore.hold(str(path), tmp_path / "newer.db")
    assert waiting.read_bytes() == before
    assert [one.name for one in path.parent.glob("robot.db.restore*")] == [waiting.name]


def test_a_master_that_ends_meanwhile_leaves_no_half_backup(
    backup: Path, path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    content, check = backup.read_bytes(), database_maintenance.check_backup

    def check_and_end(copy: Path, *, needs_administrator: bool) -> None:
        check(copy, needs_administrator=needs_administrator)
        backup.unlink()  # as the folder of what was handed in, when its request is cancelled

    monkeypatch.setattr(waiting_restore, "check_backup", check_and_end)
    assert waiting_restore.hold(str(path), backup).read_bytes() == content


def test_a_waiting_file_that_is_no_backup_is_named_with_the_way_out(path: Path, registry: Registry) -> None:
    waiting = path.with_name("robot.db.restore")
    waiting.write_bytes(b"")
    with pytest.raises(RegistryError, match=r"robot\.db\.restore waits .* not a database; move it away to start"):
        waiting_restore.bring_back_held(str(path))
    assert waiting.exists()


def test_a_folder_that_cannot_be_written_is_told(backup: Path, path: Path) -> None:
    path.with_name("robot.db.restore").mkdir()
    with pytest.raises(RegistryError, match=r"cannot keep the backup at .*robot\.db\.restore"):
        waiting_restore.hold(str(path), backup)


def test_a_database_on_a_server_takes_no_backup_while_a_master_runs() -> None:
    with pytest.raises(RegistryError, match="only while no master runs: `msbot db restore"):
        waiting_restore.hold("postgresql://somewhere/robots", Path("copy.db"))
    assert waiting_restore.bring_back_held("postgresql://somewhere/robots") is None
