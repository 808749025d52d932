"""Windows, periods and limits of sessions; the defaults are those of the genuine agent and client."""

from __future__ import annotations

from dataclasses import field

from msbot_xrce.counting import Tally
from msbot_xrce.lazy import dataclass

SPARSE_EVERY = 4
"""With sparse ACKNACKs (`SessionSettings.sparse_acknacks`), each message whose successor's number is a multiple of this
is acknowledged at once; a quarter of the usual window."""
SPARSE_QUIET_S = 0.45
"""Likewise every message that comes so long after the last ACKNACK: those of slow streams."""
SPARSE_HEARTBEAT_S = 0.5
"""Shortest silence after which a HEARTBEAT asks for the rest."""


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
    `msbot_xrce.streams.waiting_messages`."""
    may_reorder: bool = False
    """Whether packets may overtake each other on the way; a stock client is then spared what would harm it."""

    sparse_acknacks: bool = False
    """Whether one ACKNACK speaks for several messages, where the link loses nothing and both ends are MsBOT's. The
    messages to acknowledge at once follow from their numbers, so the sender knows which round trips it can measure."""

    @property
    def watches_order(self) -> bool:
        """Whether to look for packets that overtake each other; see `msbot_xrce.streams.reordering`."""
        return self.may_reorder and self.peer_is_stock


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


# What a session counts, so that nothing is dropped without a trace.


@dataclass(slots=True)
class SessionCounters:
    """What happened in a session since it was made; never reset by a new login."""

    packets_in: int = 0
    packets_out: int = 0
    resent: int = 0
    """Reliable messages sent again because the peer missed them."""
    heartbeats_out: int = 0
    repeated: int = 0
    """Messages of any stream that came again or too late; they are harmless and ignored."""
    early: int = 0
    """Reliable messages that came before one that is still missing, and were held for it."""
    dropped: Tally = field(default_factory=Tally)
    """What was not handled or not sent, by reason in words; the set of reasons is fixed."""


class Memory:
    """The bytes a session may hold for messages that are not complete: early ones and pieces of large ones."""

    __slots__ = ("_shared", "limit", "used")

    def __init__(self, limit: int, shared: Memory | None = None) -> None:
        """Allow `limit` bytes, and together with other sessions no more than `shared` allows."""
        self.limit = limit
        self.used = 0
        self._shared = shared

    def take(self, size: int) -> bool:
        """Reserve that many bytes; False when they do not fit."""
        if self.used + size > self.limit or not (self._shared is None or self._shared.take(size)):
            return False
        self.used += size
        return True

    def give(self, size: int) -> None:
        """Return bytes that were taken before."""
        self.used -= size
        if self._shared is not None:
            self._shared.give(size)
