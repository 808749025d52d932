"""Names of recordings that a command writes."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from msbot.cli.record.log import recording_name
from msbot_agent.cli import msbot
from msbot_xrce.errors import ConfigError

REFUSED = (
    r"^odd\.txt: a recording is an MCAP file, and its name ends in \.mcap: odd\.mcap \(tables are made of it by "
    r"`msbot log export`\)$"
)


@pytest.mark.parametrize(
    ("given", "written"), [("odd", "odd.mcap"), ("odd.mcap", "odd.mcap"), ("ODD.MCAP", "ODD.MCAP"), ("a/b", "a/b.mcap")]
)
def test_a_name_without_an_ending_gets_one(given: str, written: str) -> None:
    assert recording_name(Path(given)) == Path(written)


@pytest.mark.parametrize("given", ["", ".", "..", "a"])
def test_a_folder_is_no_name(given: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a").mkdir()
    with pytest.raises(ConfigError, match=r"is a folder: name a file in it, for example .*lesson\.mcap$"):
        recording_name(Path(given))


@pytest.mark.parametrize(
    "words", [("rec", "save", "odd.txt"), ("rec", "start", "odd.txt"), ("log", "filter", "a.mcap", "odd.txt")]
)
def test_the_ending_of_something_else_is_refused_before_anything_is_done(
    words: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigError, match=REFUSED):
        CliRunner().invoke(msbot, words, catch_exceptions=False, standalone_mode=False)
    assert list(tmp_path.iterdir()) == []
