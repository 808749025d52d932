"""Every kind of maintenance with every kind of file: what is answered, what is there afterwards, what stays open."""

from __future__ import annotations

import os
import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing
from importlib.resources import files
from pathlib import Path

import pytest
from sqlalchemy import Engine

from msbot.registry import registry
from msbot.registry.database import schema
from msbot.registry.database.engine import make_engine
from msbot.registry.database.schema import folder_migrations, own_migrations
from msbot.registry.maintenance import database_maintenance
from msbot.registry.maintenance.database_maintenance import Migrated
from msbot_xrce.errors import RegistryError

BEFORE = own_migrations().newest
NOW = BEFORE + 1
"""The schema of an up-to-date database of the next version, as `NONE` that of what is no database of MsBOT."""
NONE = None
NEXT = f"""
import sqlalchemy as sa
from alembic import op

revision, down_revision = "{NOW:04}", "{BEFORE:04}"


def upgrade() -> None:
    op.create_table("next", sa.Column("id", sa.Integer(), primary_key=True))
"""
"""A migration as the next version may have it."""

MISSING = "there is no database ~/robot.db: `msbot master` makes one when it runs, or choose another --db"
FOLDER = "the database ~/robot.db is a folder: name a file in it, for example ~/robot.db/robot.db"
TEXT = "~/robot.db is not a database: some other file has this name; move it away, or choose another --db"
OLDER = (
    f"the database ~/robot.db was written by an older MsBOT (schema {BEFORE}, this one knows {NOW}): `msbot db migrate "
    "--db ~/robot.db`"
)
EMPTY = "the database ~/robot.db is empty: `msbot master ROBOT.toml --db ~/robot.db` puts a robot there"
NEWER = (
    f"the database ~/robot.db was written by a newer MsBOT (schema 9999, this one knows {NOW}): update MsBOT or choose "
    "another --db"
)
OTHER = "the database ~/robot.db belongs to another program (it has cats): choose another --db"
NO_BACKUP = "there is no backup ~/robot.db: name a file that `msbot db backup` has written"
KEPT = f"robot.db.schema{BEFORE}.1.backup"
IN_BACKUP = "this backup is not used: "


def _sql(path: Path, script: str) -> None:
    with closing(sqlite3.connect(path)) as connection:
        connection.executescript(script)


def _make(kind: str, path: Path, ours: bytes, older: bytes) -> None:
    """The file before, open for all to read."""
    match kind:
        case "folder":
            path.mkdir()
        case "empty":
            path.touch()
        case "text":
            path.write_text("[robot] of mine, and no database at all")
        case "older":
            path.write_bytes(older)
        case "other":
            _sql(path, "CREATE TABLE cats (name TEXT)")
        case "newer" | "ours":
            path.write_bytes(ours)
            if kind == "newer":
                _sql(path, "UPDATE alembic_version SET version_num = '9999'")
    if kind != "missing":
        path.chmod(0o755 if kind == "folder" else 0o644)


def _restored(path: Path, ours: bytes) -> Path | None:
    backup = path.with_name("good.db")
    backup.write_bytes(ours)
    return database_maintenance.restore(backup, str(path))


ACTIONS: dict[str, Callable[[Path, bytes], object]] = {
    "check": lambda path, _: database_maintenance.check(str(path)),
    "migrate": lambda path, _: database_maintenance.migrate(str(path)),
    "back up": lambda path, _: database_maintenance.back_up(str(path), path.with_name("copy.db")),
    "bring back": lambda path, _: database_maintenance.restore(path, str(path.with_name("new.db"))),
    "replace": _restored,
}
TABLE: dict[str, dict[str, object]] = {
    "check": {
        "missing": MISSING,
        "folder": FOLDER,
        "empty": EMPTY,
        "text": TEXT,
        "older": OLDER,
        "newer": NEWER,
        "other": OTHER,
        "ours": [],
    },
    "migrate": {
        "missing": MISSING,
        "folder": FOLDER,
        "empty": Migrated(0, NOW),
        "text": TEXT,
        "older": Migrated(BEFORE, NOW),
        "newer": NEWER,
        "other": OTHER,
        "ours": Migrated(NOW, NOW),
    },
    "back up": {
        "missing": MISSING,
        "folder": FOLDER,
        "empty": EMPTY,
        "text": TEXT,
        "older": OLDER,
        "newer": NEWER,
        "other": OTHER,
        "ours": 0,
    },
    "bring back": {
        "missing": NO_BACKUP,
        "folder": FOLDER,
        "empty": f"{IN_BACKUP}it is not a database",
        "text": TEXT,
        "older": None,
        "newer": IN_BACKUP + NEWER.replace("~/", ""),
        "other": IN_BACKUP + OTHER.replace("~/", ""),
        "ours": None,
    },
    "replace": {
        "missing": None,
        "folder": FOLDER,
        "empty": None,
        "text": TEXT,
        "older": None,
        "newer": "~/robot.db.newer.1",
        "other": OTHER,
        "ours": None,
    },
}
MORE_FILES: dict[tuple[str, str], dict[str, int]] = {
    ("migrate", "older"): {"robot.db": NOW, KEPT: BEFORE},
    ("migrate", "empty"): {"robot.db": NOW},
    ("back up", "ours"): {"copy.db": NOW},
    ("bring back", "older"): {"new.db": NOW},
    ("bring back", "ours"): {"new.db": NOW},
    ("replace", "missing"): {"robot.db": NOW},
    ("replace", "empty"): {"robot.db": NOW},
    ("replace", "newer"): {"robot.db": NOW, "robot.db.newer.1": 9999},
    ("replace", "older"): {
        "robot.db": NOW,
        f"robot.db.schema{BEFORE}.1.backup": BEFORE,
    },
}
"""Files that are there afterwards, besides what was there, with their schemas."""
SCHEMAS: dict[str, int | None] = {"older": BEFORE, "newer": 9999, "ours": NOW}


