"""docs/reference/xrce.md says what the code says."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import pytest

from msbot.xrce import (
    Status,
    SubmessageId,
    agent_session,
    client_session,
    fragments,
    input_streams,
    output_streams,
    sender,
    session,
)

PAGE = (Path(__file__).parent.parent.parent / "docs/reference/xrce.md").read_text()


@pytest.mark.parametrize("member", [*SubmessageId, *Status], ids=str)
def test_numbers_and_names(member: SubmessageId | Status) -> None:
    assert f"| 0x{member.value:02X} | {member.name} |" in PAGE


@pytest.mark.parametrize(
    "module", [session, agent_session, client_session, sender, output_streams, input_streams, fragments]
)
def test_every_reason_for_dropping_is_explained(module: ModuleType) -> None:
    reasons = [value for name, value in vars(module).items() if name.isupper() and isinstance(value, str)]
    assert reasons
    for reason in reasons:
        assert reason in PAGE


def test_every_file_is_in_the_table() -> None:
    table = PAGE.partition("## Files")[2]
    for name in ("cdr", "messages", "objects", "xml", "references", "explain", "session", "output_streams"):
        assert f"`{name}.py`" in table
