"""`msbot db`: migrate, backup, restore, check."""

import json
import sqlite3
from collections.abc import Callable
from contextlib import closing
from datetime import datetime
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from msbot.cli.db import command
from msbot.config import load_blueprint, load_library, write_sample
from msbot.registry import open_registry
from msbot_xrce.errors import MsbotError, RegistryError
from tests.registry.hand import Hand

Run = Callable[..., Result]


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Call `msbot db` in a folder with the sample robot's database."""
    monkeypatch.chdir(tmp_path)
    write_sample(Path("robot.toml"))
    library = load_library()
    with open_registry("robot.db") as registry:
        registry.robots.apply_blueprint(load_blueprint(Path("robot.toml"), library), library)

    def run(*arguments: str, answer: str = "") -> Result:
        result = CliRunner().invoke(command, arguments, input=answer)
        if isinstance(result.exception, MsbotError):
            raise result.exception
        return result

    return run


def test_an_up_to_date_database_needs_no_migration(run: Run) -> None:
    assert run("migrate").output.startswith("robot.db is up to date: schema ")


def test_a_backup_is_made_and_brought_back(run: Run) -> None:
    assert run("backup", "copy.db").output.startswith("copy.db is written: ")
    with open_registry("robot.db") as registry:
        Hand(registry).keep_user("ann", "viewer", "ann", password_hash="")
    asked = run("restore", "copy.db", answer="n\n")
    assert (asked.exit_code, "Put the content of copy.db in place of all that robot.db has?" in asked.output) == (
        1,
        True,
    )
    assert run("restore", "copy.db", "--yes").output.splitlines() == [
        "robot.db has the content of copy.db.",
        "What it had before is in robot.db.replaced.1.backup.",
    ]
    with open_registry("robot.db") as registry:
        assert registry.users.all() == []


@pytest.mark.parametrize("damage", [b"\0" * 4096, b"SQLite format 3\0" + b"\xff" * 4096])
def test_a_backup_takes_the_place_of_a_damaged_file_which_is_kept(run: Run, damage: bytes) -> None:
    run("backup", "copy.db")
    Path("robot.db").write_bytes(damage)
    assert run("restore", "copy.db", "--yes").output.splitlines() == [
        "robot.db has the content of copy.db.",
        "What it had before is in robot.db.damaged.1.",
    ]
    assert Path("robot.db.damaged.1").read_bytes() == damage
    assert run("check").output == "robot.db is in order.\n"


def test_a_damaged_file_of_a_robot_that_runs_is_left_alone(run: Run) -> None:
    run("backup", "copy.db")
    with open_registry("robot.db") as registry:
        robot = registry.robots.all()[0]
        registry.runs.begin(robot)
        Path("robot.db").write_bytes(b"\0" * 4096)
        with pytest.raises(RegistryError, match=r"running a robot with the database robot\.db: stop it first"):
            run("restore", "copy.db", "--yes")
    assert Path("robot.db").read_bytes() == b"\0" * 4096


def test_a_check_says_what_is_wrong(run: Run) -> None:
    assert run("check").output == "robot.db is in order.\n"
    assert json.loads(run("check", "--json").output) == []
    with closing(sqlite3.connect("robot.db")) as connection:
        connection.execute("DELETE FROM library WHERE number = 'ABCD'")
        connection.commit()
    result = run("check")
    assert (result.exit_code, result.output.splitlines()[-1]) == (1, "robot.db: 1 problem.")
    assert json.loads(run("check", "--json").output) == [
        "robot MSBOT_MASTER: slot AA wants part number ABCD, which is not in the library"
    ]


def test_a_database_that_is_not_there(run: Run) -> None:
    for arguments in (("check",), ("migrate",), ("backup", "x")):
        with pytest.raises(MsbotError, match=r"there is no database other\.db"):
            run(*arguments, "--db", "other.db")
    with pytest.raises(RegistryError, match=r"there is no backup nothing\.db"):
        run("restore", "nothing.db", "--yes")


def test_a_folder_of_backups_keeps_the_newest(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = Path("backups")
    for day in range(1, 6):
        monkeypatch.setattr("msbot.cli.db.datetime", FixedClock(day))
        done = run("backup", "backups", "--keep", "3")
        (folder / "mine-20260101-000000.db").touch()
    names = sorted(path.name for path in folder.iterdir())
    assert names == ["mine-20260101-000000.db", *(f"robot-2026010{day}-120000.db" for day in (3, 4, 5))]
    assert "backups/robot-20260102-120000.db is removed: the newest 3 are kept." in done.output
    assert folder.stat().st_mode & 0o077 == 0
    with open_registry(folder / "robot-20260105-120000.db", read_only=True) as registry:
        assert [robot.name for robot in registry.robots.all()] == ["MSBOT_MASTER"]


class FixedClock:
    """`datetime`, as far as `msbot db backup` uses it: noon of that day in January 2026."""

    def __init__(self, day: int) -> None:
        self.day = day

    def now(self) -> datetime:
        return datetime(2026, 1, self.day, 12)
