"""Windows, periods and limits of sessions; the defaults are those of the genuine agent and client."""

from __future__ import annotations

from msbot_xrce.common.lazy_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class SessionSettings:
    """The settings that both ends of a session have."""

    window: int = 16
    """Unacknowledged messages on each reliable stream, in each direction; an ACKNACK covers 16."""
    heartbeat_s: float = 0.2
    """Silence in seconds after which a HEARTBEAT asks for what is unacknowledged."""
    heartbeat_min_s: float = 0.001
    """The shortest such silence on a link that loses messages, where the wait follows the measured round trip; a value
    from `heartbeat_s` up turns this off. The wait doubles with every HEARTBEAT that goes unanswered."""
    max_message: int = 1 << 20
    """Bytes held for early messages and pieces of large ones; this also limits the largest message accepted."""
    queue_limit: int = 256
    """Best-effort messages of one stream that may wait for the link; beyond, the oldest is dropped and counted."""
    backlog: int = 64
    """Statuses (agent) or requests (client) that may wait for a full window, in messages; beyond, they are refused."""
    max_streams: int = 16
    """Streams of each kind and direction."""
    packs: bool = False
    """Whether a submessage joins the message before it while that waits for the link, up to the MTU. A client packs by
    itself (`SessionOutput.pack`)."""
    peer_is_stock: bool = False
    """Whether the peer reads as stock C clients do, which bounds what may share a message with what; see
    `msbot_xrce.streams.sharing_messages`."""
    may_reorder: bool = False
    """Whether packets may overtake each other on the way; a stock client is then spared what would harm it."""


@dataclass(frozen=True, slots=True)
class AgentSessionSettings(SessionSettings):
    """The settings of an agent's session."""

    peer_is_stock: bool = True


@dataclass(frozen=True, slots=True)
class ClientSessionSettings(SessionSettings):
    """The settings of a client's session."""

    heartbeat_s: float = 0.1
    """Silence in seconds after which a HEARTBEAT asks for what is unacknowledged."""
    login_period_s: float = 1.0
    """Seconds between two tries of a login or of the deletion of the session."""
    login_tries: int | None = 10
    """How often each is tried; None = for ever."""
    login_properties: tuple[tuple[str, str], ...] | None = None
    """Further properties in the login; an agent ignores those it does not know."""
    pads: bool = True
    """Whether messages of streams are padded to a multiple of 4, as by C clients; agents do not need it."""
    ids_by_rule: bool = False
    """Whether request ids of WRITE_DATA and READ_DATA follow from other fields, and each WRITE_DATA has a message of
    its own: the shortest with header compression. If not, requests are numbered and packed, as by C clients."""
