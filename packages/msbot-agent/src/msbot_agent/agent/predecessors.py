"""Sessions that a board leaves behind when it resets and comes again under another key.

Most stock clients have one session on an address (a serial port, a node of a bus, an address and port of the network),
and a login under another key ends it at once: `Handshake` sees to that. Sessions with their key in each header may
share an address, so there a login proves nothing. The agent asks the others at that address for a sign of life, which
every client gives, and ends those that stay silent. Where the gate keeps sessions, it is the robot's master that
notices who is gone.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from msbot_agent.agent.client_table import ServedLink
from msbot_agent.agent.gate import Gate
from msbot_agent.agent.proxy import Proxy
from msbot_agent.link import Peer
from msbot_agent.text.sentence import said

PATIENCE_S = 6.0
"""Silence that ends such a session; a client that looks at its link once in two seconds answers one of the probes."""
PROBES = 3

CallAt = Callable[[float, Callable[[], None]], object]


class Predecessors:
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
