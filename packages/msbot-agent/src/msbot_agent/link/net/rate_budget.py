"""Limits the packets and octets a second from one connection, with a reserve for bursts. Pure: time is handed in.

Nothing is thrown away: a connection that sends more is read later, so that its own network slows it down.
"""

from __future__ import annotations

PACKETS_S = 500.0
"""A part in a lesson sends 10 to 100 messages a second, and several fit into a packet."""
OCTETS_S = 256 * 1024.0
BURST_S = 1.0
"""The reserve, in seconds of both rates: there at first, and again after a rest."""


class RateBudget:
    """See the module's docstring."""

    def __init__(self, now: float, packets_s: float = PACKETS_S, octets_s: float = OCTETS_S) -> None:
        self._packets_s = packets_s
        self._octets_s = octets_s
        self._packets = packets_s * BURST_S
        self._octets = octets_s * BURST_S
        self._at = now

    def spend(self, octets: int, now: float) -> float:
        """Count a packet; returns for how many seconds nothing more may be read, 0 = go on."""
        passed, self._at = max(0.0, now - self._at), now
        self._packets = min(self._packets_s * BURST_S, self._packets + passed * self._packets_s) - 1
        self._octets = min(self._octets_s * BURST_S, self._octets + passed * self._octets_s) - octets
        return max(0.0, -self._packets / self._packets_s, -self._octets / self._octets_s)
