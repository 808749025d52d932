"""Two sessions that present one client key: a restart, or an attack.

Where the gate keeps sessions, a login from another address does not end the existing session. It opens a second one
beside it, under a key of the agent's own, and the old one is probed at its address. A silent old session ends if it
holds no place, or as soon as the newcomer holds its place, which the gate decides. A second session that holds no place
after a while ends. So a datagram with somebody else's key cannot take over a session, and a restarted part need not
wait: it goes through both steps of joining in the meantime.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Hashable
from functools import partial

from msbot_agent.agent.client_table import ClientTable
from msbot_agent.agent.gate import Gate
from msbot_agent.agent.proxy import Proxy
from msbot_agent.text.sentence import said

logger = logging.getLogger(__name__)

PATIENCE_S = 0.12
"""A client that does not answer three probes within this time is silent."""
PATIENCE_ON_A_BUS_S = 0.5
"""The same on a bus, where other traffic may go first."""
PROBES = 3
HELD_S = 10.0
"""A second session ends if it holds no place after this time while another one with its key is alive."""
MOST_BESIDE = 4
"""How many sessions one key may have beside the first."""

CallAt = Callable[[float, Callable[[], None]], object]


class Rivals:
    """Keeps sessions with one client key apart until one has won (see the module's docstring).

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
                other.info.key, other.info.link, newcomer.info.address,
            )  # fmt: skip
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
