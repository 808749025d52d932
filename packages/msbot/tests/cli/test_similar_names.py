"""An unknown name is answered with the one that was probably meant."""

from __future__ import annotations

from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from msbot.config import SAMPLES, load_library, parse_blueprint
from msbot.registry import open_registry
from msbot_agent.cli import msbot
from msbot_agent.cli.group import usage_words
from msbot_agent.text.similar_names import instead_of
from msbot_xrce.errors import MsbotError


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setenv("MSBOT_STOP_GROUP", "test-similar-names")
    library = load_library()
    with open_registry("robot.db") as registry:
        registry.robots.apply_blueprint(parse_blueprint(SAMPLES["rover"], library), library)


def said(*words: str) -> str:
    try:
        CliRunner().invoke(msbot, words, catch_exceptions=False, standalone_mode=False)
    except click.UsageError as error:
        return usage_words(error)
    except MsbotError as error:
        return str(error)
    raise AssertionError(f"{words} are no mistake")


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        ("partz", "part"),
        ("library serch", "search"),
        ("parts --jsn", "--json"),
        ("parts --slot fann", "fan"),
        ("set fann", "fan"),
        ("set fan startat", "start_at"),
        ("set fan startat 20", "start_at"),
        ("release knobb", "knob"),
        ("unbind fan_powr", "fan_power"),
        ("parts --robot ROVR", "ROVER"),
        ("set fan --robot R-001", "R-0001"),
        ("library show BUTON", "BUTTON"),
        ("mission check moodz.toml", ""),
        ("arena show mazy", "maze"),
        ("lesson start helo", ""),
    ],
)
def test_a_name_that_there_is_not(words: str, meant: str) -> None:
    told = said(*words.split())
    if meant:
        assert "id you mean" in told
        assert meant in told.partition("id you mean")[2]
    else:
        assert "did you mean" not in told  # nothing is known that is like it


def test_all_are_listed_where_none_is_like_it() -> None:
    assert instead_of("fann", ["knob", "fan", "Fan"]) == "did you mean fan or Fan?"
    assert instead_of("zzz", ["knob", "fan"]) == "there are knob, fan"
    assert instead_of("zzz", []) == "there are none"
