"""The defaults are those of the genuine peers."""

from __future__ import annotations

from msbot_xrce.streams.settings import AgentSessionSettings, ClientSessionSettings


def test_the_agent_waits_200_ms_with_16_messages_on_the_way() -> None:
    settings = AgentSessionSettings()
    assert (settings.window, settings.heartbeat_s, settings.max_message) == (16, 0.2, 1 << 20)


def test_the_client_waits_100_ms_and_logs_in_10_times_a_second_apart() -> None:
    settings = ClientSessionSettings()
    assert (settings.window, settings.heartbeat_s) == (16, 0.1)
    assert (settings.login_period_s, settings.login_tries, settings.pads) == (1.0, 10, True)
