"""Sessions that a board leaves behind when it resets and comes again under another key.

Most stock clients have one session on an address (a serial port, a node of a bus, an address and port of the network),
and a login under another key ends it at once: `Handshake` sees to that. Sessions with their key in each header may
share an address, so there a login proves nothing. The agent asks the others at that address for a sign of life, which
every client gives, and ends those that stay silent. Where the gate keeps sessions, it is the robot's master that
notices who is gone.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Hashable, Iterable
from functools import partial
from itertools import islice

from msbot_agent.agent.agent_settings import AgentSettings
from msbot_agent.agent.client_table import ClientTable, ServedLink
from msbot_agent.agent.gate import Gate
from msbot_agent.agent.proxy import Proxy
from msbot_agent.link import Peer
from msbot_agent.text.sentence import said

PATIENCE_S = 6.0
"""Silence that ends such a session; a client that looks at its link once in two seconds answers one of the probes."""
PROBES = 3

CallAt = Callable[[float, Callable[[], None]], object]


class StaleSessionProbe:
    """Finds and ends such sessions (see the module's docstring).

    Args:
        gate: says whose sessions it keeps.
        call_at: calls a function at a given time of the agent's clock.
        end_session: ends a session, with a reason in words.
    """

    def __init__(self, gate: Gate, call_at: CallAt, end_session: Callable[[Proxy, str], None]) -> None:
        self._gate = gate
        self._call_at = call_at
        self._end_session = end_session
        self._newest: dict[tuple[ServedLink, Peer], Proxy] = {}
        """Where somebody is being asked, and who logged in there last."""

    def begin(self, newcomer: Proxy, port: ServedLink, peer: Peer, now: float) -> None:
        """A session was opened: find out which others at its address are alive. One round at a time for an address."""
        if (port, peer) in self._newest:
            self._newest[port, peer] = newcomer
        elif port.keyed.get(peer, 0) > (1 if port.clients.get(peer) is not newcomer else 0):
            self._ask(newcomer, port, peer, now)

    def _ask(self, newcomer: Proxy, port: ServedLink, peer: Peer, now: float) -> None:
        others = [
            proxy
            for proxy, place in port.members.items()
            if place == peer and proxy is not newcomer and not self._gate.keeps(proxy.info)
        ]
        if not others:
            return
        self._newest[port, peer] = newcomer
        for probe in range(PROBES):
            self._call_at(now + PATIENCE_S * probe / PROBES, partial(self._probe, others, now))
        self._call_at(now + PATIENCE_S, partial(self._look, others, newcomer, port, peer, now))

    def _probe(self, others: list[Proxy], since: float) -> None:
        for other in others:
            if not other.is_over and other.last_heard <= since:
                other.probe()

    def _look(self, others: list[Proxy], newcomer: Proxy, port: ServedLink, peer: Peer, since: float) -> None:
        for other in others:
            if not other.is_over and other.place == (port, peer) and other.last_heard <= since:
                self._end_session(other, said("silent since another client logged in from its address"))
        newest = self._newest.pop((port, peer))
        if newest is not newcomer and not newest.is_over:
            self._ask(newest, port, peer, since + PATIENCE_S)


# Two sessions that present one client key: a restart, or an attack.
#
# Where the gate keeps sessions, a login from another address does not end the existing session. It opens a second one
# beside it, under a key of the agent's own, and the old one is probed at its address. A silent old session ends if it
# holds no place, or as soon as the newcomer holds its place, which the gate decides. A second session that holds no
# place after a while ends. So a datagram with somebody else's key cannot take over a session, and a restarted part
# need not wait: it goes through both steps of joining in the meantime.


logger = logging.getLogger(__name__)

DOUBLE_LOGIN_PATIENCE_S = 0.12
"""A client that does not answer three probes within this time is silent."""
PATIENCE_ON_A_BUS_S = 0.5
"""The same on a bus, where other traffic may go first."""
HELD_S = 10.0
"""A second session ends if it holds no place after this time while another one with its key is alive."""
MOST_BESIDE = 4
"""How many sessions one key may have beside the first."""


class KeyConflicts:
    """Keeps sessions with one client key apart until one has won.

    Args:
        clients: all sessions.
        gate: says which of them hold a place.
        call_at: calls a function at a given time of the agent's clock.
        end_session: ends a session, with a reason in words.
    """

    def __init__(
        self, clients: ClientTable, gate: Gate, call_at: CallAt, end_session: Callable[[Proxy, str], None]
    ) -> None:
        self._clients = clients
        self._gate = gate
        self._call_at = call_at
        self._end_session = end_session
        self._origins: dict[Proxy, Hashable] = {}
        """The second sessions that hold no place yet, oldest first -> their origins."""

    def make_room(self, client_key: int) -> None:
        """Make room before one more session with that key opens: if there are too many, the oldest of the busiest
        origin ends."""
        beside = [proxy for proxy in self._clients.sharing(client_key) if proxy in self._origins]
        if len(beside) >= MOST_BESIDE:
            (origin, _), *_ = Counter(self._origins[proxy] for proxy in beside).most_common(1)
            oldest = next(proxy for proxy in beside if self._origins[proxy] == origin)
            self._end_session(oldest, said("made room for another newcomer with its key"))

    def begin(self, newcomer: Proxy, others: tuple[Proxy, ...], origin: Hashable, now: float) -> None:
        """A session was opened beside others with its key: find out which of them are alive."""
        self._origins[newcomer] = origin
        patience_s = newcomer.info.patience_s
        for other in others:
            logger.info(
                "client %08X on %s: a second session with its key is held beside it, from %s",
                other.info.key,
                other.info.link,
                newcomer.info.address,
            )
            other.probe()
        for probe in range(1, PROBES):
            self._call_at(now + patience_s * probe / PROBES, partial(self._probe, others, now))
        self._call_at(now + patience_s, partial(self._look, others, now))
        self._call_at(now + HELD_S, partial(self._give_up, newcomer))

    def forget(self, proxy: Proxy) -> None:
        """Forget a session that has ended."""
        self._origins.pop(proxy, None)

    def _probe(self, others: tuple[Proxy, ...], since: float) -> None:
        for other in others:
            if not other.is_over and other.last_heard <= since:
                other.probe()

    def _look(self, others: tuple[Proxy, ...], since: float) -> None:
        for other in others:
            if not other.is_over and other.last_heard <= since and not self._gate.is_settled(other.info):
                self._end_session(other, said("silent when its key came from another address"))

    def _give_up(self, newcomer: Proxy) -> None:
        self._origins.pop(newcomer, None)
        if newcomer.is_over or self._gate.is_settled(newcomer.info):
            return
        if len(self._clients.sharing(newcomer.info.client_key)) > 1:
            self._end_session(
                newcomer,
                said("held for {seconds:g} s beside another session of its key, and has no place", seconds=HELD_S),
            )


# Decides which session makes room when there are too many.
#
# Clients that hold a place in the robot (the gate says which) never have to make room, however many strangers log in.
# Strangers have a bounded share of all sessions, and each address (a computer, a port, a node) has a bounded share of
# that; beyond it, the oldest stranger goes, those of the same address first. So a restarted part always gets in, claims
# its place within milliseconds, and keeps it. An agent without a gate has no strangers: when it is full, a client that
# fell silent long ago makes room, or else the newcomer is refused.


LOOK_AT = 64
"""For each newcomer to a full table, only this many of the oldest clients are checked."""


class StrangerBudget:
    """Counts the strangers of one agent, oldest first."""

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
