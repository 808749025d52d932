"""Whether an event loop that was given something pauses before it looks again, so that more comes with one look.

To fall asleep, to be woken and to look cost a process as much as several datagrams. Where these come one by one at a
steady rate, a short pause after each look finds a few of them together: network interfaces moderate their interrupts in
the same way. Where the next datagram is the answer to the last one, a pause finds no more and slows everything down. No
datagram says which it is, so a pause is tried: it stays if at least two come with a look and no fewer in all, and
otherwise the next try comes later, each time twice as late. Now and then the loop does without, to learn what comes by
itself. Pure: no clock, no socket.
"""

from __future__ import annotations

from enum import Enum, auto

LONGEST_S = 0.0002
"""The longest pause of an agent: an answer may come so much later."""
SHORTEST_S = 0.0001
"""The kernel rounds shorter pauses up to this, more or less."""
WORTH = 2.0
"""How many datagrams a pause is meant to gather: with fewer to a look it costs more than it saves."""
PLENTY = 3.0
"""With so many to a look without a pause none is tried."""
SAME_RATE = 0.75
"""The part of the rate before that counts as the same: the rest is chance."""
FAR_LESS = 0.5
"""With less than this part the first looks of a try end it."""

_PLAIN_TURNS, _FIRST_TURNS, _TRIAL_TURNS, _KEPT_TURNS = 64, 4, 16, 64
"""Looks after which it is judged: without a pause, at the beginning of a try and at its end, and afterwards."""
LONGEST_TURNS_S = 0.1
"""It is judged after this time, too."""
FIRST_BACKOFF_S, LAST_BACKOFF_S = 0.05, 5.0
"""How long after a try in vain the next one comes, at first and at last."""
KEPT_S = 1.0
"""After this time with pauses it is measured again what comes without."""


class _State(Enum):
    PLAIN = auto()
    TRIED = auto()
    PROVEN = auto()


_PLAIN, _TRIED, _PROVEN = _State.PLAIN, _State.TRIED, _State.PROVEN


class Gathering:
    """The pauses of one event loop."""

    __slots__ = (
        "_backoff_s",
        "_before",
        "_judge_at",
        "_longest_s",
        "_not_before",
        "_since",
        "_state",
        "_taken",
        "_turns",
        "_until",
        "_wanted_turns",
        "delay_s",
    )

    def __init__(self, longest_s: float = LONGEST_S) -> None:
        """`longest_s`: the longest pause, seconds; 0 = none is ever made."""
        self.delay_s = 0.0
        """The pause before the next look, seconds."""
        self._longest_s = longest_s
        self._state = _PLAIN
        self._before = 0.0  # the rate without a pause, per second
        self._backoff_s = FIRST_BACKOFF_S
        self._not_before = 0.0
        self._until = 0.0
        self._turns = self._taken = 0
        self._wanted_turns = _PLAIN_TURNS
        self._since: float | None = None
        self._judge_at = 0.0

    def turn(self, now: float, taken: int) -> float:
        """A look has found so much, and it was taken; returns the pause before the next look, seconds."""
        self._turns += 1
        self._taken += taken
        if self._turns >= self._wanted_turns or now >= self._judge_at:
            self._judge(now)
        return self.delay_s

    def _judge(self, now: float) -> None:
        since = self._since
        if since is None or now <= since:
            self._begin(now, _PLAIN_TURNS)
            return
        rate, each = self._taken / (now - since), self._taken / self._turns
        if self._state is _PLAIN:
            self._judge_plain(now, rate, each)
        elif self._wanted_turns == _FIRST_TURNS and rate >= FAR_LESS * self._before:
            self._wanted_turns = _TRIAL_TURNS  # the first looks count with the others
        elif each < WORTH or rate < SAME_RATE * self._before:
            self._give_up(now)
        elif self._state is _TRIED:
            self._state, self._backoff_s, self._until = _PROVEN, FIRST_BACKOFF_S, now + KEPT_S
            self._begin(now, _KEPT_TURNS)
        elif now >= self._until:
            self._state, self.delay_s = _PLAIN, 0.0
            self._begin(now, _PLAIN_TURNS)
        else:
            self._begin(now, _KEPT_TURNS)

    def _judge_plain(self, now: float, rate: float, each: float) -> None:
        if now >= self._not_before and each < PLENTY and rate * self._longest_s >= WORTH:
            self._state, self._before = _TRIED, rate
            self.delay_s = min(max(WORTH / rate, SHORTEST_S), self._longest_s)
            self._begin(now, _FIRST_TURNS)
        else:
            self._begin(now, _PLAIN_TURNS)

    def _give_up(self, now: float) -> None:
        self._state, self.delay_s = _PLAIN, 0.0
        self._not_before = now + self._backoff_s
        self._backoff_s = min(2 * self._backoff_s, LAST_BACKOFF_S)
        self._begin(now, _PLAIN_TURNS)

    def _begin(self, now: float, turns: int) -> None:
        self._turns = self._taken = 0
        self._wanted_turns, self._since, self._judge_at = turns, now, now + LONGEST_TURNS_S
