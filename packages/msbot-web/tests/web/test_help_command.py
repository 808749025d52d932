"""`msbot help`: pages of the handbook, help of commands, and what to read instead."""

from __future__ import annotations

import pytest
from click.testing import CliRunner

from msbot_agent.cli import msbot
from msbot_web.handbook import chapters
from msbot_xrce.errors import ConfigError


def said(*words: str) -> str:
    done = CliRunner().invoke(msbot, ["help", *words])
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    return done.stdout


def test_every_page_is_listed_and_can_be_read() -> None:
    listed = [line.split()[0] for line in said().splitlines()[1:]]
    assert {"topics_and_logs", "swap_a_part", "commands"} <= set(listed)
    for chapter in chapters():
        for name, title in chapter.pages:
            text = said(name)
            assert title.split()[-1] in text.partition("\n")[0].replace("`", "")
            assert [line for line in text.splitlines() if ".md)" in line and not line.startswith("    ")] == []


def test_a_page_is_found_by_its_name_in_any_writing() -> None:
    page = said("swap_a_part")
    assert page.startswith("# Swap a part\n")
    assert "    msbot undo" in page
    assert said("howto/swap_a_part") == said("swap-a-part") == said("Swap", "a", "part") == page


def test_a_command_has_its_help_and_the_pages_that_speak_of_it() -> None:
    shown = said("topic", "pub")
    assert shown.startswith("Usage: msbot topic pub [OPTIONS] TOPIC [TYPE] VALUE...")
    assert "In the handbook: `msbot help topics_and_logs`" in shown


def test_what_there_is_not_is_told_with_what_is_near() -> None:
    with pytest.raises(ConfigError, match=r"no page 'swap_a_prt'; did you mean swap_a_part"):
        said("swap_a_prt")
    assert "These pages speak of heartbeat:" in said("heartbeat")
    with pytest.raises(ConfigError, match="does not speak of 'zzzqq'; `msbot help` lists its pages"):
        said("zzzqq")
