"""Whether packets overtake each other on their way from a stock client, and by how much.

Why it matters: an ACKNACK that is overtaken by a higher one empties the whole history of a stock client (seen on the
wire). What was under way and lost at that moment can never be sent again. So an agent that knows that its network
reorders must leave time between two ACKNACKs of which the second is higher.

How it is seen: a number that was missing when later ones had come is watched. Its client sends it once by itself, and
once for each ACKNACK that reports something missing, also for one that was under way when the number was first sent and
lost. If it comes more often than that, or before anything was reported, it had not been lost but overtaken, and the
time since its absence was noticed bounds how late it was. A network that doubles packets is taken for one that reorders
by a round trip; that costs little.
"""

from __future__ import annotations

from msbot_xrce.streams.receiving_in_order import ReliableInput
from msbot_xrce.streams.round_trip import RoundTrip

MEMORY_S = 30.0
"""How long after the last sign a network counts as one that reorders."""

MARGIN = 1.5
"""The longest delay that is expected, as a multiple of the longest that was seen."""

DELAY_MIN_S, DELAY_MAX_S = 0.005, 0.2

ASKED_MAX = 4
"""After more reports than that, how often a number came says little about how late it was."""

UNDER_WAY_MAX_S = 0.003
"""For a round trip a client may still answer a report with everything that it has sent by then. This is the most that
is allowed for, and what is taken while none is measured: with more, too little would be seen where much is lost."""

TICK_S = 0.0005
"""The shortest wait."""

WATCHED_MAX = 64
"""Numbers of one stream that are watched."""

_NEVER_YET = float("-inf")


class _Watched:
    """A number that was missing."""

    __slots__ = ("copies", "reports", "since")

    def __init__(self, since: float, reports: int) -> None:
        self.since = since
        self.reports = reports
        """How many reports the stream had sent by then, those that were still under way left out."""
        self.copies = 0


class ReorderingDetector:
    """What is known of one session's network."""

    __slots__ = ("_numbers", "_round_trip", "delay_s", "until")

    def __init__(self, round_trip: RoundTrip) -> None:
        self._round_trip = round_trip
        self.delay_s = 0.0
        """How late a packet may be that another one has overtaken; of use while `is_seen`."""
        self.until = _NEVER_YET
        """When the network stops counting as one that reorders; read-only."""
        self._numbers: dict[int, dict[int, _Watched]] = {}

    def is_seen(self, now: float) -> bool:
        """Whether a packet was overtaken of late."""
        return now < self.until

    def note(self, stream_id: int, stream: ReliableInput, number: int, now: float) -> None:
        """A message comes; call this before the stream takes it, if it is not simply the next one."""
        numbers = self._numbers.get(stream_id)
        if numbers is not None and (watched := numbers.get(number)) is not None:
            watched.copies += 1
            asked = stream.reports_on(number) - watched.reports
            if watched.copies > asked and asked <= ASKED_MAX:
                late_s = now - watched.since
                if late_s >= TICK_S:  # what is read in one burst is answered by one ACKNACK
                    self._see(late_s, now)
        if number != (stream.announced + 1) & 0xFFFF:  # as it is after a gap, for one message after the other
            self.announced(stream_id, stream, (number - 1) & 0xFFFF, now)

    def announced(self, stream_id: int, stream: ReliableInput, last: int, now: float) -> None:
        """Messages up to that number must have been sent; those that have not come are watched."""
        ahead = (last - stream.announced) & 0xFFFF
        if not 0 < ahead <= WATCHED_MAX:
            return
        numbers = self._numbers.setdefault(stream_id, {})
        known_s = self._round_trip.smoothed_s
        under_way_s = UNDER_WAY_MAX_S if known_s is None else min(known_s, UNDER_WAY_MAX_S)
        reports = stream.reports - stream.reports_since(now - under_way_s)
        for index in range(ahead):
            numbers[(last - index) & 0xFFFF] = _Watched(now, reports)
        while len(numbers) > WATCHED_MAX:
            del numbers[next(iter(numbers))]

    def unripe(self, stream_id: int, stream: ReliableInput, now: float) -> tuple[frozenset[int], float | None]:
        """The missing numbers that may only be late, and when the first of them counts as lost."""
        since = now - self.delay_s
        young = {
            number: watched.since
            for number, watched in self._numbers.get(stream_id, {}).items()
            if watched.since > since and 0 < (number - stream.last_handled) & 0xFFFF < WATCHED_MAX
        }
        return frozenset(young), max(min(young.values()) + self.delay_s, now + TICK_S) if young else None

    def clear(self) -> None:
        """The streams start over; the network stays what it is."""
        self._numbers.clear()

    def _see(self, late_s: float, now: float) -> None:
        delay_s = min(max(MARGIN * late_s, DELAY_MIN_S), DELAY_MAX_S)
        self.delay_s = max(delay_s, self.delay_s) if now < self.until else delay_s
        self.until = now + MEMORY_S
