"""`msbot parts`: which parts are listed, and which database is looked into when none is named."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from msbot.cli.change.change_commands import undo_command
from msbot.cli.database_commands import parts_command, why_command
from msbot.config import load_blueprint, load_library, write_sample
from msbot.registry import open_registry
from msbot_xrce.errors import ConfigError
from tests.cli.look.test_why import Counter
from tests.operations.stage import put_database

GONE = b"WXYZ-two"


@pytest.fixture(autouse=True)
def _robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A robot that nobody runs: two parts that belong in slots, two that do not."""
    (tmp_path / "run").mkdir()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "run"))
    monkeypatch.chdir(tmp_path)
    write_sample(Path("r.toml"))
    library = load_library()
    put_database(tmp_path / "r.db")
    with open_registry("r.db") as registry:
        robot = registry.robots.apply_blueprint(load_blueprint(Path("r.toml"), library), library)
        counter = Counter(registry, robot)
        counter.claim("ABCD", uid=b"ABCD-one", name="AA")
        counter.claim("WXYZ", uid=b"WXYZ-one", name="CC")
        counter.claim("NOPE", uid=b"NOPE-one", name="stranger")
        counter.claim("WXYZ", uid=GONE, name="old")
    with open_registry("r.db") as registry:
        assert len(registry.robots.parts()) == 4


def listed(*words: str) -> list[str]:
    done = CliRunner().invoke(parts_command, [*words, "--json"], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return [part["name"] for part in json.loads(done.stdout)]


def said(*words: str) -> str:
    return CliRunner().invoke(parts_command, list(words), catch_exceptions=False).output


def test_parts_that_are_gone_and_belong_nowhere_are_listed_when_they_are_asked_for() -> None:
    assert listed() == ["AA", "CC"]
    assert sorted(listed("--all")) == sorted(listed("-a")) == ["AA", "CC", "old", "stranger"]
    assert "2 parts are gone and belong to no slot: `msbot parts --all` lists them too." in said()
    assert "lists them too" not in said("--all")


def test_parts_are_chosen_by_slot_state_and_number() -> None:
    assert listed("--slot", "aa") == ["AA"]
    assert listed("--slot", "AA", "--slot", "CC") == ["AA", "CC"]
    assert sorted(listed("--number", "wxyz")) == ["CC", "old"]
    assert listed("--number", "WXYZ", "--slot", "CC") == ["CC"]
    assert sorted(listed("--state", "lost")) == ["AA", "CC", "old", "stranger"]
    assert listed("--state", "active") == []
    assert "No such part has been seen." in said("--state", "active")
    with pytest.raises(ConfigError, match="there is no slot 'ZZ'; there are AA, BB, CC"):
        said("--slot", "ZZ")
    assert "'gone' is not one of" in said("--state", "gone")


def test_the_one_blueprint_here_that_has_a_database_says_which(tmp_path: Path) -> None:
    done = CliRunner().invoke(why_command, ["AA"], catch_exceptions=False)
    assert done.exit_code == 0
    assert "AA" in done.stdout
    (tmp_path / "notes.toml").write_text("")  # no blueprint, no database
    assert listed() == ["AA", "CC"]
    (tmp_path / "s.toml").write_text("")
    (tmp_path / "s.db").write_text("")
    with pytest.raises(ConfigError, match=r"there is no database robot.db; name the one that is meant: --db r.db or"):
        listed()
    (tmp_path / "s.db").unlink()
    (tmp_path / "robot.toml").write_text("")  # another robot is meant, which has none yet
    with pytest.raises(ConfigError, match=r"there is no database robot.db; name the one that is meant: --db r.db$"):
        CliRunner().invoke(why_command, ["AA"], catch_exceptions=False)


def test_a_part_is_forgotten_when_that_is_confirmed() -> None:
    declined = CliRunner().invoke(parts_command, ["forget", "old"], input="n\n")
    assert (declined.exit_code, "Forget old, and which slot it had? [y/N]" in declined.stderr) == (1, True)
    assert "old" in listed("--all")
    answer = json.loads(said("forget", "old", "--yes", "--json"))
    assert answer["words"] == "old (WXYZ) is forgotten"
    assert "old" not in listed("--all")
    done = CliRunner().invoke(undo_command, [str(answer["edit"])], catch_exceptions=False)
    assert done.output == f"change {answer['edit']} undone: old (WXYZ) is forgotten\n"
    assert "old" in listed("--all")
    with pytest.raises(ConfigError, match="no part is known as 'olt'; did you mean old"):
        said("forget", "olt", "--yes")
    assert "write options behind `forget`" in said("--all", "forget", "old")
