"""Decides which connection to close when there are too many: first one that never sent anything, then an idle one."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator
from typing import Generic, Protocol, TypeVar

from msbot_agent.pace import SteadyRate

MAX_CONNECTIONS = 1024
"""Most connections of a server."""

MAX_OF_ADDRESS = 512
"""Most connections from one address."""

IDLE_S = 10.0
"""A connection that was silent for this long may make room for a newcomer."""


class OpenConnection(Protocol):
    """What is known of one connection."""

    heard_at: float | None
    """When its last whole packet came; None = none yet."""


C = TypeVar("C", bound=OpenConnection)


class ConnectionBudget(Generic[C]):
    """The connections of one server, by the address they come from."""

    def __init__(self, most: int = MAX_CONNECTIONS, of_address: int | None = None) -> None:
        self._most = most
        self._of_address = min(MAX_OF_ADDRESS, most) if of_address is None else of_address
        self._silent: dict[Hashable, dict[C, None]] = {}
        self._speaking: dict[Hashable, dict[C, None]] = {}
        self._count = 0
        self._looked_at = float("-inf")

    def __len__(self) -> int:
        return self._count

    def add(self, connection: C, address: Hashable) -> None:
        """Add an open connection, which has not sent anything yet."""
        self._silent.setdefault(address, {})[connection] = None
        self._count += 1

    def first_packet_received(self, connection: C, address: Hashable) -> None:
        """Note that its first packet has come."""
        if _discard(self._silent, address, connection):
            self._speaking.setdefault(address, {})[connection] = None

    def remove(self, connection: C, address: Hashable) -> None:
        """Remove a connection that has ended."""
        if _discard(self._silent, address, connection) or _discard(self._speaking, address, connection):
            self._count -= 1

    def is_full(self, address: Hashable) -> bool:
        """Whether a connection from there can only be accepted in place of another."""
        return self._count >= self._most or self._of(address) >= self._of_address

    def who_makes_room(self, address: Hashable, now: float) -> C | None:
        """The connection that gives way to another one from that address; None = the newcomer must go."""
        if self._of(address) >= self._of_address:
            return self._first(self._silent.get(address, ())) or self._idle(self._speaking.get(address, ()), now)
        # The address with most silent connections pays first: it is the most likely attacker.
        silent = max(self._silent.values(), key=len, default={})
        return self._first(silent) or self._idle(self._all_speaking(), now)

    def _of(self, address: Hashable) -> int:
        return len(self._silent.get(address, ())) + len(self._speaking.get(address, ()))

    def _all_speaking(self) -> Iterator[C]:
        for group in self._speaking.values():
            yield from group

    @staticmethod
    def _first(group: Iterable[C]) -> C | None:
        return next(iter(group), None)

    def _idle(self, group: Iterable[C], now: float) -> C | None:
        """The one that has been idle longest, if for long enough; searched for at most once a second."""
        if now - self._looked_at < 1.0:
            return None
        self._looked_at = now
        oldest = min(group, key=lambda connection: connection.heard_at or 0.0, default=None)
        return oldest if oldest is not None and now - (oldest.heard_at or 0.0) > IDLE_S else None


def _discard(groups: dict[Hashable, dict[C, None]], address: Hashable, connection: C) -> bool:
    group = groups.get(address)
    if group is None or connection not in group:
        return False
    del group[connection]
    if not group:
        del groups[address]
    return True


# Limits the packets and octets a second of one connection, with a reserve for bursts. Pure: time is handed in.
#
# Nothing is thrown away: a connection that sends more is read later, so that its own network slows it down.


PACKETS_S = 500.0
"""A part in a lesson sends 10 to 100 messages a second, and several fit into a packet."""
OCTETS_S = 256 * 1024.0
BURST_S = 1.0
"""The reserve, in seconds of both rates: there at first, and again after a rest."""


class ConnectionRateLimit:
    """Limits the packets and octets a second of one connection, with a reserve for bursts. Pure: time is handed in."""

    def __init__(self, packets_s: float = PACKETS_S, octets_s: float = OCTETS_S) -> None:
        self._packets = SteadyRate(packets_s, packets_s * BURST_S, most=1)
        self._octets = SteadyRate(octets_s, octets_s * BURST_S, most=1)

    def spend(self, octets: int, now: float) -> float:
        """Count a packet; returns for how many seconds nothing more may be read, 0 = go on."""
        self._packets.note(self, now)
        self._octets.note(self, now, octets)
        return max(self._packets.debt_s(self, now), self._octets.debt_s(self, now))
