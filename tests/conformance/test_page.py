"""docs/reference/xrce.md names the recordings and packets that ours answers otherwise: all of them, and no others."""

from __future__ import annotations

import re
from pathlib import Path

from tests.agent.test_replay import OTHERWISE
from tests.conformance.test_answers import DIFFERENT

PAGE = (Path(__file__).parent.parent.parent / "docs/reference/xrce.md").read_text()


def rows(heading: str) -> dict[str, str]:
    """The table of two columns below those words."""
    table = PAGE.partition(heading)[2].partition("|---|---|\n")[2].partition("\n\n")[0]
    return dict(re.fullmatch(r"\| `?(.+?)`? \| (.+) \|", line).groups() for line in table.splitlines())  # type: ignore[union-attr, misc]


def test_recordings_that_are_answered_otherwise_are_listed_with_the_reason() -> None:
    assert rows("Recorded dialogues (") == OTHERWISE


def test_hand_made_packets_that_are_answered_otherwise_are_listed_with_the_reason() -> None:
    assert rows("Hand-made packets (") == DIFFERENT
