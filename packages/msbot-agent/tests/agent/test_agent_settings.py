"""The agent's settings refuse what cannot work."""

from __future__ import annotations

from typing import Any

import pytest

from msbot_agent.agent.agent_settings import AgentSettings
from msbot_xrce.errors import ConfigError


def test_defaults_are_those_of_the_genuine_agent() -> None:
    settings = AgentSettings()
    assert (settings.heartbeat_s, settings.window, settings.dead_after_s) == (0.2, 16, 30.0)


@pytest.mark.parametrize(
    "wrong", [{"max_clients": 0}, {"heartbeat_s": -1.0}, {"domain_255": -1}, {"window": 17}, {"window": 0}]
)
def test_a_wrong_setting_is_named_with_its_value(wrong: dict[str, Any]) -> None:
    (name, value), *_ = wrong.items()
    with pytest.raises(ConfigError, match=f"{name} is {value}"):
        AgentSettings(**wrong)


def test_domain_0_is_a_domain() -> None:
    assert AgentSettings(domain_255=0).domain_255 == 0
