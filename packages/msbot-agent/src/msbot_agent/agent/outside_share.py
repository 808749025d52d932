"""How much of the agent's time packets outside of sessions may take: logins, questions, and whatever strangers send.

Anybody can send such packets, as many as the network carries, and each of them is read and answered. Where the gate
says so, only so many of them a second are; the rest is thrown away unread, and whoever meant well asks again. Pure.

They are counted in windows. Half of what a window takes is for addresses (computers, ports, nodes) that sent such
packets in the window before: each gets what it sent then, as long as all of that fits; else those that sent most are
cut to the same number. The other half is for addresses that sent none, first come first served, so that a newcomer
does not wait behind a flood, from however many addresses it comes, as long as those stay the same. Each address shares
its part among its peers (the sockets of a computer) by the same rule. Who holds a place in the robot shares with those
that do as well, and with no stranger; packets inside a session never come here.

A flood from ever new addresses cannot be told from newcomers: of both the same part is thrown away.
"""

from __future__ import annotations

from collections.abc import Hashable

from msbot_agent.agent.fair_share import fair_share

WINDOW_S = 0.25
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


class OutsideShare:
    """Decides which packets outside of sessions are read (see the module docstring).

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
