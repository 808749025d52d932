"""Whose packets a link puts before those of strangers: peers with sessions, and relays."""

from __future__ import annotations

from collections.abc import Hashable, Iterable
from itertools import chain, islice

from msbot_agent.agent.client_table import ServedLink
from msbot_agent.agent.gate import Gate
from msbot_agent.agent.relays import Relays
from msbot_agent.link import ChoosyLink, Peer

MOST_PLACES = 1024
"""Places of parts that are remembered, also when their connections have broken."""


def put_known_peers_first(port: ServedLink, gate: Gate, relays: Relays) -> None:
    """Have a link do so if it can, and if strangers are bounded at all."""
    if isinstance(port.link, ChoosyLink) and gate.limits_strangers():
        port.link.put_first(PeersOfAgent(port, gate, relays))


class PeersOfAgent:
    """Those of one link; satisfies `msbot_agent.link.KnownPeers`.

    Args:
        port: the link and its clients.
        gate: says who has a place in the robot.
        relays: the agent's relays.
    """

    def __init__(self, port: ServedLink, gate: Gate, relays: Relays) -> None:
        self._port = port
        self._gate = gate
        self._relays = relays
        self._places: dict[Hashable, None] = {}

    @property
    def strangers(self) -> int:
        """See `KnownPeers`."""
        return self._port.outside + self._relays.from_strangers

    def knows(self, peer: Peer) -> bool:
        """See `KnownPeers`; a client with its key in every header that shares its address counts by that address."""
        return peer in self._port.clients or peer in self._port.keyed or self._relays.has(self._port.link, peer)

    def has_a_part(self, origin: Hashable) -> bool:
        """See `KnownPeers`."""
        if origin not in self._places:
            link = self._port.link
            for proxy, peer in self._port.members.items():
                if link.origin(peer) == origin and self._gate.is_settled(proxy.info):
                    self._remember(origin)
                    return True
            return False
        return True

    def _remember(self, origin: Hashable) -> None:
        if len(self._places) >= MOST_PLACES:
            del self._places[next(iter(self._places))]
        self._places[origin] = None

    def first(self, most: int) -> Iterable[Peer]:
        """See `KnownPeers`: relays, then clients with a place, then those that came last."""
        members = self._port.members
        settled = [peer for proxy, peer in members.items() if self._gate.is_settled(proxy.info)]
        latest = reversed(members.values())
        return islice(dict.fromkeys(chain(self._relays.peers(self._port.link), settled, latest)), most)
