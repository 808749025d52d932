"""Decides which session makes room when there are too many.

Clients that hold a place in the robot (the gate says which) never have to make room, however many strangers log in.
Strangers have a bounded share of all sessions, and each address (a computer, a port, a node) has a bounded share of
that; beyond it, the oldest stranger goes, those of the same address first. So a restarted part always gets in, claims
its place within milliseconds, and keeps it. An agent without a gate has no strangers: when it is full, a client that
fell silent long ago makes room, or else the newcomer is refused.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable
from itertools import islice

from msbot_agent.agent.agent_settings import AgentSettings
from msbot_agent.agent.gate import Gate
from msbot_agent.agent.proxy import Proxy

LOOK_AT = 64
"""For each newcomer to a full table, only this many of the oldest clients are checked."""


class SessionBudget:
    """Counts the strangers of one agent, oldest first (see the module docstring)."""

    def __init__(self, gate: Gate, settings: AgentSettings) -> None:
        self._gate = gate
        self._settings = settings
        self._strangers: dict[Proxy, Hashable] = {}
        self._by_origin: dict[Hashable, dict[Proxy, None]] = {}

    def __len__(self) -> int:
        return len(self._strangers)

    def add(self, proxy: Proxy, origin: Hashable) -> None:
        """A session was opened from there; it counts as a stranger until the gate settles it."""
        self._strangers[proxy] = origin
        self._by_origin.setdefault(origin, {})[proxy] = None

    def remove(self, proxy: Proxy) -> None:
        """A session has ended, or its client is not a stranger any more."""
        origin = self._strangers.pop(proxy, None)
        group = self._by_origin.get(origin)
        if group is not None:
            group.pop(proxy, None)
            if not group:
                del self._by_origin[origin]

    def who_makes_room(self, origin: Hashable) -> Proxy | None:
        """The stranger that must go before another session is opened from there; None when there is room."""
        group = self._by_origin.get(origin, {})
        if len(group) >= self._settings.max_unsettled_of_address and (oldest := self._oldest(group)) is not None:
            return oldest
        if len(self._strangers) >= self._settings.max_unsettled:
            return self._oldest(self._strangers)
        return None

    def who_is_forgotten(self, clients: Iterable[Proxy], now: float) -> Proxy | None:
        """A client that fell silent so long ago that a newcomer may have its session in a full table."""
        for proxy in islice(clients, LOOK_AT):
            if now - proxy.last_heard > self._settings.unsettled_dead_after_s:
                return proxy
        return self._oldest(self._strangers)

    def _oldest(self, group: dict[Proxy, Hashable] | dict[Proxy, None]) -> Proxy | None:
        while group:
            proxy = next(iter(group))
            if not self._gate.is_settled(proxy.info):
                return proxy
            self.remove(proxy)
        return None
