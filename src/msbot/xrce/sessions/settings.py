"""Windows, periods and limits of sessions; the defaults are what the genuine agent and client do."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class SessionSettings:
    """What both ends of a session can be told."""

    window: int = 16
    """Unacknowledged messages on each reliable stream, both ways; an ACKNACK reports on 16."""
    heartbeat_s: float = 0.2
    """Silence in seconds after which a HEARTBEAT asks for what is unacknowledged."""
    heartbeat_min_s: float = 0.005
    """The same on a link that loses messages, where the measured round trip allows it; not below `heartbeat_s` = never
    sooner than that. The wait doubles with every question that stays without an answer."""
    max_message: int = 1 << 20
    """Bytes held for early messages and pieces of large ones; so also the largest message that is accepted."""
    queue_limit: int = 256
    """Best-effort messages of one stream that may wait for the link; beyond, the oldest is dropped and counted."""
    backlog: int = 64
    """Statuses (agent) or requests (client) that may wait for a full window, in messages; beyond, they are refused."""
    max_streams: int = 16
    """Streams of each kind and direction."""


@dataclass(frozen=True, slots=True)
class AgentSessionSettings(SessionSettings):
    """What an agent's session can be told."""


@dataclass(frozen=True, slots=True)
class ClientSessionSettings(SessionSettings):
    """What a client's session can be told."""

    heartbeat_s: float = 0.1
    """Silence in seconds after which a HEARTBEAT asks for what is unacknowledged."""
    login_period_s: float = 1.0
    """Between two tries of a login or of the deletion of the session."""
    login_tries: int | None = 10
    """How often they are tried; None = without end."""
    login_properties: tuple[tuple[str, str], ...] | None = None
    """What the login says besides; an agent passes over what it does not know."""
    pads: bool = True
    """Whether messages of streams are filled up to a multiple of 4, as C clients do; agents do not need it."""
    ids_by_rule: bool = False
    """Request ids of WRITE_DATA and READ_DATA follow from other fields, and each WRITE_DATA has a message of its own:
    shortest with header compression. Off: they are counted and packed, as C clients do."""
