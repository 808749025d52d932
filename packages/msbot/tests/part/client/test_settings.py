"""The defaults that other rooms and the documentation rely on."""

from dataclasses import FrozenInstanceError

import pytest

from msbot.part.client.client_settings import ClientSettings, ConnectionState
from msbot_agent.link import LinkInfo


def test_a_lost_agent_is_noticed_and_found_again_quickly_enough_for_plug_and_play() -> None:
    settings = ClientSettings()
    assert settings.pings * settings.ping_s <= 1.0
    assert settings.login_period_s == 0.5
    assert settings.session_id == 0x81


def test_where_many_share_a_slow_medium_there_is_more_patience() -> None:
    fast = ClientSettings.for_link(LinkInfo("udp:h:1", 65507))
    shared = ClientSettings.for_link(LinkInfo("sim:125000", 4096, 125_000, shared_bus=True))
    assert fast == ClientSettings()
    assert shared.ping_s > fast.ping_s
    assert shared.stall_s > fast.stall_s


def test_settings_are_for_keeps() -> None:
    with pytest.raises(FrozenInstanceError):
        ClientSettings().mtu = 1  # type: ignore[misc]  # that is the point


def test_states_are_words() -> None:
    assert [state.value for state in ConnectionState] == ["connecting", "connected", "lost", "closed"]
