"""The relays that bring their parts to this agent (`msbot_agent.link.relay`).

A relay is one more link of the agent, made when it introduces itself. Anybody on a network may call itself a relay, as
anybody may call itself a part: its parts meet the same gate, and all of them count as coming from its address. A relay
that came in by a person's connection is that person's, with all its parts; it has names of its own, so that a pupil's
relay takes no other's place.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Hashable, Iterable
from itertools import chain, islice
from typing import Final

from msbot_agent.agent.client_table import ServedLink
from msbot_agent.agent.fair_share import SessionlessLimiter
from msbot_agent.agent.gate import Gate
from msbot_agent.link import Link, Peer, PriorityLink, pupil_of_connection
from msbot_agent.link.relay import Bye, Hello, Message, Refused, RelayedLink, RelayGreeting, Who, decode, encode
from msbot_xrce.counting import Tally
from msbot_xrce.errors import LinkDown, LinkFull, RemoteProtocolError

MAX_RELAYS: Final = 64
MAX_RELAYS_OF_ADDRESS: Final = 8
MAX_RELAYS_OF_PUPIL: Final = 2
MAX_RELAYS_OF_PUPILS: Final = 32
"""Of all pupils: they leave room for those of the robot."""

_log = logging.getLogger(__name__)


class Relays:
    """Knows which relay speaks from where.

    Args:
        add_link: has the agent serve one more link.
        greeting: what relays are told.
        per_s: messages of unknown senders that are read in a second.
    """

    def __init__(self, add_link: Callable[[Link], None], greeting: RelayGreeting, per_s: float) -> None:
        self.dropped = Tally()
        self.from_strangers = 0
        """Messages from where no relay was known."""
        self._add_link = add_link
        self._greeting = greeting
        self._links: list[RelayedLink] = []
        self._by_place: dict[tuple[Link, Peer], RelayedLink] = {}
        self._strangers = SessionlessLimiter(per_s)

    def receive(self, way: Link, packet: bytes, peer: Peer, now: float) -> None:
        """A message that begins like one of a relay."""
        known = self._by_place.get((way, peer))
        self.from_strangers += known is None
        if known is None and not self._strangers.takes((way.info.name, way.origin(peer)), peer, now):
            self.dropped.count("messages of unknown relays beyond their share: not read")
            return
        try:
            message = decode(packet)
        except RemoteProtocolError:
            self.dropped.count("message of a relay that cannot be read")
            return
        if isinstance(message, Hello):
            self._greet(message, way, peer, now)
        elif known is None:
            if not isinstance(message, Bye):
                self._answer(Who(), way, peer)
        elif isinstance(message, Bye):
            known.end()
        else:
            known.receive(message, now)

    def has(self, way: Link, peer: Peer) -> bool:
        """Whether a relay speaks from there."""
        return (way, peer) in self._by_place

    def peers(self, way: Link) -> list[Peer]:
        """Where the relays on that link are."""
        return [peer for link, peer in self._by_place if link is way]

    def room_gained(self, way: Link) -> None:
        """That link has room again: its relays may go on."""
        for link in tuple(self._links):
            if link.way is way:
                link.room_on_the_way()

    def ended(self, link: Link) -> bool:
        """Forget a link that has ended; False: it was no relay's."""
        if link not in self._links:
            return False
        assert isinstance(link, RelayedLink)
        self._links.remove(link)
        self._by_place = {place: one for place, one in self._by_place.items() if one is not link}
        _log.info("%s has ended", link.info.name)
        return True

    def _greet(self, hello: Hello, way: Link, peer: Peer, now: float) -> None:
        whose = pupil_of_connection(peer)
        found = next((link for link in self._links if (link.hello.boot, link.owner) == (hello.boot, whose)), None)
        if found is None:
            refusal = self._make_room(hello, way, peer)
            if refusal:
                self._answer(Refused(refusal), way, peer)
                return
            found = RelayedLink(hello, way, peer, self._greeting)
            self._links.append(found)
            self._add_link(found)
            _log.info("%s has come, from %s on %s", found.info.name, way.describe(peer), way.info.name)
        self._by_place = {place: one for place, one in self._by_place.items() if one is not found}
        earlier = self._by_place.get((way, peer))
        if earlier is not None:
            earlier.end()
        self._by_place[way, peer] = found
        found.welcome(way, peer, now)

    def _make_room(self, hello: Hello, way: Link, peer: Peer) -> str:
        """Why there is no room for one more relay; empty when there is."""
        origin, whose = (way.info.name, way.origin(peer)), pupil_of_connection(peer)
        for link in self._links:
            if (link.hello.name, link.hello.carried, link.owner) == (hello.name, hello.carried, whose):
                if not link.is_silent and link.origin(None) != origin:
                    return (
                        f"a relay with the name {hello.name} is there already, at {link.way.describe(link.relay)}: "
                        "give this one another with --name"
                    )
                link.end()  # it was started again
                return ""
        if whose:
            of_pupil = [link for link in self._links if link.owner == whose]
            if len(of_pupil) >= MAX_RELAYS_OF_PUPIL:
                return self._put_out(of_pupil, f"{MAX_RELAYS_OF_PUPIL} relays of {whose} are there already")
            of_pupils = [link for link in self._links if link.owner]
            if len(of_pupils) >= MAX_RELAYS_OF_PUPILS:
                return self._put_out(of_pupils, f"{MAX_RELAYS_OF_PUPILS} relays of pupils are there already")
        of_address = [link for link in self._links if link.origin(None) == origin]
        if len(of_address) >= MAX_RELAYS_OF_ADDRESS:
            return self._put_out(of_address, f"{MAX_RELAYS_OF_ADDRESS} relays come from your address already")
        if len(self._links) >= MAX_RELAYS:
            mine = [link for link in self._links if link.owner] if whose else self._links
            return self._put_out(mine, f"{MAX_RELAYS} relays are there already")
        return ""

    @staticmethod
    def _put_out(links: list[RelayedLink], otherwise: str) -> str:
        """A relay that is silent, or has brought no part, makes room."""
        for link in links:
            if link.is_silent or not link.was_used:
                link.end()
                return ""
        return otherwise

    def _answer(self, message: Message, way: Link, peer: Peer) -> None:
        try:
            way.send(encode(message), peer)
        except (LinkDown, LinkFull):
            self.dropped.count("answer to a relay: no room")


