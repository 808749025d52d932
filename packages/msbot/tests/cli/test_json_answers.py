"""`--json` of commands that change a robot or look at it: nothing else on standard output; and which robot is meant."""

from __future__ import annotations

import json
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from msbot.config import SAMPLES, load_library, parse_blueprint
from msbot.registry import open_registry
from msbot_agent.cli import msbot
from msbot_xrce.errors import ConfigError


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
    with pytest.raises(ConfigError, match="has several robots: say which with --robot"):
        ask("set", "fan", "--json")


@pytest.mark.parametrize(
    ("command", "file", "text", "key"),
    [
        (("library", "check"), "lux.toml", 'number = "LUX"\n', "name"),
        (
            ("mission", "check"),
            "moods.toml",
            '[mission]\nstory = "Why?"\n[[fault]]\nkind = "unplug"\nat = ["fan"]\n',
            "mission.title",
        ),
        (("arena", "check"), "hall.toml", '[world]\nname = "Hall"\nwidth_m = 4\n', "robot"),
        (("check",), "robot.toml", '[robot]\nname = "Rex"\n', "slot"),
        (("lesson", "check"), "bits.md", "+++\n[lesson]\nnumber = 1\n+++\n# Bits\n", "title"),
    ],
)
def test_mistakes_in_a_file_that_is_checked_are_told_as_json(
    command: tuple[str, ...], file: str, text: str, key: str
) -> None:
    Path(file).write_text(text)
    done = CliRunner().invoke(msbot, [*command, file, "--json"])
    assert done.exit_code == 2, done.output
    problems = json.loads(done.stdout)["problems"]
    assert key in [problem["key"] for problem in problems]
    assert all(problem["file"] == file and problem["words"] for problem in problems)
    in_words = CliRunner().invoke(msbot, [*command, file])
    assert isinstance(in_words.exception, ConfigError)
    assert problems[0]["words"].splitlines()[0] in str(in_words.exception)


def test_files_that_are_right_have_no_problems() -> None:
    Path("moods.toml").write_text(
        '[mission]\ntitle = "Moods"\nstory = "Why?"\n[[fault]]\nkind = "unplug"\nat = ["fan"]\n'
    )
    assert ask("library", "check", "--json") == {"problems": [], "hints": []}
    found = as_dict(ask("mission", "check", "moods.toml", "--json"))
    assert (found["problems"], found["title"], found["slots"]) == ([], "Moods", ["fan"])


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
