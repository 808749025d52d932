"""Decides which clients may join now when many want to at once, and when the others should ask again. Pure.

A client that joins costs the agent as much as hundreds of its later messages. If a thousand parts are switched on in
the same instant, or their master restarts, together they would keep each other from getting in, and the signs of life
of the settled ones would be delayed. So only a bounded number joins at a time: a client holds a place here from its
login until the gate calls it settled, or until it falls silent or takes too long. A client that finds no place is told
to come back. Places are given first come, first served, and each origin (a computer) has an equal share of them while
others wait. Settled clients never pass through here, so an agent without a gate has no queue.
"""

from __future__ import annotations

from collections.abc import Hashable
from itertools import islice
from typing import Protocol

from msbot_agent.agent.gate import ClientInfo, Gate

QUIET_S = 0.5
"""A client that has been silent for this long while it joins gives up its place to others; it may still go on."""
LONGEST_S = 5.0
"""No client keeps a place for longer."""
FORGET_S = 10.0
"""A client that has not asked again for this long has lost its turn."""
SHORTEST_WAIT_S = 0.2
LONGEST_WAIT_S = 5.0
FIRST_RATE = 100.0
"""Assumed number of clients that join in a second, until it has been measured."""
RATE_WINDOW_S = 1.0
MOST_ORIGINS = 256
"""Origins that are distinguished; any further ones share one turn."""

Origin = Hashable
OTHERS: Origin = "others"


class Joiner(Protocol):
    """A client that is joining; `msbot_agent.agent.proxy.Proxy` is one."""

    info: ClientInfo
    is_over: bool

    @property
    def last_heard(self) -> float:
        """When it was last heard."""


class JoinQueue:
    """The places for joining clients, and the clients that wait for one (see the module docstring).

    Args:
        gate: says which clients are settled.
        places: how many may join at a time.
        most_waiting: how many may wait in order; any further ones have no fixed turn.
    """

    def __init__(self, gate: Gate, *, places: int, most_waiting: int) -> None:
        self._gate = gate
        self._places = places
        self._most_waiting = most_waiting
        self._joining: dict[Joiner, tuple[Origin, float]] = {}
        """Who has a place -> its origin, and since when."""
        self._held: dict[Origin, int] = {}
        self._waiting: dict[Origin, dict[Hashable, float]] = {}
        """By origin, in the order of arrival: who waits -> when it last asked."""
        self._waiting_count = 0
        self._rate = FIRST_RATE
        self._came_in = 0
        self._counted_since: float | None = None

    def wait_s(self, who: Hashable, origin: Origin, now: float) -> float:
        """0.0: it may join now, and the caller must call `enter`; else the seconds after which it should ask again."""
        if origin not in self._waiting and len(self._waiting) >= MOST_ORIGINS:
            origin = OTHERS
        self._free_places(now)
        rank = self._rank(who, origin, now)
        free = self._places - len(self._joining)
        others = sum(1 for other in self._waiting if other != origin)
        share = max(1, self._places // (1 + others))
        if free > 0 and rank < free + self._places and (not others or self._held.get(origin, 0) < share):
            self._forget(who, origin)
            return 0.0
        wait_s = (1 + rank) * (1 + others) / self._rate
        return min(max(wait_s, SHORTEST_WAIT_S), LONGEST_WAIT_S)

    def enter(self, joiner: Joiner, origin: Origin, now: float) -> None:
        """Note that it has logged in."""
        self._joining[joiner] = (origin, now)
        self._held[origin] = self._held.get(origin, 0) + 1
        if self._counted_since is None:
            self._counted_since = now
        self._came_in += 1
        passed_s = now - self._counted_since
        if passed_s >= RATE_WINDOW_S:
            self._rate = max(self._came_in / passed_s, 1.0)
            self._came_in, self._counted_since = 0, now

    def leave(self, joiner: Joiner) -> None:
        """Note that its session has ended."""
        place = self._joining.pop(joiner, None)
        if place is not None:
            origin = place[0]
            self._held[origin] -= 1
            if not self._held[origin]:
                del self._held[origin]

    def _free_places(self, now: float) -> None:
        for joiner, (_, since) in list(self._joining.items()):
            is_quiet = now - max(joiner.last_heard, since) > QUIET_S
            if joiner.is_over or is_quiet or now - since > LONGEST_S or self._gate.is_settled(joiner.info):
                self.leave(joiner)

    def _rank(self, who: Hashable, origin: Origin, now: float) -> int:
        """How many of its origin are before it, as far as that matters; it waits in order from now on."""
        queue = self._waiting.get(origin, {})
        while queue and now - next(iter(queue.values())) > FORGET_S:
            self._forget(next(iter(queue)), origin)
        if who in queue:
            queue[who] = now
        elif self._waiting_count < self._most_waiting:
            self._waiting.setdefault(origin, queue)[who] = now
            self._waiting_count += 1
        first = islice(queue, 2 * self._places)
        return next((rank for rank, other in enumerate(first) if other == who), len(queue))

    def _forget(self, who: Hashable, origin: Origin) -> None:
        queue = self._waiting.get(origin, {})
        if queue.pop(who, None) is not None:
            self._waiting_count -= 1
            if not queue:
                del self._waiting[origin]