# Whose packets a link puts before those of strangers: peers with sessions, and relays.


MOST_PLACES = 1024
"""Places of parts that are remembered, also when their connections have broken."""


def put_known_peers_first(port: ServedLink, gate: Gate, relays: Relays) -> None:
    """Have a link do so if it can, and if strangers are bounded at all."""
    if isinstance(port.link, PriorityLink) and gate.limits_strangers():
        port.link.put_first(PeersOfAgent(port, gate, relays))


class PeersOfAgent:
    """Those of one link; satisfies `msbot_agent.link.PeerDirectory`.

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
    def stranger_count(self) -> int:
        """See `PeerDirectory`."""
        return self._port.outside + self._relays.from_strangers

    def knows(self, peer: Peer) -> bool:
        """See `PeerDirectory`; a client with its key in every header that shares its address counts by that address."""
        return peer in self._port.clients or peer in self._port.keyed or self._relays.has(self._port.link, peer)

    def has_a_part(self, origin: Hashable) -> bool:
        """See `PeerDirectory`."""
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

    def preferred_peers(self, most: int) -> Iterable[Peer]:
        """See `PeerDirectory`: relays, then clients with a place, then those that came last."""
        members = self._port.members
        settled = [peer for proxy, peer in members.items() if self._gate.is_settled(proxy.info)]
        latest = reversed(members.values())
        return islice(dict.fromkeys(chain(self._relays.peers(self._port.link), settled, latest)), most)
