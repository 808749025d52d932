"""Where a client's session stands; `client_session.py` draws how the states follow each other."""

from __future__ import annotations

from enum import Enum


class ClientState(Enum):
    """Where a client's session stands."""

    IDLE = "not connected yet"
    CONNECTING = "waiting for the agent's answer to the login"
    CONNECTED = "open"
    CLOSING = "waiting for the agent's answer to the logout"
    CLOSED = "closed"
    FAILED = "the agent refused, or did not answer"


OPEN_STATES = (ClientState.CONNECTED, ClientState.CLOSING)
"""States in which the agent has a session for the client."""
