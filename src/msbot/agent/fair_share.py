"""What one client may take of the agent's time when it sends without measure. Pure.

A client that sends tens of thousands of packets a second would have the agent do nothing else. Where the gate says so,
each client has a share: up to `per_client` packets a second as long as all together send less than `in_all`; beyond,
whoever sends most is cut first, and all that are cut get the same. What is beyond the share is read from the link and
thrown away at once, a tenth of the work, so that the others' packets do not wait, or get lost, behind it.

The way of a packet knows nothing of this but one look whether its client is limited. Packets are counted by the
sessions anyway; only when a link is busier than one client may be are the counts compared, some times a second.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Generic, Protocol, TypeVar

from msbot.runtime.tally import Tally

WINDOW_S = 0.25
"""This often the counts are compared while there is much traffic."""
BURST_S = 0.1
"""A limited client may send so much of its share at once."""
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
        """Packets since the last comparison that were beyond the share."""

    def set(self, per_s: float) -> None:
        """The share has changed."""
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
    """A client, as its share is reckoned; `msbot.agent.proxy.Proxy` is one."""

    limit: Limit | None
    dropped: Tally

    @property
    def packets_in(self) -> int:
        """Packets that were taken from it."""


S = TypeVar("S", bound=Sender)


class FairShare(Generic[S]):
    """Compares the counts and limits who sends without measure (see the module docstring).

    Args:
        per_client: packets a second that a client may send.
        in_all: packets a second that all may send before the share gets smaller.
        may_limit: asked about each client that sends too much, with packets a second and its share.
    """

    def __init__(self, per_client: float, in_all: float, may_limit: Callable[[S, float, float], bool]) -> None:
        self._per_client = per_client
        self._in_all = in_all
        self._may_limit = may_limit
        self._compared_at = 0.0
        self._total = 0
        self._before: dict[S, int] | None = None
        """What had come from whom at the last comparison; None: there was little traffic."""
        self.next_at = 0.0
        """When `compare` is to be called."""

    def compare(self, total: int, senders: Iterable[S], now: float) -> None:
        """Look who sent how much since the last time.

        Args:
            total: packets that came on all links so far.
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
    """What one may send, `most` at most, so that all who send at those rates together send no more than `in_all`.

    Who sends less than the share keeps what it sends; who sends more is cut to it (max-min fairness).
    """
    left, ordered = in_all, sorted(rates)
    for place, rate in enumerate(ordered):
        share = left / (len(ordered) - place)
        if rate > share:
            return min(share, most)
        left -= rate
    return most
