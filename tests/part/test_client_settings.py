"""The defaults that other rooms and the documentation rely on."""

from dataclasses import FrozenInstanceError

import pytest

from msbot.part.client_settings import ClientSettings, ConnectionState


def test_a_lost_agent_is_noticed_and_found_again_quickly_enough_for_plug_and_play() -> None:
    settings = ClientSettings()
    assert settings.pings * settings.ping_s <= 1.0
    assert settings.login_period_s == 0.5
    assert settings.session_id == 0x81


def test_settings_are_for_keeps() -> None:
    with pytest.raises(FrozenInstanceError):
        ClientSettings().mtu = 1  # type: ignore[misc]  # that is the point


def test_states_are_words() -> None:
    assert [state.value for state in ConnectionState] == ["connecting", "connected", "lost", "closed"]
