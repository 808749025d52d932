"""`msbot user`: people and class lists; what is wrong is told before anybody is added."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from msbot.config import load_library, parse_blueprint
from msbot.config.blueprint.samples import SAMPLE_ROBOT_TOML
from msbot.registry import open_registry
from msbot_web.access.passwords import Argon2Hasher
from msbot_web.cli.user_commands import user_command

PASSWORD = "correct horse"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    library = load_library()
    with open_registry("robot.db") as registry:
        registry.robots.apply_blueprint(parse_blueprint(SAMPLE_ROBOT_TOML, library), library)
    assert ask("add", "ann", "--role", "administrator", "--password-stdin", typed=PASSWORD).exit_code == 0
    return tmp_path


def ask(*arguments: str, typed: str = "") -> Result:
    return CliRunner().invoke(user_command, arguments, input=f"{typed}\n")


def people() -> dict[str, str]:
    return {one["name"]: one["role"] for one in json.loads(ask("list", "--json").output)}


async def test_a_person_is_added_and_can_sign_in() -> None:
    with open_registry("robot.db", read_only=True) as registry:
        (stored,) = registry.users.all()
        assert await Argon2Hasher().matches(stored.password_hash, PASSWORD, asker="")
        (change,) = [edit for edit in registry.edits.latest(None) if edit.kind == "user"]
    assert "user ann added as administrator" in change.words


def test_roles_passwords_and_removal() -> None:
    assert "bob may sign in as a student; the password is " in ask("add", "bob", "--generate").output
    assert ask("role", "bob", "teacher").output == "bob is a teacher now\n"
    assert "bob has another password: " in ask("passwd", "bob", "--generate").output
    assert people() == {"ann": "administrator", "bob": "teacher"}
    assert "bob   teacher" in ask("list").output
    assert ask("remove", "bob").output == "bob can no longer sign in\n"
    assert people() == {"ann": "administrator"}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("role", "ann", "viewer"), "last administrator"),
        (("remove", "ann"), "last administrator"),
        (("remove", "eve"), "there is no user 'eve'; there are ann"),
        (("add", "ann", "--generate"), "there is a user 'ann' already"),
        (("add", "bob"), "nobody is there to type a password"),
    ],
)
def test_what_makes_no_sense_is_told(arguments: tuple[str, ...], words: str) -> None:
    assert words in str(ask(*arguments).exception)


def test_a_class_list_of_a_spreadsheet(folder: Path) -> None:
    (folder / "class.csv").write_bytes("\ufeffName;Role;Password\nMüller, Jo;;\nLi;teacher;long enough\n\n".encode())
    done = ask("add", "--list", "class.csv", "--tickets", "tickets.csv")
    assert done.exit_code == 0, done.exception
    assert "2 people may sign in; their passwords are in tickets.csv" in done.output
    assert people() == {"ann": "administrator", "Müller, Jo": "student", "Li": "teacher"}
    tickets = folder / "tickets.csv"
    assert tickets.stat().st_mode & 0o077 == 0
    rows = list(csv.reader(tickets.read_text("utf-8").splitlines()))
    assert [row[:2] for row in rows] == [["name", "role"], ["Müller, Jo", "student"], ["Li", "teacher"]]
    assert rows[2][2] == "long enough"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "nobody is in it"),
        ("bob\nbob\n", "class.csv, line 2: 'bob' is there already on line 1"),
        ("bob\nann\n", "class.csv, line 2: 'ann' may sign in already; nobody was added"),
        ("bob,student,short\n", "class.csv, line 1: "),
        ("bob,king,\n", "there is no role 'king'"),
        ("name,role\n,student\n", "line 2: the name is missing"),
        ('"bob\n', "is not a list of people"),
        ("x" * 300_000, "is larger than 256,000 bytes"),
    ],
)
def test_a_class_list_that_is_wrong_adds_nobody(folder: Path, text: str, words: str) -> None:
    (folder / "class.csv").write_text(text)
    assert words in str(ask("add", "--list", "class.csv").exception)
    assert people() == {"ann": "administrator"}
