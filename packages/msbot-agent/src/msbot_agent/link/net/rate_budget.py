"""Limits the packets and octets a second from one connection, with a reserve for bursts. Pure: time is handed in.

Nothing is thrown away: a connection that sends more is read later, so that its own network slows it down.
"""

from __future__ import annotations

from msbot_agent.pace.steady_rate import SteadyRate

PACKETS_S = 500.0
"""A part in a lesson sends 10 to 100 messages a second, and several fit into a packet."""
OCTETS_S = 256 * 1024.0
BURST_S = 1.0
"""The reserve, in seconds of both rates: there at first, and again after a rest."""


class RateBudget:
    """See the module's docstring."""

    def __init__(self, packets_s: float = PACKETS_S, octets_s: float = OCTETS_S) -> None:
        self._packets = SteadyRate(packets_s, packets_s * BURST_S, most=1)
        self._octets = SteadyRate(octets_s, octets_s * BURST_S, most=1)

    def spend(self, octets: int, now: float) -> float:
        """Count a packet; returns for how many seconds nothing more may be read, 0 = go on."""
        self._packets.note(self, now)
        self._octets.note(self, now, octets)
        return max(self._packets.debt_s(self, now), self._octets.debt_s(self, now))
