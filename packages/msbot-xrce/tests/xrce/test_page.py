"""docs/reference/xrce.md says what the code says."""

from __future__ import annotations

from types import ModuleType

import pytest

from msbot_xrce import Status
from msbot_xrce.messages import SubmessageId
from msbot_xrce.sessions import agent as agent_session
from msbot_xrce.sessions import client as client_session
from msbot_xrce.sessions import session
from msbot_xrce.streams import receiving_in_order as fragments
from msbot_xrce.streams import receiving_in_order as input_streams
from msbot_xrce.streams import sending_and_resending as output_streams
from msbot_xrce.streams import session_output
from tests import ROOT

PAGE = (ROOT / "docs/reference/xrce.md").read_text()


@pytest.mark.parametrize("member", [*SubmessageId, *Status], ids=str)
def test_numbers_and_names(member: SubmessageId | Status) -> None:
    assert f"| 0x{member.value:02X} | {member.name} |" in PAGE


@pytest.mark.parametrize(
    "module", [session, agent_session, client_session, session_output, output_streams, input_streams, fragments]
)
def test_every_reason_for_dropping_is_explained(module: ModuleType) -> None:
    reasons = [value for name, value in vars(module).items() if name.isupper() and isinstance(value, str)]
    assert reasons
    for reason in reasons:
        assert reason in PAGE
