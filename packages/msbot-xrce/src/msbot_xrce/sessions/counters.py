"""What a session counts, so that nothing is dropped without a trace."""

from __future__ import annotations

from dataclasses import field

from msbot_xrce.common.lazy_dataclass import dataclass
from msbot_xrce.common.tally import Tally


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
