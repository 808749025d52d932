"""When a socket's strangers send more than can be read, and which of them are heard then. Pure: time is handed in.

How it works. Who has a session is known, and is always heard. The datagrams of everybody else are counted a few times
a second. While they are few, all are read. More than `FLOOD_PER_S` of them are a flood, and from then on

* strangers are heard in turns: a hash of the address (without the port: a client may ask from ever new ones) puts each
  of them into one of several groups, and each group has its turn of `TURN_S`, one after the other. There are as many
  groups as it takes for a turn to bring no more than `READ_PER_S`. So a newcomer waits for one round of turns at most,
  from however many addresses the flood comes;
* should a turn bring more all the same, because few addresses send most, only a part of it is read, by chance;
* of what is read, only an address that was heard before, `AGAIN_S` ago or earlier, is answered: clients ask again, and
  a flood from ever new addresses does not.

The groups and the chance are what a filter in the kernel can decide, where a datagram costs least
(`msbot_agent.link.net.stranger_filter`). When fewer than `CALM_PER_S` have come for `CALM_S`, it is over.
"""

from __future__ import annotations

import math
from collections.abc import Hashable

from msbot_xrce.common.lazy_dataclass import dataclass

LOOK_S = 0.25
"""Time between two looks at the counts."""
FLOOD_PER_S = 1500.0
"""Datagrams of strangers a second that are a flood; a thousand parts that are switched on at once send fewer."""
CALM_PER_S = 500.0
CALM_S = 2.0
READ_PER_S = 3000.0
"""Datagrams of strangers a second that are read during a flood; one that is not answered costs some microseconds."""
TURN_S = 2.25
"""As long as two attempts of a micro-ROS client to log in, which are a second apart, and its first answers."""
MOST_TURNS = 16
CHANCES = 256
"""A chance is so many of these."""
AGAIN_S = 0.03
"""A flood that sends everything twice shall not pass."""
MOST_HEARD = 16384
"""Addresses that are remembered as heard; then those heard longest ago are forgotten, half of them at once."""


@dataclass(frozen=True, slots=True)
class StrangersHeard:
    """Which strangers are heard now."""

    turns: int
    """Groups of addresses."""
    turn: int
    """The group that is heard, counted from 0."""
    chance: int
    """Of `CHANCES` datagrams of that group, so many are read."""


class FloodWatch:
    """See the module's docstring."""

    def __init__(self) -> None:
        self.admission: StrangersHeard | None = None
        """Who is heard; None: everybody, it is calm."""
        self.per_s = 0.0
        """How many datagrams a second came from strangers at the latest look."""
        self._looked_at: float | None = None
        self._turn_ends_at = 0.0
        self._calm_since: float | None = None
        self._usual = 0.0
        """The rate of the flood, smoothed: what comes in differs from turn to turn."""
        self._heard: dict[Hashable, float] = {}
        self._heard_before: dict[Hashable, float] = {}

    def look(self, read: int, dropped: int, now: float) -> StrangersHeard | None:
        """Take the counts since the last look into account; returns who is heard from now on.

        Args:
            read: datagrams of strangers that were read.
            dropped: those that the kernel has dropped.
            now: seconds.
        """
        since, self._looked_at = self._looked_at, now
        if since is None or now <= since:
            return self.admission
        self.per_s = (read + dropped) / (now - since)
        if self.admission is None:
            if self.per_s > FLOOD_PER_S:
                self._usual, self._calm_since = self.per_s, None
                self._begin_turn(0, now)
            return self.admission
        self._usual += (self.per_s - self._usual) / 4
        if self._is_over(now):
            self.admission = None
            self._heard, self._heard_before = {}, {}
        elif now >= self._turn_ends_at:
            self._begin_turn(self.admission.turn + 1, now)
        else:
            self._bound(read / (now - since))
        return self.admission

    def answers(self, origin: Hashable, now: float) -> bool:
        """Whether what a stranger at that address has sent during a flood, and was read, is answered."""
        at = self._heard.get(origin)
        if at is None:
            at = self._heard_before.get(origin)
            if len(self._heard) >= MOST_HEARD // 2:
                self._heard, self._heard_before = {}, self._heard
            self._heard[origin] = now if at is None else at
        return at is not None and now - at >= AGAIN_S

    def _begin_turn(self, turn: int, now: float) -> None:
        turns = min(MOST_TURNS, max(2, math.ceil(self._usual / READ_PER_S)))
        self.admission = StrangersHeard(turns, turn % turns, CHANCES)
        self._turn_ends_at = now + TURN_S

    def _bound(self, read_per_s: float) -> None:
        """Read less of this turn if it brings too much."""
        admission = self.admission
        assert admission is not None
        if read_per_s > 1.5 * READ_PER_S:
            chance = max(1, int(admission.chance * READ_PER_S / read_per_s))
            self.admission = StrangersHeard(admission.turns, admission.turn, chance)

    def _is_over(self, now: float) -> bool:
        if self.per_s >= CALM_PER_S:
            self._calm_since = None
            return False
        if self._calm_since is None:
            self._calm_since = now
        return now - self._calm_since >= CALM_S
