"""What pages and API show: the robot's objects turned into `models` on request."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence

from msbot.config import Blueprint, Library
from msbot.master import Master
from msbot.operations.blocking import known_object
from msbot.pnp import PartInfo
from msbot.pnp.model import ProgramLogLine
from msbot_agent.text.sentence import said
from msbot_agent.text.similar_names import instead_of
from msbot_web.frame_ring import FrameRing
from msbot_web.glances import SlotGlance
from msbot_web.live_values import LiveValues
from msbot_web.models.bus_models import BusFigures, FrameLine
from msbot_web.models.robot_models import (
    PartLine,
    SafeLine,
    Simulated,
    SimulatedPartControl,
    SlotCard,
    SpanLine,
    StopState,
    TimelineLane,
    TopicLine,
    TypeLine,
    WirePort,
)
from msbot_web.recorded_snapshot import KnownEndpoint, frame_line_of, spark_of, topic_lines, wire_ports
from msbot_web.simulated.controls import SimulatedControls
from msbot_web.slot_cards import SaidByHand, SlotCards, part_line
from msbot_web.timeline import LiveCurves, Timeline
from msbot_xrce.errors import NotThere

ARRIVING = ("new", "checking", "refused", "standby")
"""States of parts that hold no slot and are there: they wait in the arrivals tray."""

HELD = ("active", "late")
"""States of slots that a part holds."""


class BusMeter:
    """Where the figures of a CAN bus come from; all zero when there is none."""

    name = ""
    bitrate = 0
    data_bitrate = 0

    def load_percent(self) -> float:
        """Share of the last second in which the bus was busy."""
        return 0.0

    def errors(self) -> int:
        """Error frames so far."""
        return 0


class ModelBuilder:
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
        ignored: whether a person does not want to see a part among the arrivals.
        bus: the figures of its CAN bus.
        stop: STOP as it stands.
        by_hand: what people say to the ports that they drive by hand.
        planted: the faults planted at a slot, or with an empty text at the robot, as far as they may be told.
    """

    def __init__(
        self,
        master: Master,
        *,
        blueprint: Callable[[], Blueprint],
        library: Library,
        live: LiveValues,
        frames: FrameRing,
        timeline: Timeline,
        bench: SimulatedControls,
        clock: Callable[[], float],
        ignored: Callable[[PartInfo], bool],
        bus: BusMeter | None = None,
        stop: Callable[[], StopState] = StopState,
        by_hand: SaidByHand = dict,
        planted: Callable[[str], Sequence[str]] = lambda _: (),
    ) -> None:
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
        self._cards = SlotCards(
            parts=master.inventory.view,
            beat_s=lambda: master.inventory.timing.beat_s,
            blueprint=blueprint,
            library=library,
            live=live,
            clock=clock,
            ignored=ignored,
            stop=stop,
            by_hand=by_hand,
            planted=planted,
            plugged=lambda: {slot: bench.is_plugged(slot) for slot in bench.slots()},
            wear=master.agent.wear,
            type_differences=master.type_differences,
            is_frozen=master.inventory.pupil_parts.is_held,
        )
        self.curves = LiveCurves(
            master,
            blueprint=blueprint,
            library=lambda: self.library,
            live=live,
            timeline=timeline,
            load_percent=self._bus.load_percent if self._bus.name else None,
            frames=lambda: frames.total,
            clock=clock,
        )
        self._rate: tuple[float, int, float] = (clock(), 0, 0.0)
        self._watched: Blueprint | None = None
        """Whose topics are listened to."""

    def use_library(self, library: Library) -> None:
        """From now on these part types hold."""
        self.library = self._cards.library = library

    def poll(self) -> None:
        """Observe what only polling shows (beat intervals, bound topics); call it a few times a second."""
        now, blueprint = self._clock(), self._blueprint()
        infos = self._master.inventory.view(now)
        self._timeline.poll(infos, now)
        if blueprint is not self._watched:
            self._watched = blueprint
            self.live.watch(blueprint.topics())
        self.curves.sample(infos)

    # Slots and parts

    def slots(self) -> list[SlotCard]:
        """All slots, in the order of the blueprint."""
        return self._cards.all()

    def slots_and_waiting(self) -> tuple[list[SlotCard], int]:
        """`slots` and `waiting`, of one moment."""
        infos = self._master.inventory.view(self._clock())
        return self._cards.all(infos), self._waiting(infos)

    def glances_and_waiting(self) -> tuple[list[SlotGlance], int]:
        """What can be seen of all slots from afar, and `waiting`, of one moment."""
        infos = self._master.inventory.view(self._clock())
        return self._cards.glances(infos), self._waiting(infos)

    def slot(self, name: str) -> SlotCard:
        """One slot.

        Raises:
            NotThere: there is no such slot.
        """
        self.check_slot(name)
        return self._cards.card(name)

    def check_slot(self, name: str) -> None:
        """Refuse a slot that is not there.

        Raises:
            NotThere: there is no such slot; the text lists those there are.
        """
        blueprint = self._blueprint()
        if blueprint.slot(name) is None:
            hint = instead_of(name, [slot.name for slot in blueprint.slots])
            raise NotThere(said("there is no slot {name!r}; {hint}", name=name, hint=hint))

    def slot_held_by_simulated(self, slot: str) -> str:
        """Which slot the simulated part of a slot holds now: another one if its own was taken; empty: none."""
        uid = self.bench.uid(slot)
        parts = self._master.inventory.view(self._clock()) if uid else ()
        return next((info.slot for info in parts if info.uid == uid and info.slot and not info.state.is_over), "")

    def is_held_by_another(self, slot: str) -> bool:
        """Whether a part that is there holds a slot, and is not the simulated one, which may just have been pulled."""
        holder = self._master.inventory.holder(slot, self._clock())
        return holder is not None and holder.state.is_registered and holder.uid != self.bench.uid(slot)

    def parts(self) -> list[PartLine]:
        """All parts that are there or were there lately."""
        return [part_line(info, is_ignored=self._ignored(info)) for info in self._master.inventory.view(self._clock())]

    def waiting(self) -> int:
        """How many parts are among the arrivals and not ignored."""
        return self._waiting(self._master.inventory.view(self._clock()))

    def _waiting(self, infos: Sequence[PartInfo]) -> int:
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

    def why(self, part: str, *, by_name: bool = False) -> list[str]:
        """In sentences: the state of a part, which rules led there, and whom its topics cannot reach.

        With `by_name`, no part is found by what only teachers see: UID, address, client key.
        """
        return self._master.why(part, by_name=by_name)

    def log_lines(self, slot: str) -> list[ProgramLogLine]:
        """What the program of the part in a slot logged last, oldest first."""
        return self._master.inventory.lines_of(slot)

    def beat_intervals(self, slot: str) -> list[float]:
        """Seconds between the latest beats."""
        return list(self._timeline.beat_intervals(slot))

    # Simulated parts

    def pupils_here(self) -> Mapping[str, tuple[str, ...]]:
        """The pupils who run parts in browsers now, and the slots that these hold."""
        return self._master.inventory.pupil_parts.here()

    def empty_slots(self) -> list[str]:
        """The slots that nobody holds and that are for hardware, not for somebody's program."""
        inventory, found = self._master.inventory, []
        for slot in inventory.slots.free_slots():
            part_type = self.library.find(inventory.slots.number_of(slot))
            if part_type is not None and "program" not in part_type.keywords:
                found.append(slot)
        return found

    def simulated(self, slot: str) -> Simulated:
        """A simulated part's controls and readings.

        Raises:
            NotThere: no part of that slot runs here.
        """
        if slot not in self.bench.slots():
            known = ", ".join(self.bench.slots()) or "none"
            raise NotThere(
                said("no part of slot {slot!r} is simulated here; those that are: {known}", slot=slot, known=known)
            )
        controls: list[SimulatedPartControl] = list(self.bench.controls(slot))
        return Simulated(
            slot=slot,
            plugged=self.bench.is_plugged(slot),
            controls=controls,
            readings=dict(self.bench.readings(slot)),
        )

    # Topics, bus, past

    def topics(self) -> list[TopicLine]:
        """All bound topics."""
        return topic_lines(self._blueprint(), self.live, self._clock())

    def version_mark(self) -> object:
        """A mark that is a new object whenever somebody has changed the robot's slots, wires or settings."""
        return self._blueprint()

    def safe_values(self, slot: str) -> list[SafeLine]:
        """What STOP, or the loss of a partner, brings the ports of a slot to."""
        found = self._blueprint().slot(slot)
        part_type = None if found is None else self.library.get(found.part_number)
        if found is None or part_type is None:
            return []
        return [
            SafeLine(
                port=port.name,
                field=field,
                value=value,
                unit="" if port.message is None else port.message.units.get(field, ""),
                origin="blueprint" if field in found.safe.get(port.name, {}) else "library",
                stops_by=port.stops_by,
            )
            for port in part_type.ports
            for field, value in found.safe_at(port).items()
        ]

    def ports(self) -> list[WirePort]:
        """All ports of all slots, in the order of the blueprint, with the topics they are wired to."""
        return wire_ports(self._blueprint(), self.library)

    def endpoints(self) -> list[KnownEndpoint]:
        """What is known of the objects of parts on CAN buses: for frames of sessions whose beginning is long ago."""
        master = self._master
        return [
            KnownEndpoint(key, node, object_id, known)
            for _, node, object_id, key, _ in master.agent.bus_endpoints()
            if (known := known_object(master, node, object_id)) is not None
        ]

    def units(self, type_name: str) -> Mapping[str, str]:
        """The units of a message type's fields, by field."""
        return self.library.units(type_name)

    def sparkline(self, topic: str) -> list[float]:
        """The first number on a topic over the last minute, oldest first."""
        return spark_of(self.live, topic)

    def bus(self) -> BusFigures:
        """How busy the bus is."""
        now, total = self._clock(), self.frames.total
        at, before, rate = self._rate
        if now - at >= 1.0:
            rate = (total - before) / (now - at)
            self._rate = (now, total, rate)
        return BusFigures(
            watched=bool(self._bus.name),
            name=self._bus.name,
            bitrate=self._bus.bitrate,
            data_bitrate=self._bus.data_bitrate,
            frames=total,
            load_percent=self._bus.load_percent(),
            frames_per_second=rate,
            errors=self._bus.errors(),
        )

    def frames_as_csv(self) -> str:
        """The frames that are kept as a table: number, seconds, sender, frame, sentence, words of the protocol."""
        return "".join(self.frames.csv())

    def frames_as_candump(self) -> str:
        """The frames that are kept as `candump -l` writes them."""
        epoch_s = time.time() - self._clock()
        return "".join(f"{line}\n" for line in self.frames.candump("can0", epoch_s=epoch_s))

    def frame_lines(self, after: int, limit: int) -> list[FrameLine]:
        """The newest frames with a number above `after`, oldest first."""
        now = self._clock()
        return [frame_line_of(row, now) for row in self.frames.rows(after, limit)]

    def frame_line(self, number: int) -> FrameLine | None:
        """One frame by its number, or None when it is no longer kept."""
        row = self.frames.row(number)
        return None if row is None else frame_line_of(row, self._clock())

    def timeline(self) -> list[TimelineLane]:
        """The states of every slot over time."""
        now = self._clock()
        lanes = self._timeline.lanes()
        order = [slot.name for slot in self._blueprint().slots]
        # A part without a slot has a lane as long as it waits; what it did before it got a slot stands in the journal.
        waiting = {part.part for part in self.parts() if part.state in ARRIVING}
        names = [name for name in lanes if name not in order and name in waiting]
        names = [*order, *sorted(names, key=lambda name: lanes[name][0].begin)]
        result = []
        for name in names:
            spans = lanes.get(name, ())
            ends = [*(span.begin for span in spans[1:]), now] if spans else []
            result.append(
                TimelineLane(
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
