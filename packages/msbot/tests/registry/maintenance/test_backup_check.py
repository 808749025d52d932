"""What somebody hands in as a backup: damaged, hostile, or without anybody who could sign in."""

import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from msbot.config import Blueprint, Library
from msbot.registry import open_registry
from msbot.registry.maintenance import database_maintenance, waiting_restore
from msbot.registry.maintenance.database_maintenance import fault_of
from msbot_xrce.errors import RegistryError
from tests.registry.hand import Hand

ENDLESS = """
DROP TABLE users;
CREATE VIEW users AS WITH RECURSIVE more(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM more)
SELECT n AS name, 'administrator' AS role, '' AS password_hash, '[]' AS token_hashes, 0 AS created_ns, 0 AS changed_ns
FROM more;
"""


@pytest.fixture
def backup(path: Path, tmp_path: Path, blueprint: Blueprint, library: Library) -> Path:
    with open_registry(path) as registry:
        robot = registry.robots.apply_blueprint(blueprint, library)
        registry.runs.begin(robot)
        Hand(registry).keep_user("ada", "administrator", "ada", password_hash="hash")
    target = tmp_path / "backup.db"
    database_maintenance.back_up(str(path), target)
    return target


def _script(statements: str) -> Callable[[Path], None]:
    def change(backup: Path) -> None:
        with closing(sqlite3.connect(backup)) as connection:
            connection.executescript(statements)

    return change


def _flip(backup: Path) -> None:
    octets = bytearray(backup.read_bytes())
    for place in range(5000, len(octets), 97):
        octets[place] ^= 0xFF
    backup.write_bytes(octets)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (_script(ENDLESS), "it has a view 'users', and MsBOT makes none of that sort"),
        (_script("CREATE TRIGGER t AFTER INSERT ON parts BEGIN DELETE FROM edits; END"), "it has a trigger 't'"),
        (_script("UPDATE users SET role = 'god'"), "user ada has the role 'god', which does not exist"),
        (_script("DELETE FROM users"), "it has no administrator, so nobody could sign in"),
        (_script("UPDATE edits SET before = '{\"of\":'"), ""),
        (_script("UPDATE bindings SET port = x'00ff'"), ""),
        (_flip, ""),
        (lambda backup: backup.write_bytes(backup.read_bytes()[:9000]), ""),
        (lambda backup: backup.write_bytes(b"junk" * 10_000), "it is not a database"),
    ],
)
def test_what_is_wrong_with_it_is_said(backup: Path, change: Callable[[Path], object], words: str) -> None:
    change(backup)
    said = fault_of(str(backup), True)
    assert said
    assert words in said
    assert "Traceback" not in said


def test_a_good_one_is_taken_by_another_process_and_is_the_owners_only(backup: Path, path: Path) -> None:
    place = waiting_restore.hold(str(path), backup)
    assert place.read_bytes() == backup.read_bytes()
    assert waiting_restore.bring_back_held(str(path)) is not None
    kept = [file for file in path.parent.iterdir() if file.name.startswith(("robot.db", "backup.db"))]
    assert {file.name: file.stat().st_mode & 0o077 for file in kept} == dict.fromkeys((file.name for file in kept), 0)


def test_one_that_is_not_taken_leaves_nothing_behind(backup: Path, path: Path) -> None:
    _script(ENDLESS)(backup)
    with pytest.raises(RegistryError, match="this backup is not used: it has a view 'users'"):
        waiting_restore.hold(str(path), backup)
    assert not path.with_name("robot.db.restore").exists()
    with pytest.raises(RegistryError, match="this backup is not used: it has a view 'users'"):
        database_maintenance.restore(backup, str(path))


def test_the_owner_of_the_computer_may_restore_one_without_users(backup: Path, path: Path, tmp_path: Path) -> None:
    _script("DELETE FROM users")(backup)
    shutil.copyfile(backup, tmp_path / "plain.db")
    database_maintenance.restore(tmp_path / "plain.db", str(path))
    with open_registry(path) as registry:
        assert registry.users.all() == []
