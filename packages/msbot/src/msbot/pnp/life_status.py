"""The states of a part, the legal changes between them, and its life status (thesis 3.10.3, 3.12.1.2).

Theory of operation. A registered part sends a beat every `LifeTiming.beat_s`. Registration and every beat set its life
status to `LifeTiming.life`; a timer takes one off every `LifeTiming.tick_s`; at zero the part is delisted. The last
beat may fall anywhere between two ticks, so a silent part is delisted `(life - 1) x tick` to `life x tick` seconds
after its last
beat: 4 to 6 s with the thesis' numbers. Long before that, after `LifeTiming.late_s`, it is shown as late; it keeps its
rights until it is delisted.

DEVIATION: the thesis says "at zero" (3.10.3) and "after three missed in a row" (3.11), and its program counts from
4; here it is zero, counted from 3.
"""

from __future__ import annotations

from msbot.pnp.model import LifeTiming
from msbot.pnp.part_events import PartState
from msbot_xrce.errors import LocalProtocolError

_NEW, _CHECKING, _ACTIVE, _LATE = PartState.NEW, PartState.CHECKING, PartState.ACTIVE, PartState.LATE
_LOST, _REFUSED, _STANDBY, _LEFT = PartState.LOST, PartState.REFUSED, PartState.STANDBY, PartState.LEFT

TRANSITIONS: dict[tuple[PartState | None, PartState], str] = {
    (None, _NEW): "a session was opened",
    (_NEW, _CHECKING): "asks for the profile, or claims",
    (_CHECKING, _ACTIVE): "both steps done: the verdict is given",
    (_CHECKING, _STANDBY): "listed, but no slot is free or clear",
    (_CHECKING, _REFUSED): "unknown, blocked, duplicate, ...",
    (_ACTIVE, _LATE): "a beat was missed",
    (_LATE, _ACTIVE): "it beats again",
    (_LATE, _LOST): "life status 0",
    (_ACTIVE, _LOST): "seen to vanish, or replaced after a restart",
    (_ACTIVE, _CHECKING): "opened its session again",
    (_LATE, _CHECKING): "opened its session again",
    (_ACTIVE, _STANDBY): "a person took it out of its slot",
    (_LATE, _STANDBY): "a person took it out of its slot",
    (_ACTIVE, _REFUSED): "a person blocked it",
    (_LATE, _REFUSED): "a person blocked it",
    (_STANDBY, _REFUSED): "a person blocked it",
    (_STANDBY, _ACTIVE): "takes over a slot that fell free, or a person put it there",
    (_STANDBY, _CHECKING): "claims again, a slot is free",
    (_REFUSED, _CHECKING): "claims again, the reason is gone",
    (_LOST, _CHECKING): "claims again",
    (_CHECKING, _LOST): "silent before it finished",
    (_STANDBY, _LOST): "has stopped claiming",
    (_NEW, _LEFT): "session ended",
    (_CHECKING, _LEFT): "session ended",
    (_ACTIVE, _LEFT): "said goodbye",
    (_LATE, _LEFT): "said goodbye",
    (_STANDBY, _LEFT): "session ended",
    (_REFUSED, _LEFT): "session ended",
}
"""Every legal change and what brings it about, in a few words; None = the part was not there before."""


def check_transition(before: PartState | None, after: PartState) -> None:
    """Make sure that a change is in the table.

    Raises:
        LocalProtocolError: it is not in the table; a fault of the inventory, never of a part.
    """
    if (before, after) not in TRANSITIONS:
        was = "nothing" if before is None else before.value
        raise LocalProtocolError(f"a part cannot go from {was} to {after.value}")


class Life:
    """The life status of one part and its beats; pure counting, no clock.

    Args:
        timing: the periods, and the status that a beat restores.
    """

    __slots__ = ("beats", "last_beat_at", "status", "timing")

    def __init__(self, timing: LifeTiming) -> None:
        self.timing = timing
        self.status = 0
        """0 = not counted or dead, else 1 to `timing.life`."""
        self.beats = 0
        """Beats since the last registration."""
        self.last_beat_at: float | None = None
        """When it last registered or sent a beat."""

    def register(self, now: float) -> None:
        """Start counting: full life status, no beats yet."""
        self.beats = 0
        self.refresh(now)

    def beat(self, now: float) -> None:
        """Count one beat: full life status again."""
        self.beats += 1
        self.refresh(now)

    def refresh(self, now: float) -> None:
        """Full life status without counting a beat (a claim repeated while it waits)."""
        self.status = self.timing.life
        self.last_beat_at = now

    def tick(self) -> bool:
        """Take one off; True when that was the last one."""
        if self.status == 0:
            return False
        self.status -= 1
        return self.status == 0

    def end(self) -> None:
        """Stop counting: the part is delisted."""
        self.status = 0

    def silence_s(self, now: float) -> float:
        """Seconds since the last beat or registration; 0 before the first."""
        return 0.0 if self.last_beat_at is None else max(0.0, now - self.last_beat_at)

    def is_late(self, now: float) -> bool:
        """Whether a beat is missing."""
        return self.status > 0 and self.silence_s(now) > self.timing.late_s
