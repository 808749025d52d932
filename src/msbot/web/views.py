"""What pages and API show: the robot's objects turned into `models`, at the moment of asking."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from msbot.config import Binding, Blueprint, Library, Slot
from msbot.errors import ConfigError
from msbot.master import Master
from msbot.pnp import PartInfo
from msbot.web.bench import Bench
from msbot.web.frames import FrameRing, FrameRow
from msbot.web.live import Live
from msbot.web.models import (
    BusState,
    Control,
    FrameLine,
    Lane,
    PartLine,
    PortLine,
    Simulated,
    SlotCard,
    SpanLine,
    TopicLine,
    TypeLine,
)
from msbot.web.timeline import Timeline

ARRIVING = ("new", "checking", "refused", "standby")
"""States of parts that hold no slot and are there: they wait in the arrivals tray."""

HELD = ("active", "late")
"""States of slots that a part holds."""


class NotThere(ConfigError):
    """There is no slot, part, frame or type of that name."""


class BusMeter:
    """Where the figures of a CAN bus come from; all zero when there is none."""

    name = ""
    bitrate = 0

    def load_percent(self) -> float:
        """Share of the last second in which the bus was busy."""
        return 0.0

    def errors(self) -> int:
        """Error frames so far."""
        return 0


class Views:
    """Reads; changes nothing.

    Args:
        master: the robot.
        blueprint: what it is at present.
        library: what part numbers are.
        live: the values on its topics.
        frames: its CAN bus.
        timeline: its past.
        bench: its simulated parts.
        clock: the robot's clock.
        ignored: UIDs and names of parts that a person does not want to see among the arrivals.
    """

    def __init__(
        self, master: Master, *, blueprint: Callable[[], Blueprint], library: Library, live: Live, frames: FrameRing,
        timeline: Timeline, bench: Bench, clock: Callable[[], float], ignored: Callable[[PartInfo], bool],
        bus: BusMeter | None = None,
    ) -> None:  # fmt: skip
        self.live = live
        self.frames = frames
        self.library = library
        self.bench = bench
        self._master = master
        self._blueprint = blueprint
        self._timeline = timeline
        self._clock = clock
        self._ignored = ignored
        self._bus = bus or BusMeter()
        self._rate: tuple[float, int, float] = (clock(), 0, 0.0)

    def look(self) -> None:
        """Notice what only repeated looking shows (beat intervals, bound topics); a few times a second."""
        self._timeline.look(self._master.inventory.view(self._clock()), self._clock())
        self.live.watch(self._blueprint().topics())

    # Slots and parts

    def slots(self) -> list[SlotCard]:
        """All slots, in the order of the blueprint."""
        now, blueprint = self._clock(), self._blueprint()
        infos = {info.slot: info for info in self._master.inventory.view(now) if info.slot}
        here, ends = frozenset(self.bench.slots()), _ends_of(blueprint)
        return [
            self._card(slot, infos.get(slot.name), now, is_here=slot.name in here, ends=ends.get(slot.name, []))
            for slot in blueprint.slots
        ]

    def slot(self, name: str) -> SlotCard:
        """One slot.

        Raises:
            NotThere: there is no such slot.
        """
        self.check_slot(name)
        now, blueprint = self._clock(), self._blueprint()
        slot = blueprint.slot(name)
        assert slot is not None
        info = next((info for info in self._master.inventory.view(now) if info.slot == name), None)
        is_here = name in self.bench.slots()
        return self._card(slot, info, now, is_here=is_here, ends=_ends_of(blueprint).get(name, []))

    def check_slot(self, name: str) -> None:
        """Refuse a slot that is not there.

        Raises:
            NotThere: there is no such slot; the text lists those there are.
        """
        blueprint = self._blueprint()
        if blueprint.slot(name) is None:
            known = ", ".join(slot.name for slot in blueprint.slots) or "none"
            raise NotThere(f"there is no slot {name!r}; there are {known}")

    def parts(self) -> list[PartLine]:
        """All parts that are there or were there lately."""
        return [self._part(info) for info in self._master.inventory.view(self._clock())]

    def waiting(self) -> int:
        """How many parts are among the arrivals and not ignored."""
        infos = self._master.inventory.view(self._clock())
        return sum(info.state.value in ARRIVING and not self._ignored(info) for info in infos)

    def arrivals(self) -> list[PartLine]:
        """Parts that are there and hold no slot, the newest first; those a person ignores last."""
        lines = [part for part in self.parts() if part.state in ARRIVING]
        return sorted(reversed(lines), key=lambda part: part.ignored)

    def free_slots(self, part_number: str) -> list[SlotCard]:
        """The slots that no part holds: those first that the library says parts of this number can fill."""
        part_type = self.library.get(part_number)
        numbers = () if part_type is None else (part_type.number, *part_type.compatible_with)
        free = [card for card in self.slots() if card.state not in HELD]
        return sorted(free, key=lambda card: card.part_number not in numbers)

    def spares(self) -> list[str]:
        """Simulated parts that were made for no slot of the blueprint: no card shows them."""
        blueprint = self._blueprint()
        return [name for name in self.bench.slots() if blueprint.slot(name) is None]

    def why(self, part: str) -> list[str]:
        """In sentences: how a part stands and which rules led there."""
        return self._master.inventory.why(part, self._clock())

    def beat_intervals(self, slot: str) -> list[float]:
        """Seconds between the latest beats."""
        return list(self._timeline.beat_intervals(slot))

    # Simulated parts

    def simulated(self, slot: str) -> Simulated:
        """A simulated part's controls and readings.

        Raises:
            NotThere: no part of that slot runs here.
        """
        if slot not in self.bench.slots():
            known = ", ".join(self.bench.slots()) or "none"
            raise NotThere(f"no part of slot {slot!r} is simulated here; those that are: {known}")
        controls: list[Control] = list(self.bench.controls(slot))
        return Simulated(
            slot=slot,
            plugged=self.bench.is_plugged(slot),
            controls=controls,
            readings=dict(self.bench.readings(slot)),
        )

    # Topics, bus, past

    def topics(self) -> list[TopicLine]:
        """All bound topics."""
        now = self._clock()
        lines = []
        for binding in self._blueprint().bindings:
            watch = self.live.topic(binding.topic)
            lines.append(
                TopicLine(
                    topic=binding.topic,
                    type_name=binding.type_name,
                    publishers=[str(binding.source)],
                    subscribers=[str(target) for target in binding.targets],
                    rate_hz=0.0 if watch is None else watch.rate_hz(now),
                    count=0 if watch is None else watch.count,
                    fields={} if watch is None else self.live.fields(watch),
                )
            )
        return lines

    def bus(self) -> BusState:
        """How busy the bus is."""
        now, total = self._clock(), self.frames.total
        at, before, rate = self._rate
        if now - at >= 1.0:
            rate = (total - before) / (now - at)
            self._rate = (now, total, rate)
        return BusState(
            watched=bool(self._bus.name),
            name=self._bus.name,
            bitrate=self._bus.bitrate,
            frames=total,
            load_percent=self._bus.load_percent(),
            frames_per_second=rate,
            errors=self._bus.errors(),
        )

    def frame_lines(self, after: int, limit: int) -> list[FrameLine]:
        """The newest frames with a number above `after`, oldest first."""
        now = self._clock()
        return [_frame_line(row, now) for row in self.frames.rows(after, limit)]

    def frame_line(self, number: int) -> FrameLine | None:
        """One frame by its number, or None when it is no longer kept."""
        row = self.frames.row(number)
        return None if row is None else _frame_line(row, self._clock())

    def timeline(self) -> list[Lane]:
        """The states of every slot over time."""
        now = self._clock()
        lanes = self._timeline.lanes()
        order = [slot.name for slot in self._blueprint().slots]
        # A part without a slot has a lane as long as it waits; what it did before it got a slot stands in the journal.
        waiting = {part.part for part in self.parts() if part.state in ARRIVING}
        names = [*order, *(name for name in lanes if name not in order and name in waiting)]
        result = []
        for name in names:
            spans = lanes.get(name, ())
            ends = [*(span.begin for span in spans[1:]), now] if spans else []
            result.append(
                Lane(
                    slot=name,
                    spans=[
                        SpanLine(
                            begin_age_s=now - span.begin,
                            end_age_s=now - end,
                            state=span.state,
                            part=span.part,
                            reason=span.reason,
                        )
                        for span, end in zip(spans, ends, strict=True)
                    ],
                )
            )
        return result

    def types(self, search: str = "") -> list[TypeLine]:
        """The part library; with words, only what fits all of them."""
        wanted = search.casefold().split()
        lines = []
        for entry in self.library:
            text = " ".join((entry.number, entry.name, entry.manufacturer, entry.description)).casefold()
            if all(word in text for word in wanted):
                lines.append(
                    TypeLine(
                        number=entry.number,
                        name=entry.name,
                        manufacturer=entry.manufacturer,
                        description=entry.description,
                        category=entry.category.value,
                        ports=[port.name for port in entry.ports],
                    )
                )
        return sorted(lines, key=lambda line: line.name)

    # Helpers

    def _card(
        self, slot: Slot, info: PartInfo | None, now: float, *, is_here: bool, ends: Sequence[_End]
    ) -> SlotCard:  # fmt: skip
        part_type = self.library.get(slot.part)
        beat_s = self._master.inventory.timing.beat_s
        is_counted = info is not None and info.state.is_registered and info.beat_age_s is not None
        return SlotCard(
            name=slot.name,
            part_number=slot.part,
            type_name="" if part_type is None else part_type.name,
            category="" if part_type is None else part_type.category.value,
            description=slot.description,
            state="empty" if info is None else info.state.value,
            reason="nothing is plugged in" if info is None else info.reason,
            part=None if info is None else self._part(info),
            ports=[self._port(end, now) for end in ends],
            next_beat_s=beat_s - info.beat_age_s
            if is_counted and info is not None and info.beat_age_s is not None
            else None,
            simulated=is_here,
            plugged=self.bench.is_plugged(slot.name) if is_here else None,
        )

    def _port(self, end: _End, now: float) -> PortLine:
        binding = end.binding
        watch = self.live.topic(binding.topic)
        return PortLine(
            port=end.port,
            topic=binding.topic,
            type_name=binding.type_name,
            publishes=end.publishes,
            reliable=binding.reliable,
            rate_hz=0.0 if watch is None else round(watch.rate_hz(now), 2),
            count=0 if watch is None else watch.count,
            age_s=None if watch is None or watch.at is None else now - watch.at,
            fields={} if watch is None else self.live.fields(watch),
        )

    def _part(self, info: PartInfo) -> PartLine:
        return PartLine(
            part=info.part,
            part_number=info.part_number,
            local_name=info.local_name,
            uid=info.uid.hex(),
            slot=info.slot or "",
            state=info.state.value,
            reason=info.reason,
            state_age_s=info.state_age_s,
            life=info.life,
            beat_age_s=info.beat_age_s,
            beats=info.beats,
            plug_in_to_active_ms=info.plug_in_to_active_ms,
            client_key=f"{info.client_key:08x}",
            address=info.address,
            refused_claims=info.refused_claims,
            duplicates=list(info.duplicates),
            ignored=self._ignored(info),
        )


@dataclass(frozen=True, slots=True)
class _End:
    """A slot's end of a binding."""

    binding: Binding
    port: str
    publishes: bool


def _ends_of(blueprint: Blueprint) -> Mapping[str, list[_End]]:
    """The ends of all bindings by slot, in the order of the blueprint."""
    found: dict[str, list[_End]] = {}
    for binding in blueprint.bindings:
        found.setdefault(binding.source.slot, []).append(_End(binding, binding.source.port, publishes=True))
        for target in binding.targets:
            found.setdefault(target.slot, []).append(_End(binding, target.port, publishes=False))
    return found


def _frame_line(row: FrameRow, now: float) -> FrameLine:
    return FrameLine(
        number=row.number,
        age_s=max(now - row.at, 0.0),
        sender=row.sender,
        text=row.text,
        node=row.node,
        words=list(row.words),
    )
