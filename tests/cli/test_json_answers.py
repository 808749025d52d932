"""`--json` of commands that change a robot or look at it: nothing else on standard output; and which robot is meant."""

from __future__ import annotations

import json
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from msbot.cli import msbot
from msbot.config import SAMPLES, load_library, parse_blueprint
from msbot.errors import ConfigError
from msbot.registry import open_registry


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    library = load_library()
    with open_registry("robot.db") as registry:
        registry.robots.apply_blueprint(parse_blueprint(SAMPLES["rover"], library), library)


def ask(*arguments: str) -> object:
    done = CliRunner().invoke(msbot, arguments)
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout)


def test_changes_tell_their_words_and_number() -> None:
    answer = ask("set", "fan", "start_at", "30", "--json")
    assert isinstance(answer, dict)
    assert set(answer) == {"words", "edit"}
    (edit,) = [one for one in as_list(ask("undo", "--list", "--json")) if one["id"] == answer["edit"]]
    assert edit["slot"] == "fan"
    (value,) = as_list(ask("set", "fan", "start_at", "--json"))
    assert (value["value"], value["origin"]) == (30, "hand")
    assert set(as_dict(ask("undo", "--json"))) == {"words", "edit"}


def test_where_a_database_has_several_robots_one_is_named_or_all_are_told_apart() -> None:
    library = load_library()
    with open_registry("robot.db") as registry:
        registry.robots.apply_blueprint(parse_blueprint(SAMPLES["thesis"], library), library)
    assert ask("parts", "--json") == []
    assert ask("parts", "--robot", "ROVER", "--json") == []
    assert len(as_list(ask("robots", "--json"))) == 2
    with pytest.raises(ConfigError, match="has no robot 'Rex'; there are"):
        ask("parts", "--robot", "Rex", "--json")
    with pytest.raises(ConfigError, match="say which one is meant with --robot"):
        ask("set", "fan", "--json")


def test_a_library_file_that_is_wrong_is_told_as_json(tmp_path: Path) -> None:
    (tmp_path / "lux.toml").write_text('number = "LUX"\n')
    done = CliRunner().invoke(msbot, ["library", "check", "lux.toml", "--json"])
    assert done.exit_code == 2
    (problem,) = json.loads(done.stdout)["problems"]
    assert (problem["file"], problem["key"]) == ("lux.toml", "name")
    assert ask("library", "check", "--json") == {"problems": [], "hints": []}


def test_the_options_are_click_s_own() -> None:
    context = click.Context(msbot)
    for name in ("set", "swap", "why", "parts"):
        command = msbot.get_command(context, name)
        assert command is not None
        assert {"--json", "--robot", "--db"} <= {option for one in command.params for option in one.opts}


def as_list(found: object) -> list[dict[str, object]]:
    assert isinstance(found, list)
    return found


def as_dict(found: object) -> dict[str, object]:
    assert isinstance(found, dict)
    return found
