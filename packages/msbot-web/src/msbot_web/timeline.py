"""What happened to each slot over time: states with their begin and reason, and the rhythm of the beats."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

from msbot.pnp import PartEvent, PartInfo
from msbot.recording.curves.measuring import Beats
from msbot_xrce.common.lazy_dataclass import dataclass

KEPT_SPANS = 500
KEPT_BEATS = 300
SHOWN_BEATS = 60


@dataclass(frozen=True, slots=True)
class Span:
    """A state from one change to the next."""

    begin: float
    """Seconds of the robot's clock."""
    state: str
    part: str
    """Whose state it was, in words."""
    reason: str


class Timeline:
    """Collects the states of slots, and of parts without one."""

    def __init__(self) -> None:
        self._spans: dict[str, deque[Span]] = {}
        self._beats = Beats()
        self._intervals: dict[str, deque[tuple[float, float]]] = {}
        """By slot: (when a beat came, seconds since the one before)."""

    def note(self, event: PartEvent) -> None:
        """Take a change; what the inventory calls."""
        lane = event.slot or event.part
        spans = self._spans.setdefault(lane, deque(maxlen=KEPT_SPANS))
        spans.append(Span(event.at, event.to_state.value, event.part, event.reason))
        if len(self._spans) > KEPT_SPANS:
            del self._spans[next(iter(self._spans))]

    def look(self, infos: Iterable[PartInfo], now: float) -> None:
        """Derive the intervals between beats from the inventory; to be called a few times a second."""
        for slot, at, seconds in self._beats.look(infos, now):
            self._intervals.setdefault(slot, deque(maxlen=KEPT_BEATS)).append((at, seconds))

    def lanes(self) -> dict[str, tuple[Span, ...]]:
        """All spans by slot (or part without one), oldest first."""
        return {lane: tuple(spans) for lane, spans in self._spans.items()}

    def spans(self, lane: str) -> tuple[Span, ...]:
        """The spans of one slot."""
        return tuple(self._spans.get(lane, ()))

    def beat_intervals(self, slot: str) -> tuple[float, ...]:
        """Seconds between the latest beats of the part in a slot, oldest first."""
        return tuple(seconds for _, seconds in self._intervals.get(slot, ()))[-SHOWN_BEATS:]

    def beats(self, slot: str) -> tuple[tuple[float, float], ...]:
        """As `beat_intervals`, more of them, each with the time when the beat came."""
        return tuple(self._intervals.get(slot, ()))

    def with_beats(self) -> tuple[str, ...]:
        """The slots of whose parts beats have come."""
        return tuple(self._intervals)
