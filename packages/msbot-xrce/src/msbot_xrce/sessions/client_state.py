"""The states of a client's session; the docstring of `client.py` draws the transitions."""

from __future__ import annotations

from enum import Enum


class ClientState(Enum):
    """The state of a client's session."""

    IDLE = "not connected yet"
    CONNECTING = "waiting for the agent's answer to the login"
    CONNECTED = "open"
    CLOSING = "waiting for the agent's answer to the logout"
    CLOSED = "closed"
    FAILED = "the agent refused, or did not answer"


OPEN_STATES = (ClientState.CONNECTED, ClientState.CLOSING)
"""States in which the agent has a session for the client."""
