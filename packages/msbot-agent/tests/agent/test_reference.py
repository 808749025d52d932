"""docs/reference/agent.md says what there is."""

from __future__ import annotations

import re
from dataclasses import fields

from msbot_agent.agent import AgentSettings
from tests import ROOT

PAGE = (ROOT / "docs/reference/agent.md").read_text()
SOURCES = sorted((ROOT / "packages/msbot-agent/src/msbot_agent/agent").glob("*.py"))


def test_every_setting_is_listed_with_its_default() -> None:
    table = dict(re.findall(r"^\* `(\w+)` \(([\d.,]+|no|yes)\): ", PAGE, re.MULTILINE))
    assert {
        name: float(text.replace(",", "").replace("no", "0").replace("yes", "1")) for name, text in table.items()
    } == {item.name: float(getattr(AgentSettings(), item.name)) for item in fields(AgentSettings)}


def test_every_reason_for_dropping_is_explained() -> None:
    reasons = {
        reason for source in SOURCES for reason in re.findall(r'dropped\.count\(f?"([^"{]+)', source.read_text())
    }
    assert len(reasons) >= 8
    assert [reason for reason in reasons if reason.strip() not in PAGE] == []