@pytest.fixture
def next_version(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """MsBOT as its next version is: with one migration more."""
    folder = tmp_path_factory.mktemp("next") / "migrations"
    shutil.copytree(str(files("msbot.registry") / "migrations"), folder)
    (folder / "versions" / f"v{NOW:04}_next.py").write_text(NEXT)
    for module in (schema, database_maintenance, registry):
        monkeypatch.setattr(module, "own_migrations", lambda: folder_migrations(folder))


@pytest.fixture
def engines(monkeypatch: pytest.MonkeyPatch) -> list[Engine]:
    """Every engine that maintenance makes."""
    made: list[Engine] = []

    def make(*arguments: object, **options: object) -> Engine:
        made.append(make_engine(*arguments, **options))  # type: ignore[arg-type]  # passed on as they came
        return made[-1]

    monkeypatch.setattr(database_maintenance, "make_engine", make)
    monkeypatch.setattr(database_maintenance, "run_limited", lambda function, _limits, *arguments: function(*arguments))
    return made


def _schema(path: Path) -> int | None:
    try:
        with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as connection:
            return int(connection.execute("SELECT version_num FROM alembic_version").fetchone()[0])
    except sqlite3.Error:
        return NONE


def _open_below(folder: Path) -> list[str]:
    """Files below it that this process has open."""
    found = []
    for number in os.listdir("/proc/self/fd"):
        try:
            target = os.readlink(f"/proc/self/fd/{number}")
        except FileNotFoundError:  # the listing itself
            continue
        found += [target] if target.startswith(str(folder)) else []
    return found


@pytest.mark.parametrize("action", TABLE)
@pytest.mark.parametrize("kind", TABLE["check"])
def test_what_is_answered_and_what_is_left(
    path: Path, empty_database: bytes, next_version: None, engines: list[Engine], kind: str, action: str
) -> None:
    path.write_bytes(empty_database)
    _sql(path, f"CREATE TABLE next (id INTEGER PRIMARY KEY); UPDATE alembic_version SET version_num = '{NOW:04}'")
    ours = path.read_bytes()
    path.unlink()
    _make(kind, path, ours, empty_database)
    content = path.read_bytes() if path.is_file() else b""
    expected = TABLE[action][kind]
    is_refused = isinstance(expected, str) and (action, kind) not in MORE_FILES
    if is_refused:
        with pytest.raises(RegistryError) as caught:
            ACTIONS[action](path, ours)
        answer: object = str(caught.value)
    else:
        answer = ACTIONS[action](path, ours)
    assert (str(answer).replace(str(path.parent), "~") if isinstance(answer, str | Path) else answer) == expected
    files: dict[str, int | None] = {} if kind == "missing" else {path.name: SCHEMAS.get(kind)}
    files |= {"good.db": NOW} if action == "replace" else {}
    files |= MORE_FILES.get((action, kind), {})
    assert {file.name: _schema(file) for file in path.parent.iterdir()} == files
    if is_refused and kind not in ("missing", "folder"):
        assert (path.read_bytes(), path.stat().st_mode & 0o777) == (content, 0o644), "what is refused is left alone"
    for name in set(files) - {path.name, "good.db"}:
        assert (path.parent / name).stat().st_mode & 0o777 == 0o600, name
    assert [engine.pool.status() for engine in engines if engine.pool.checkedin() + engine.pool.checkedout()] == []  # type: ignore[attr-defined]  # a QueuePool
    assert _open_below(path.parent) == []


def test_a_backup_that_fails_halfway_leaves_nothing(
    path: Path, empty_database: bytes, engines: list[Engine], monkeypatch: pytest.MonkeyPatch
) -> None:
    path.write_bytes(empty_database)
    target = path.with_name("copy.db")

    def fail(*_: object) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(database_maintenance, "_copy", fail)
    with pytest.raises(OSError, match="No space left"):
        database_maintenance.back_up(str(path), target)
    assert [file.name for file in path.parent.iterdir()] == [path.name]
    assert _open_below(path.parent) == []
