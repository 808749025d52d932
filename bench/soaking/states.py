"""Whether a robot says of its parts what is true: states, STOP, settings, within bounded times. Pure, as `oracle.py`.

1. A part that runs and with which nothing is wrong is active in its slot within `ACTIVE_S` (bus: `ACTIVE_ON_BUS_S`).
2. A part that is dead, cut off or put out is not shown as active or late after `GONE_S`.
3. STOP and GO reach everybody with whom nothing is wrong within `TOLD_S`; STOP holds until GO, whatever happens.
4. A setting that was acknowledged is with its part within `TOLD_S`.
5. The page answers while nothing is wrong with the master.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

ACTIVE_S = 12.0
ACTIVE_ON_BUS_S = 20.0
GONE_S = 10.0
TOLD_S = 6.0
ALIVE_S = 6.0


@dataclass(slots=True)
class Expected:
    """What the script knows of one part."""

    uid: str
    on_bus: bool = False
    absent: float | None = None
    """Since when it cannot be in its slot: dead, cut off, or put out; None: it can."""
    may_return: bool = False
    """A person took it out of its slot: it comes back by itself in a new session only."""
    note: tuple[str, float] | None = None
    """The setting that was acknowledged last, and when; None: nobody knows for certain."""
    told_note: str = ""
    """What its process was told."""
    told_stop: bool = False
    joined: float | None = None
    """Since when its process is active, as it says."""


class StateOracle:
    """Rules 1 to 5; says each violation once until it is over.

    Args:
        clear_since: since when nothing is wrong with that slot; None: something is.
        complain: is told time, rule and words.
    """

    def __init__(self, clear_since: Callable[[str], float | None], complain: Callable[[float, str, str], None]) -> None:
        self.parts: dict[str, Expected] = {}
        self.stop: tuple[bool, float] | None = (False, 0.0)
        """Whether STOP holds, and since when; None: nobody knows for certain."""
        self._clear_since, self._complain = clear_since, complain
        self._said: set[tuple[str, str]] = set()

    def shown(self, now: float, slots: Mapping[str, tuple[str, str]], *, stopped: bool, master_since: float) -> None:
        """The page has answered: for each slot state and UID; the master serves since then."""
        for slot, part in self.parts.items():
            state, uid = slots.get(slot, ("missing", ""))
            clear = self._clear_since(slot)
            long = ACTIVE_ON_BUS_S if part.on_bus else ACTIVE_S
            due = part.absent is None and clear is not None and now - max(clear, master_since) > long
            words = f"{slot} should be active with {part.uid} for {long:g} s, and is shown as {state} {uid}"
            self._judge(now, "state", slot, due and (state, uid) != ("active", part.uid), words)
            gone = part.absent is not None and now - max(part.absent, master_since) > GONE_S
            self._judge(
                now,
                "gone",
                slot,
                gone and state in ("active", "late") and uid == part.uid,
                f"{slot} has been away for more than {GONE_S:g} s, and is shown as {state}",
            )
        if self.stop is not None:
            wrong = stopped != self.stop[0] and now - max(self.stop[1], master_since) > 1.0
            self._judge(now, "stop", "master", wrong, f"the robot says stopped = {stopped}, the script {self.stop[0]}")

    def check(self, now: float) -> None:
        """What the parts themselves have been told by now."""
        for slot, part in self.parts.items():
            clear = self._clear_since(slot)
            if clear is None or part.joined is None:
                continue
            since = max(clear, part.joined)
            if self.stop is not None:
                due = now - max(since, self.stop[1]) > TOLD_S
                self._judge(
                    now,
                    "stop",
                    slot,
                    due and part.told_stop != self.stop[0],
                    f"{slot}: stopped is {part.told_stop}, should be {self.stop[0]}",
                )
            if part.note is not None:
                due = now - max(since, part.note[1]) > TOLD_S
                self._judge(
                    now,
                    "setting",
                    slot,
                    due and part.told_note != part.note[0],
                    f"{slot} has the setting {part.told_note!r}, should have {part.note[0]!r}",
                )

    def page(self, now: float, trouble: str, clear: float | None) -> None:
        """The page was asked: what was wrong with its answer (empty: nothing); since when the master is well."""
        due = bool(trouble) and clear is not None and now - clear > ALIVE_S
        self._judge(now, "page", "page", due, trouble)

    def _judge(self, now: float, rule: str, whom: str, wrong: bool, words: str) -> None:
        if not wrong:
            self._said.discard((rule, whom))
        elif (rule, whom) not in self._said:
            self._said.add((rule, whom))
            self._complain(now, rule, words)
