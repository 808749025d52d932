"""What happened to each slot over time: states with their begin and reason, and the rhythm of the beats."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

from msbot.config import Blueprint, Library
from msbot.master import Master
from msbot.pnp import PartEvent, PartInfo
from msbot.recording.curves.curve import (
    ACK,
    BEAT,
    BUS,
    FRAMES,
    LATE,
    LATENCY,
    UNITS,
    Point,
    ack_curve,
    beat_curve,
    measured_unit,
    number_of,
    port_curve,
    setting_curve,
)
from msbot.recording.curves.curve_reader import units_of
from msbot.recording.recorder.measurements import Acks, Beats, Lateness
from msbot_agent.agent import Maximum
from msbot_web.live_values import HISTORY_S, LiveValues
from msbot_xrce.lazy import dataclass

KEPT_SPANS = 500
"""Of a lane; also lanes, of which those of parts without a slot give way first."""
MOST_SPANS = 4000
"""Of all lanes together: beyond that the oldest of the longest lane gives way."""
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
        """By lane; the one that changed last comes last."""
        self._slots: set[str] = set()
        """Lanes of slots."""
        self._count = 0
        self._beats = Beats()
        self._intervals: dict[str, deque[tuple[float, float]]] = {}
        """By slot: (when a beat came, seconds since the one before)."""

    def note(self, event: PartEvent) -> None:
        """Take a change; what the inventory calls. A note about a part, such as an error of its log, is none."""
        lane = event.slot or event.part
        spans = self._spans.get(lane, ())
        if spans and event.from_state is event.to_state and spans[-1].part == event.part:
            return
        kept = self._spans[lane] = self._spans.pop(lane, deque[Span]())
        kept.append(Span(event.at, event.to_state.value, event.part, event.reason))
        self._count += 1
        if event.slot:
            self._slots.add(lane)
        if len(self._spans) > KEPT_SPANS:
            oldest = next((one for one in self._spans if one not in self._slots), next(iter(self._spans)))
            self._slots.discard(oldest)
            self._count -= len(self._spans.pop(oldest))
        if len(kept) > KEPT_SPANS or self._count > MOST_SPANS:
            (kept if len(kept) > KEPT_SPANS else max(self._spans.values(), key=len)).popleft()
            self._count -= 1

    def poll(self, infos: Iterable[PartInfo], now: float) -> None:
        """Derive the intervals between beats from the inventory; to be called a few times a second."""
        for slot, at, seconds in self._beats.sample(infos, now):
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


# The curves of a robot that runs: what its ports say, its settings, and what is measured at the robot itself.
#
# What ports say is kept by `live`, all else here: settings when they change, beats when they come, the others a few
# times a second; five minutes of each. Older things are in the recorder's ring, see `past`.


MEASURE_S = 1.0
"""Period in which lateness, load and frames are noted."""
MOST_CHANGES = 500
"""Changes of one setting that are kept."""
KNOWN_S = 1.0
"""How long one look at what there is serves every page."""


@dataclass(frozen=True, slots=True)
class CurveFacts:
    """What is known of a curve besides its numbers."""

    unit: str = ""
    holds: bool = False
    """A value holds until the next one: a setting."""


class LiveCurves:
    """See the comment above.

    Args:
        master: the robot.
        blueprint: what it is at present.
        library: its part types.
        live: the values on its topics.
        timeline: its beats.
        load_percent: how busy its bus is; None: it has none.
        frames: how many frames there were on it.
        clock: the robot's clock.
    """

    def __init__(
        self,
        master: Master,
        *,
        blueprint: Callable[[], Blueprint],
        library: Callable[[], Library],
        live: LiveValues,
        timeline: Timeline,
        load_percent: Callable[[], float] | None,
        frames: Callable[[], int],
        clock: Callable[[], float],
    ) -> None:
        self._master = master
        self._blueprint = blueprint
        self._library = library
        self._live = live
        self._timeline = timeline
        self._load_percent = load_percent
        self._frames = frames
        self._clock = clock
        self._lateness = Lateness()
        self._latency = Maximum()
        master.agent.latency.on_delivery(self._latency.add)
        self._acks = Acks(master.agent)
        self._measured: dict[str, deque[Point]] = {}
        self._settings: dict[str, deque[Point]] = {}
        self._setting_kinds: dict[str, tuple[str, str]] = {}
        """Curve -> part number and setting, which say its unit."""
        self._versions: dict[str, int] = {}
        self._counted = (clock(), frames())
        self._known: tuple[float, Mapping[str, CurveFacts]] | None = None
        self._fields: dict[str, tuple[str, str]] = {}
        """Curve -> topic and field, of what ports say."""

    async def measure(self) -> None:
        """Measure how late the event loop is, until cancelled."""
        await self._lateness.run()

    def sample(self, infos: Sequence[PartInfo]) -> None:
        """Note what is so now; to be called a few times a second with all parts."""
        now = self._clock()
        self._look_at_settings(infos, now)
        at, count = self._counted
        if now - at >= MEASURE_S:
            self._counted = (now, self._frames())
            self._note(LATE, now, self._lateness.take_ms())
            latency_ms = self._latency.take_ms()
            if latency_ms is not None:
                self._note(LATENCY, now, latency_ms)
            for slot, ms in self._acks.sample(infos):
                self._note(ack_curve(slot), now, ms)
            for name in [name for name, points in self._measured.items() if now - points[-1][0] > HISTORY_S]:
                del self._measured[name]  # of a slot that is empty or gone
            if self._load_percent is not None:
                self._note(BUS, now, self._load_percent())
                self._note(FRAMES, now, (self._counted[1] - count) / (now - at))

    def known(self) -> Mapping[str, CurveFacts]:
        """Every curve there is, in the order in which people look for them."""
        now = self._clock()
        if self._known is None or now - self._known[0] >= KNOWN_S:
            self._known = (now, dict(self._all()))
        return self._known[1]

    def points_after(self, name: str, after: float) -> list[Point]:
        """The points of a curve that are later than a time of the robot's clock, oldest first.

        Of a setting also the one before, which still held then.
        """
        if name in self._fields:
            return self._live.points_after(*self._fields[name], after)
        if name.startswith(BEAT):
            return _later(self._timeline.beats(name.removeprefix(BEAT)), after)
        if name in self._settings:
            points = self._settings[name]
            held = [point for point in points if point[0] <= after][-1:]
            return [*held, *_later(points, after)]
        return _later(self._measured.get(name, ()), after)

    def _all(self) -> Iterator[tuple[str, CurveFacts]]:
        unit_of = units_of(self._library())
        self._fields = {}
        for binding in self._blueprint().bindings:
            watch = self._live.topic(binding.topic)
            for field in {} if watch is None else self._live.numbers(watch):
                for end in (binding.source, *binding.targets):
                    if end.slot:
                        name = port_curve(end.slot, end.port, field)
                        self._fields[name] = (binding.topic, field)
                        yield name, CurveFacts(unit_of(binding.type_name, field))
        for name, (number, setting) in self._setting_kinds.items():
            yield name, CurveFacts(unit_of(f":{number}", setting), holds=True)
        for name in UNITS:
            if name in self._measured:
                yield name, CurveFacts(measured_unit(name))
        for slot in self._timeline.with_beats():
            yield beat_curve(slot), CurveFacts(measured_unit(beat_curve(slot)))
        for name in self._measured:
            if name.startswith(ACK):
                yield name, CurveFacts(measured_unit(name))

    def _look_at_settings(self, infos: Sequence[PartInfo], now: float) -> None:
        inventory = self._master.inventory
        here = set()
        for info in infos:
            held = inventory.configuration_of(info.client_key) if info.slot and info.state.is_registered else None
            if held is None:
                continue
            here.add(held.slot)
            if self._versions.get(held.slot) == held.version:
                continue
            self._versions[held.slot] = held.version
            for name, text in held.settings:
                number = number_of(text)
                curve = setting_curve(held.slot, name)
                if number is not None:
                    self._setting_kinds[curve] = (info.part_number, name)
                    points = self._settings.setdefault(curve, deque(maxlen=MOST_CHANGES))
                    if not points or points[-1][1] != number:
                        points.append((now, number))
        for slot in self._versions.keys() - here:
            if self._blueprint().slot(slot) is None:  # it was taken out of the robot
                del self._versions[slot]
                for curve in [one for one in self._settings if one.startswith(f"{slot}:")]:
                    del self._settings[curve], self._setting_kinds[curve]

    def _note(self, name: str, at: float, value: float) -> None:
        points = self._measured.setdefault(name, deque())
        points.append((at, value))
        while at - points[0][0] > HISTORY_S:
            points.popleft()


def _later(points: deque[Point] | tuple[Point, ...], after: float) -> list[Point]:
    found: list[Point] = []
    for point in reversed(points):
        if point[0] <= after:
            break
        found.append(point)
    found.reverse()
    return found
