"""Whether the heartbeats of a node id go on as they did: else another device may have its id. Pure.

A device that takes over a node id within the time after which a silent node is lost would otherwise be taken for the
one before. A heartbeat of DroneCAN and Cyphal has the seconds since the start and a number that counts transfers; both
go on by what has passed, and no heartbeat is missing. One that does not fit proves nothing, as frames may be lost: it
is a reason to ask again who is there.
"""

from __future__ import annotations

from typing import Final

UPTIME_SLACK_S: Final = 1.5
"""Seconds since the start are whole ones; and a busy computer hears late."""
GAP: Final = 1.5
"""A heartbeat that comes so many periods after the one before may be of another device."""
LEAST_GAP_S: Final = 0.3
NUMBERS: Final = 32
"""Transfers are counted modulo this."""


class Heartbeats:
    """Those of one node id."""

    def __init__(self) -> None:
        self._at: float | None = None
        self._uptime_s = self._number = 0
        self._period_s: float | None = None

    def fits(self, uptime_s: int, number: int, now: float) -> bool:
        """A heartbeat has come: whether it can be the next of the same device.

        Args:
            uptime_s: since its start, as it says.
            number: of the transfer.
            now: in seconds.
        """
        before, self._at = self._at, now
        uptime_before, self._uptime_s = self._uptime_s, uptime_s
        number_before, self._number = self._number, number
        if before is None:
            return True
        passed = now - before
        goes_on = (
            (number - number_before) % NUMBERS == 1
            and abs(uptime_s - uptime_before - passed) <= UPTIME_SLACK_S
            and (self._period_s is None or passed <= max(LEAST_GAP_S, GAP * self._period_s))
        )
        self._period_s = passed if self._period_s is None or passed < self._period_s else self._period_s
        self._period_s += 0.1 * (passed - self._period_s) if goes_on else 0.0
        return goes_on
