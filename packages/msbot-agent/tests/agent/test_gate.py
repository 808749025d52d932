"""The gate of an agent without a blueprint."""

from __future__ import annotations

from msbot_agent.agent import ClientInfo, Gate, OpenGate


def test_the_open_gate_lets_everybody_do_everything() -> None:
    gate: Gate = OpenGate()
    client = ClientInfo(1, "udp:", ("127.0.0.1", 1), "127.0.0.1:1")
    gate.joined(client)
    gate.session_ended(client, "session deleted")
    assert gate.may_join(client)
    assert gate.may_write(client, "light")
    assert gate.may_read(client, "light")
