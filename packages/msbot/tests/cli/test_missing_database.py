"""A database that is not there, or has no robot: a misspelt name makes none, and one sentence says what is right."""

from __future__ import annotations

from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from msbot.config import write_sample
from msbot.registry import open_registry
from msbot_agent.cli import msbot
from msbot_xrce.errors import ConfigError, MsbotError
from tests.cli.test_command_tree import leaves

MAKES = {"demo", "master", "apply", "db restore", "service install"}
"""What is meant to make a database, or to have one made."""
LOOKS = {"diff", "class stop", "class undo"}
"""What does its work without a database, too: they make none."""

WORDS = {
    "arena put": "Rex 1 1", "arena speed": "2", "library forget": "LUX-1", "key board": "front", "key new": "ABCD",
    "key remove": "AA", "why": "AA", "parts forget": "AA --yes", "swap": "AA --to BB",
    "release": "AA", "block": "AA", "unblock": "AA",
    "set": "AA gain 1", "publish": "AA.out 1", "bind": "topic --type HelloWorld", "unbind": "topic", "identify": "AA",
    "simulate": "AA", "slot add": "claw ABCD", "slot remove": "AA", "class apply": "robot.toml --yes",
    "user add": "ann --generate", "user passwd": "ann --generate", "user remove": "ann", "user revoke": "ann page",
    "user role": "ann teacher", "user ticket": "ann van", "user token": "ann page", "pupils group": "red --slot AA",
    "pupils hand-back": "ann", "pupils take-over": "ann", "pupils ungroup": "red", "db backup": "copy.db",
    "topic bw": "t", "topic echo": "t", "topic hz": "t", "topic info": "t", "topic pub": "t HelloWorld 1",
    "rec save": "odd", "rec start": "odd", "play": "odd.mcap --acts", "fault add": "noise", "mission answer": "noise",
    "mission repair": "tighten", "mission start": "a-bad-day", "lesson start": "hello", "call": "AA.echo 1",
    "spare": "AA ABCD",
}  # fmt: skip
"""What a command needs besides."""

NAMES = sorted(
    name
    for name, options in leaves(msbot, click.Context(msbot))
    if "--db" in options and name not in {*MAKES, *LOOKS, "play"}
)
"""`play --acts` reads its recording first; nothing but a running master would do for it."""


@pytest.fixture(autouse=True)
def _own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "run").mkdir()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "run"))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setenv("MSBOT_STOP_GROUP", "test-missing-database")
    monkeypatch.chdir(tmp_path)
    write_sample(tmp_path / "robot.toml")


def said(*words: str) -> str:
    """What a command says is wrong, or prints."""
    try:
        done = CliRunner().invoke(msbot, list(words), catch_exceptions=False, standalone_mode=False)
    except (MsbotError, click.ClickException) as error:
        return str(error)
    return done.output


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("database", ["misspelt.db", "sqlite:///misspelt.db"])
def test_a_misspelt_database_is_told_and_not_made(name: str, database: str, tmp_path: Path) -> None:
    words = said(*name.split(), *WORDS.get(name, "").split(), "--db", database)
    if name == "stop" or name == "go":
        assert "no master of this robot runs here" in words
    elif name == "log follow" or name.startswith("topic "):  # what they show, only a running master has
        assert "no master runs here: `msbot master robot.toml`" in words
    else:
        assert f"there is no database {database}: `msbot master robot.toml` or `msbot apply robot.toml` makes" in words
    assert not (tmp_path / "misspelt.db").exists()
    assert [path.name for path in tmp_path.glob("*.db*")] == []


@pytest.mark.parametrize("name", sorted(LOOKS))
def test_what_needs_no_database_makes_none(name: str, tmp_path: Path) -> None:
    said(*name.split(), "--db", "misspelt.db")
    assert [path.name for path in tmp_path.glob("*.db*")] == []


def test_a_new_slot_makes_a_database_beside_its_blueprint_only(tmp_path: Path) -> None:
    before = (tmp_path / "robot.toml").read_bytes()
    with pytest.raises(ConfigError, match=r"^there is no database misspelt\.db"):
        CliRunner().invoke(
            msbot, ["slot", "add", "claw", "ABCD", "--db", "misspelt.db"], catch_exceptions=False, standalone_mode=False
        )
    assert (tmp_path / "robot.toml").read_bytes() == before
    assert "claw is now in robot.toml; robot MSBOT_MASTER is in the database now" in said("slot", "add", "claw", "ABCD")
    assert (tmp_path / "robot.db").exists()


@pytest.mark.parametrize("words", ["release AA", "undo", "export", "set AA", "fault list", "mission status"])
def test_a_database_without_a_robot_says_what_would_make_one(words: str) -> None:
    open_registry("robot.db").close()
    assert said(*words.split()) == (
        "there is no robot in the database robot.db yet: `msbot apply robot.toml` or `msbot master robot.toml` puts "
        "one there"
    )


def test_the_doctor_says_so_too() -> None:
    open_registry("robot.db").close()
    told = said("doctor", "--only", "robot")
    assert "there is no robot in the database yet: `msbot apply robot.toml` or `msbot master robot.toml` puts" in told
