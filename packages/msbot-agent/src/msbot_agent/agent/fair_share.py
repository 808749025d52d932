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

from collections.abc import Callable, Hashable, Iterable
from typing import Generic, Protocol, TypeVar

from msbot_agent.pace import TokenBucket
from msbot_xrce.counting import Tally

WINDOW_S = 0.25
"""Time between two comparisons of the counts while there is much traffic."""
BURST_S = 0.1
"""A limited client may send this much of its share in one burst."""
CALM = 0.8
"""A client whose traffic falls below this part of its share is no longer limited."""
BEYOND = "packet beyond its share: not read"


class Limit:
    """A limited client's packets."""

    __slots__ = ("_bucket", "thrown_away")

    def __init__(self, per_s: float, now: float) -> None:
        self._bucket = TokenBucket(per_s, per_s * BURST_S, now, is_full=False)
        self.thrown_away = 0
        """Packets thrown away since the last comparison."""

    def set(self, per_s: float) -> None:
        """Change the share."""
        self._bucket.change(per_s, per_s * BURST_S)

    def takes(self, now: float) -> bool:
        """Whether one more packet is within the share."""
        if self._bucket.take(now):
            return True
        self.thrown_away += 1
        return False


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


# How much of the agent's time packets outside of sessions may take: logins, questions, and whatever strangers send.
#
# Anybody can send such packets, as many as the network carries, and each of them is read and answered. Where the gate
# says so, only so many of them a second are; the rest is thrown away unread, and whoever meant well asks again. Pure.
#
# They are counted in windows. Half of what a window takes is for addresses (computers, ports, nodes) that sent such
# packets in the window before: each gets what it sent then, as long as all of that fits; else those that sent most
# are cut to the same number. The other half is for addresses that sent none, first come first served, so that a
# newcomer does not wait behind a flood, from however many addresses it comes, as long as those stay the same. Each
# address shares its part among its peers (the sockets of a computer) by the same rule. Who holds a place in the robot
# shares with those that do as well, and with no stranger; packets inside a session never come here.
#
# A flood from ever new addresses cannot be told from newcomers: of both the same part is thrown away.


MOST_ORIGINS = 1024
"""Addresses of a window that are told apart; those beyond share one part."""
MOST_PEERS = 2048
"""The same for the peers of an address."""
TOLD_S = 60.0
"""This often at most it is told that packets are thrown away."""
BEYOND_OUTSIDE = "packet outside of a session beyond its share: not read"

_OTHERS = "others"


class _Turns:
    """One window's packets for some who ask; in half of them come those that asked in the window before."""

    __slots__ = ("_before", "_half", "_taken", "asked", "share")

    def __init__(self, budget: float, before: dict[Hashable, int]) -> None:
        self._before = before
        self._half = max(1.0, budget / 2)
        self._taken = {True: 0, False: 0}
        self.asked: dict[Hashable, int] = {}
        """How many packets came from whom."""
        self.share = max(1.0, fair_share(before.values(), self._half, self._half))
        """The most that one gets."""

    def ask(self, who: Hashable) -> bool:
        """One more packet has come; whether it is within the sender's share."""
        count = self.asked[who] = self.asked.get(who, 0) + 1
        return count <= self.share

    def take(self, who: Hashable) -> bool:
        """Whether the half that the sender belongs to has room for a packet more, which is then taken."""
        is_known = who in self._before
        if self._taken[is_known] >= self._half:
            return False
        self._taken[is_known] += 1
        return True


class SessionlessLimiter:
    """Decides which packets outside of sessions are read.

    Args:
        per_s: so many a second at most.
    """

    def __init__(self, per_s: float) -> None:
        self._budget = per_s * WINDOW_S
        self._ends_at = 0.0
        self._origins = _Turns(self._budget, {})
        self._peers: dict[Hashable, _Turns] = {}
        self._peers_before: dict[Hashable, _Turns] = {}
        self._told_at: float | None = None

    def takes(self, origin: Hashable, peer: Hashable, now: float) -> bool:
        """Whether one more packet, of that peer at that address, is read."""
        if now >= self._ends_at:
            self._begin_window(now)
        origins = self._origins
        if origin not in origins.asked and len(origins.asked) >= MOST_ORIGINS:
            origin = _OTHERS
        origins.ask(origin)
        peers = self._peers.get(origin)
        if peers is None:
            before = self._peers_before.get(origin)
            peers = self._peers[origin] = _Turns(origins.share, {} if before is None else before.asked)
        if peer not in peers.asked and len(peers.asked) >= MOST_PEERS:
            peer = _OTHERS
        return peers.ask(peer) and peers.take(peer) and origins.take(origin)

    def is_news(self, now: float) -> bool:
        """Whether it is to be told now that a packet was thrown away."""
        if self._told_at is not None and now - self._told_at < TOLD_S:
            return False
        self._told_at = now
        return True

    def _begin_window(self, now: float) -> None:
        is_next = now < self._ends_at + WINDOW_S
        self._ends_at = now + WINDOW_S
        self._origins = _Turns(self._budget, self._origins.asked if is_next else {})
        self._peers_before = self._peers if is_next else {}
        self._peers = {}
