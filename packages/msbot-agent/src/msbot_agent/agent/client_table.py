"""Which client a packet belongs to: by its address, or by the key that some sessions carry in every header.

Session ids from 0x80 up have no key in the header; the client is the one that logged in from that address with that
id. Ids below 0x80 have the key in the header, and the address does not matter (XRCE 1.0 §8.2.1; seen on the wire).

DEVIATION: the genuine agent finds a client by its address alone, whatever the id. A late packet of the client's earlier
session, even from before a restart of the agent, would then advance the streams of the new one, and the client's next
messages would be mistaken for repetitions and lost without a trace.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import field

from msbot_agent.agent.proxy import Proxy
from msbot_agent.link import BacklogLink, Link, Peer
from msbot_xrce.counting import Tally
from msbot_xrce.lazy import dataclass
from msbot_xrce.messages import SESSION_NONE

_HIGHEST_DRAWN, _LOWEST_DRAWN = 0xFFFFFFFF, 0xFF000000
"""The agent's own keys, for second sessions, are counted down from the first to the second of these."""


@dataclass(slots=True, eq=False)
class ServedLink:
    """One link of the agent and the clients that logged in over it."""

    link: Link
    batch: int | None
    """How many packets are pulled out of a session at a time; None = all."""
    clients: dict[Peer, Proxy] = field(default_factory=dict)
    """The clients without keys in their headers, by address: one per address."""
    members: dict[Proxy, Peer] = field(default_factory=dict)
    """All clients; any number with keys in their headers may share an address."""
    keyed: dict[Peer, int] = field(default_factory=dict)
    """How many clients with keys in their headers are at an address."""
    gone: dict[Peer, list[Proxy]] = field(default_factory=dict)
    """Clients whose peer has gone, by address; they go on where they were when it is back."""
    blocked: dict[Proxy, None] = field(default_factory=dict)
    """Clients with packets for which the link had no room, in the order in which that happened."""
    in_bursts: bool = False
    """Whether the link says when a burst of packets ends."""
    backlog: BacklogLink | None = None
    """The link, if it knows when it could not read all that had come."""
    opened: bool = False
    """Whether the link has carried anything or said that it is up."""
    outside: int = 0
    """How many packets belonged to no session and to no relay."""
    dropped: Tally = field(default_factory=Tally)
    """Packets that belong to no client, by reason in words."""


class ClientTable:
    """All clients of the agent."""

    def __init__(self) -> None:
        self._by_key: dict[int, Proxy] = {}
        self._by_client_key: dict[int, tuple[Proxy, ...]] = {}
        self._drawn = _HIGHEST_DRAWN
        self._gone: dict[Proxy, tuple[ServedLink, Peer]] = {}

    def __len__(self) -> int:
        return len(self._by_key)

    def __iter__(self) -> Iterator[Proxy]:
        return iter(list(self._by_key.values()))

    def by_key(self, key: int) -> Proxy | None:
        """The client that the agent knows by that key (`ClientInfo.key`)."""
        return self._by_key.get(key)

    def sharing(self, client_key: int) -> tuple[Proxy, ...]:
        """The sessions that present that client key, oldest first; more than one only where the gate keeps sessions."""
        return self._by_client_key.get(client_key, ())

    def free_key(self, client_key: int) -> int:
        """A free key under which the agent can know one more session with that client key."""
        while client_key in self._by_key:
            client_key = self._drawn = self._drawn - 1 if self._drawn > _LOWEST_DRAWN else _HIGHEST_DRAWN
        return client_key

    def keyed(self, client_key: int, port: ServedLink, peer: Peer, *, anywhere: bool) -> Proxy | None:
        """The client with that key if its session carries the key in every header, and it has not gone.

        With `anywhere` the address does not matter.

        DEVIATION: the genuine agent takes such packets for sessions without keys, too; anybody who knows a key could
        then speak for its owner from any address.
        """
        for proxy in self._by_client_key.get(client_key, ()):
            if proxy.gone is None and _has_key_in_headers(proxy) and (anywhere or proxy.place == (port, peer)):
                return proxy
        return None

    def place(self, proxy: Proxy, port: ServedLink, peer: Peer) -> None:
        """Enter a client, or move it to another address; no client has the old one any more."""
        self._leave_place(proxy)
        self._forget_gone(proxy)
        info = proxy.info
        self._by_key[info.key] = proxy
        client_key = info.client_key
        sharing = self._by_client_key.get(client_key)
        if sharing is None:
            self._by_client_key[client_key] = (proxy,)
        elif proxy not in sharing:
            self._by_client_key[client_key] = (*sharing, proxy)
        proxy.place = (port, peer)
        port.members[proxy] = peer
        if not _has_key_in_headers(proxy):
            port.clients[peer] = proxy
            port.gone.pop(peer, None)
        else:
            port.keyed[peer] = port.keyed.get(peer, 0) + 1

    def set_gone(self, proxy: Proxy) -> None:
        """Note that its peer has gone: the client has no address any more, and packets for it wait."""
        place = proxy.place
        assert place is not None
        self._leave_place(proxy)
        self._gone[proxy] = place
        port, peer = place
        port.gone.setdefault(peer, []).append(proxy)
        proxy.is_blocked = True

    def remove(self, proxy: Proxy) -> bool:
        """Forget a client; False when it was not known."""
        info = proxy.info
        if self._by_key.get(info.key) is not proxy:
            return False
        self._leave_place(proxy)
        self._forget_gone(proxy)
        del self._by_key[info.key]
        client_key = info.client_key
        sharing = self._by_client_key.pop(client_key)
        if len(sharing) > 1:
            self._by_client_key[client_key] = tuple(other for other in sharing if other is not proxy)
        return True

    def _forget_gone(self, proxy: Proxy) -> None:
        if self._gone and (place := self._gone.pop(proxy, None)) is not None:
            proxy.is_blocked = False
            port, peer = place
            others = [other for other in port.gone.pop(peer, ()) if other is not proxy]
            if others:
                port.gone[peer] = others

    def _leave_place(self, proxy: Proxy) -> None:
        place = proxy.place
        if place is not None:
            proxy.place = None
            port, peer = place
            del port.members[proxy]
            if not _has_key_in_headers(proxy):
                del port.clients[peer]
            elif port.keyed[peer] > 1:
                port.keyed[peer] -= 1
            else:
                del port.keyed[peer]
            if proxy.is_blocked:
                proxy.is_blocked = False
                del port.blocked[proxy]


def _has_key_in_headers(proxy: Proxy) -> bool:
    return proxy.session.session_id < SESSION_NONE
