"""What a part says in its own terminal: each line of the program, and hints about refusals."""

from __future__ import annotations

import io
import logging

import pytest

from msbot import Message, Part, float32
from msbot.part.description import describe
from msbot.part.join.part_log import BURST
from msbot.part.join.refusal import Refusal, displayed_state, refusal_hint
from msbot_agent.log import TerminalHandler
from msbot_xrce.errors import ConfigError


def test_a_program_may_say_the_same_again_and_again_and_a_flood_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [1000.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    screen = io.StringIO()
    handler = TerminalHandler(stream=screen)
    logger = logging.getLogger("msbot.part")
    logger.addHandler(handler)
    level = logger.level
    logger.setLevel(logging.INFO)
    try:
        part = Part("LOUD")
        for _ in range(30):
            part.log("mean 3.0")
            now[0] += 5.0
        assert screen.getvalue().count("part: mean 3.0") == 30
        for _ in range(500):
            part.log("mean 4.0")
        assert BURST <= screen.getvalue().count("part: mean 4.0") < 50
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)
        handler.close()


def test_a_refusal_says_what_helps_at_the_part() -> None:
    assert "--uid" in refusal_hint(Refusal.DUPLICATE.describe, "me")
    assert "`msbot why me`" in refusal_hint(Refusal.NO_SLOT.describe, "me")
    assert "describes=" in refusal_hint(Refusal.UNKNOWN_PART.describe, "me")
    assert refusal_hint(Refusal.UNKNOWN_PART.describe, "me", describes=True) == ""
    assert refusal_hint(Refusal.BLOCKED.describe, "me") == ""
    assert displayed_state("refused", Refusal.NO_SLOT.describe) == "standby"


def test_a_list_that_cannot_be_described_is_named_with_its_line() -> None:
    class Way(Message):
        steps: list[float32]

    part = Part("WAY-1", describes=True)
    part.publishes("way", Way)
    with pytest.raises(ConfigError, match=r"^test_own_lines\.py:\d+: Way\.steps is list\[float32\], which a part"):
        describe("WAY-1", "WAY-1", part.program)
