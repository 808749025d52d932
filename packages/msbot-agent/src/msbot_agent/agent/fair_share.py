"""How much of the agent's time one client may take when it sends excessively. Pure.

A client that sends tens of thousands of packets a second would leave the agent no time for anything else. Where the
gate allows it, each client has a share: up to `per_client` packets a second, as long as all clients together send less
than `in_all`. Beyond that, the clients that send most are limited first, and all limited ones get the same share.
Packets beyond the share are read from the link and thrown away at once. That is a tenth of the work, so other clients'
packets do not wait, or get lost, behind them.

The path of a packet only has to check whether its client is limited. The sessions count packets anyway. The counts are
compared a few times a second, and only when a link is busier than one client may be.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Generic, Protocol, TypeVar

from msbot_xrce.common.tally import Tally

WINDOW_S = 0.25
"""Time between two comparisons of the counts while there is much traffic."""
BURST_S = 0.1
"""A limited client may send this much of its share in one burst."""
CALM = 0.8
"""A client whose traffic falls below this part of its share is no longer limited."""
BEYOND = "packet beyond its share: not read"


class Limit:
    """A limited client's packets: a token bucket."""

    __slots__ = ("_filled_at", "_per_s", "_tokens", "thrown_away")

    def __init__(self, per_s: float, now: float) -> None:
        self._per_s = per_s
        self._filled_at = now
        self._tokens = 0.0
        self.thrown_away = 0
        """Packets thrown away since the last comparison."""

    def set(self, per_s: float) -> None:
        """Change the share."""
        self._per_s = per_s

    def takes(self, now: float) -> bool:
        """Whether one more packet is within the share."""
        self._tokens = min(self._per_s * BURST_S, self._tokens + (now - self._filled_at) * self._per_s)
        self._filled_at = now
        if self._tokens < 1.0:
            self.thrown_away += 1
            return False
        self._tokens -= 1.0
        return True


class Sender(Protocol):
    """A client, as far as its share is concerned; `msbot_agent.agent.proxy.Proxy` is one."""

    limit: Limit | None
    dropped: Tally

    @property
    def packets_in(self) -> int:
        """Packets that were taken from it."""


S = TypeVar("S", bound=Sender)


class FairShare(Generic[S]):
    """Compares the counts and limits the clients that send too much (see the module docstring).

    Args:
        per_client: packets a second that a client may send.
        in_all: packets a second that all may send before the share shrinks.
        may_limit: asked about each client that sends too much; gets its packets a second and its share.
    """

    def __init__(self, per_client: float, in_all: float, may_limit: Callable[[S, float, float], bool]) -> None:
        self._per_client = per_client
        self._in_all = in_all
        self._may_limit = may_limit
        self._compared_at = 0.0
        self._total = 0
        self._before: dict[S, int] | None = None
        """Packet counts by client at the last comparison; None: there was little traffic."""
        self.next_at = 0.0
        """When `compare` is to be called."""

    def compare(self, total: int, senders: Iterable[S], now: float) -> None:
        """Check how much each client sent since the last time.

        Args:
            total: packets received on all links so far.
            senders: all clients.
            now: the present time.
        """
        passed_s = now - self._compared_at
        came, self._total = total - self._total, total
        before, self._before = self._before, None
        self._compared_at, self.next_at = now, now + WINDOW_S
        if came < self._per_client * CALM * passed_s and not any(sender.limit for sender in before or ()):
            return
        self._before = {sender: sender.packets_in for sender in senders}
        if before is None or passed_s <= 0:
            return
        rates = {
            sender: (count - before[sender] + (sender.limit.thrown_away if sender.limit else 0)) / passed_s
            for sender, count in self._before.items()
            if sender in before
        }
        share = fair_share(rates.values(), self._in_all, self._per_client)
        for sender, rate in rates.items():
            self._judge(sender, rate, share, now)

    def _judge(self, sender: S, rate: float, share: float, now: float) -> None:
        limit = sender.limit
        if limit is not None:
            if limit.thrown_away:
                sender.dropped.count(BEYOND, limit.thrown_away)
                limit.thrown_away = 0
            if rate < share * CALM:
                sender.limit = None
            else:
                limit.set(share)
                self._may_limit(sender, rate, share)
        elif rate > share and self._may_limit(sender, rate, share):
            sender.limit = Limit(share, now)


def fair_share(rates: Iterable[float], in_all: float, most: float) -> float:
    """The rate each sender may have, at most `most`, so that all of them together send no more than `in_all`.

    A sender below this share keeps its rate; one above is limited to it (max-min fairness).
    """
    left, ordered = in_all, sorted(rates)
    for place, rate in enumerate(ordered):
        share = left / (len(ordered) - place)
        if rate > share:
            return min(share, most)
        left -= rate
    return most
