"""A robot as it was: what a recording tells, put together as the present robot is, so that pages can show either.

Cards, wires, bus and values are worked out by the code that works them out for the present; only the sources differ.
What a recording does not tell (counters since the start, the time until the next beat) is not shown of the past.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping, Sequence
from typing import Final

from msbot.config import Binding, Blueprint, Direction, Library, RobotProfile, Scalar, Slot, SlotPort
from msbot.operations.message_classes import MessageClasses
from msbot.part.join.pnp_messages import Nature
from msbot.pnp import KnownObject, PartInfo, PartState
from msbot.pnp.emergency_stop import StopConfirmation, StopStatus
from msbot.recording.curves.curve import number_of
from msbot.recording.recorder.batch import BITRATE, BLUEPRINT, DATA_BITRATE, MEASURED, SHOWN
from msbot.recording.recorder.recording_file import ENCAPSULATION
from msbot.recording.recorder.schemas import FRAME
from msbot.recording.recordings.mcap_reader import FRAMES, NS, OWN, RecordedMessage
from msbot.recording.recordings.summary import frame_of
from msbot.sim import message_class
from msbot_agent.link.can.protocol import busy_seconds
from msbot_agent.space import MemorySpace, Sample
from msbot_agent.text.sentence import from_json
from msbot_agent.text.untrusted_input import read_json
from msbot_web.frame_ring import FrameRing, FrameRow
from msbot_web.live_values import LiveValues
from msbot_web.models.bus_models import BusFigures, FrameLine
from msbot_web.models.robot_models import Robot, SlotCard, TopicLine, WirePort
from msbot_web.slot_cards import SlotCards, stop_state
from msbot_xrce.lazy import dataclass

# Topics, ports and frames as pages show them, of the present robot and of one in the past.


def topic_lines(blueprint: Blueprint, live: LiveValues, now: float) -> list[TopicLine]:
    """All bound topics."""
    lines = []
    for binding in blueprint.bindings:
        watch = live.topic(binding.topic)
        lines.append(
            TopicLine(
                topic=binding.topic,
                type_name=binding.type_name,
                publishers=[str(binding.source)] if binding.source.slot else [],
                subscribers=[str(target) for target in binding.targets],
                rate_hz=0.0 if watch is None else watch.rate_hz(now),
                count=0 if watch is None else watch.count,
                fields={} if watch is None else live.fields(watch),
            )
        )
    return lines


def wire_ports(blueprint: Blueprint, library: Library) -> list[WirePort]:
    """All ports of all slots, in the order of the blueprint, with the topics they are wired to."""
    wired = {str(end): binding for binding in blueprint.bindings for end in (binding.source, *binding.targets)}
    lines: dict[str, WirePort] = {}
    for slot in blueprint.slots:
        part_type = library.get(slot.part_number)
        for port in () if part_type is None else part_type.ports:
            end = f"{slot.name}.{port.name}"
            lines[end] = WirePort(
                slot=slot.name,
                port=port.name,
                type_name=port.type_name,
                publishes=port.direction in (Direction.PUBLISH, Direction.SERVE),
                topic=wired[end].topic if end in wired else "",
            )
    for end, binding in wired.items():  # of parts that the library does not know
        slot_name, _, port_name = end.rpartition(".")
        if end not in lines:
            lines[end] = WirePort(
                slot=slot_name,
                port=port_name,
                type_name=binding.type_name,
                publishes=str(binding.source) == end,
                topic=binding.topic,
            )
    return list(lines.values())


def spark_of(live: LiveValues, topic: str) -> list[float]:
    """The first number on a topic over the last minute, or on and off as 1 and 0 where there is none; oldest first."""
    watch = live.topic(topic)
    if watch is None:
        return []
    fields = live.fields(watch)
    numbers = (name for name, value in fields.items() if not isinstance(value, str))
    field = min(numbers, key=lambda name: isinstance(fields[name], bool), default=None)
    return [] if field is None else live.sparkline(watch, field)


def frame_line_of(row: FrameRow, now: float) -> FrameLine:
    """A frame, with its age."""
    return FrameLine(
        number=row.number,
        age_s=max(now - row.at, 0.0),
        sender=row.sender,
        text=row.text,
        node=row.node,
        plain=list(row.plain),
        about=list(row.about),
        words=list(row.words),
        notation=row.notation,
    )


MOST_FRAMES: Final = 2000
"""Frames of a moment: those just before it."""
HISTORY_S: Final = 60.0
"""How long before the moment the small curves begin."""
LOAD_S: Final = 1.0
LATER_NS: Final = 2 * NS
"""What was measured at the robot is written once a second."""
EVENTS, SLOTS, STOP, ROBOT = (f"{OWN}{name}" for name in ("events", "slots", "stop", "robot"))
SENT_AT: Final = 4 + FRAME.size - 4 - 1 - 1
"""Where a recorded frame says whether the master itself sent it."""


@dataclass(frozen=True, slots=True)
class KnownEndpoint:
    """What the master knows of an object of a part on a CAN bus, whose creation may have been long before."""

    client_key: int
    node: Hashable
    object_id: int
    known: KnownObject


@dataclass(frozen=True, slots=True)
class RecordedSnapshot:
    """The robot at a moment."""

    at_s: float
    """Seconds since 1970."""
    robot: Robot
    topics: list[TopicLine]
    ports: list[WirePort]
    bus: BusFigures
    frames: list[FrameLine]
    """Those just before it, oldest first."""
    candump: str
    """The same as `candump -l` writes them."""
    csv: str
    """The same as a table."""
    sparks: Mapping[str, list[float]]
    """The small curves, by topic."""


class SnapshotBuilder:
    """Puts a moment together.

    Args:
        at_ns: the moment, nanoseconds since 1970.
        messages: the recording in whose time it is, from its beginning; what is later than the moment is left out.
        before: what was recorded before that, for small curves and frames.
        library: what part numbers and message types mean.
        endpoints: what is known today of the objects of parts.
    """

    def __init__(
        self,
        at_ns: int,
        messages: Sequence[RecordedMessage],
        before: Sequence[RecordedMessage],
        library: Library,
        endpoints: Sequence[KnownEndpoint] = (),
    ) -> None:
        self._at_s = self._now = at_ns / NS
        self._library = library
        self._events: dict[str, dict[str, object]] = {}
        self._states: dict[str, dict[str, object]] = {}
        self._slots: dict[str, dict[str, object]] = {}
        self._beats: dict[str, float] = {}
        self._lives: dict[str, object] = {}
        known = [one for one in messages if one.at_ns <= at_ns]
        for message in known:
            if message.topic.startswith(OWN) and not message.topic.startswith(FRAMES):
                self._take(message)
        for message in messages:  # what was measured just after it tells of beats before it
            if at_ns < message.at_ns <= at_ns + LATER_NS:
                if message.topic == MEASURED:
                    self._take_beats(message)
                elif message.topic == STOP:
                    self._take_confirmations(object_of(message))
        self._blueprint = self._read_blueprint()
        self._infos = self._read_parts()
        self._live = LiveValues(MemorySpace(clock=self._clock), MessageClasses(lambda: self._library), self._clock)
        self._live.watch(self._blueprint.topics())
        from_ns = at_ns - round(HISTORY_S * NS)
        earlier = [one for one in before if from_ns <= one.at_ns and not one.is_repeated]
        heard = [one for one in (*earlier, *known) if not one.topic.startswith(OWN)]
        for message in sorted(heard, key=lambda one: one.at_ns):
            self._hear(message)
        self._now = self._at_s
        self._frames = [one for one in (*earlier, *known) if one.topic.startswith(FRAMES)][-MOST_FRAMES:]
        self._ring = self._read_frames(endpoints)

    def snapshot(self) -> RecordedSnapshot:
        """All that pages show."""
        return RecordedSnapshot(
            at_s=self._at_s,
            robot=self._robot(),
            topics=topic_lines(self._blueprint, self._live, self._at_s),
            ports=wire_ports(self._blueprint, self._library),
            bus=self._bus(),
            frames=[frame_line_of(row, self._at_s) for row in self._ring.rows(limit=MOST_FRAMES)],
            candump="".join(f"{line}\n" for line in self._ring.candump("can0")),
            csv="".join(self._ring.csv()),
            sparks={name: spark_of(self._live, name) for name in self._blueprint.topics()},
        )

    def _clock(self) -> float:
        return self._now

    # What was recorded.

    def _take(self, message: RecordedMessage) -> None:
        value = object_of(message)
        topic = message.topic
        if topic == EVENTS:
            self._take_event({**value, "at_s": message.at_ns / NS})
        elif topic == SLOTS:
            self._slots[_text(value, "slot")] = value
        elif topic == MEASURED:
            self._lives = _object(value, "lives")
            self._take_beats(message)
        else:
            self._states[topic] = value

    def _take_beats(self, message: RecordedMessage) -> None:
        value = object_of(message)
        for slot, age_s in _object(value, "ages").items():
            beat_at = message.at_ns / NS - (number_of(age_s) or 0.0)
            between_s = number_of(_object(value, "beats").get(slot)) or 0.0
            if beat_at > self._at_s and between_s:  # the one before it, then
                beat_at -= between_s * math.ceil((beat_at - self._at_s) / between_s)
            if self._beats.get(slot, 0.0) < beat_at <= self._at_s:
                self._beats[slot] = beat_at

    def _take_confirmations(self, later: dict[str, object]) -> None:
        """Of the same STOP, as it was told a little later: who has confirmed it when is in it."""
        held = self._states.get(STOP, {})
        if held.get("stopped") is True and later.get("stopped") is True and later.get("number") == held.get("number"):
            self._states[STOP] = later

    def _take_event(self, event: dict[str, object]) -> None:
        """The latest change of each part; what a device was before it said who it is, it is no more."""
        identity, session = _text(event, "identity"), str(event.get("client_key"))
        for key in [
            key
            for key, one in self._events.items()
            if (identity and one.get("identity") == identity)
            or (not one.get("identity") and str(one.get("client_key")) == session)
        ]:
            del self._events[key]
        if identity or not _state(event).is_over:
            self._events[identity or session] = event

    def _read_blueprint(self) -> Blueprint:
        value = self._states.get(BLUEPRINT, {})
        wires = [_binding(one) for one in _objects(value, "wires")]
        slots = [
            Slot(_text(one, "slot"), _text(one, "part_number"), description=_text(one, "description"))
            for one in _objects(value, "slots")
        ]
        return Blueprint(RobotProfile(_text(self._states.get(ROBOT, {}), "name")), tuple(slots), tuple(wires))

    def _read_parts(self) -> list[PartInfo]:
        holders = {_text(event, "slot") for event in self._events.values() if _state(event).is_registered}
        return [self._part(event, holders) for event in self._events.values()]

    def _part(self, event: Mapping[str, object], holders: set[str]) -> PartInfo:
        state, slot = _state(event), _text(event, "slot")
        if not state.is_registered and (not state.is_over or slot in holders):
            slot = ""
        life = number_of(self._states.get(BLUEPRINT, {}).get("life"))
        left = number_of(self._lives.get(slot)) if state is PartState.LATE else life
        beat_at = self._beats.get(slot)
        nature = _text(self._slots.get(slot, {}), "nature").upper()
        key = event.get("client_key")
        return PartInfo(
            part=_text(event, "part"),
            part_number=_text(event, "part_number"),
            local_name=_text(self._slots.get(slot, {}), "local_name"),
            uid=bytes.fromhex(_text(event, "uid")),
            slot=slot or None,
            state=state,
            reason=from_json(event.get("said")),
            state_age_s=self._at_s - (number_of(event.get("at_s")) or self._at_s),
            life=int(left or 0) if state.is_registered else 0,
            beat_age_s=None if beat_at is None else max(self._at_s - beat_at, 0.0),
            beats=0,
            plug_in_to_active_ms=None,
            client_key=key if isinstance(key, int) else 0,
            address="",
            refused_claims=0,
            duplicates=(),
            nature=Nature[nature] if nature in Nature.__members__ else Nature.UNKNOWN,
        )

    def _hear(self, message: RecordedMessage) -> None:
        watch = self._live.topic(message.channel.metadata.get("topic", ""))
        if watch is not None and message.data.startswith(ENCAPSULATION):
            self._now = message.at_ns / NS
            watch.deliver(Sample(message.data[len(ENCAPSULATION) :], _NOBODY, 0))

    # What is made of it.

    def _robot(self) -> Robot:
        profile, blueprint = self._states.get(ROBOT, {}), self._states.get(BLUEPRINT, {})
        stop, links = self._stop(), _list(blueprint.get("links"))
        cards = SlotCards(
            parts=lambda _: self._infos,
            beat_s=lambda: number_of(blueprint.get("beat_s")) or 1.0,
            blueprint=lambda: self._blueprint,
            library=self._library,
            live=self._live,
            clock=self._clock,
            ignored=lambda _: False,
            stop=lambda: stop_state(stop, lambda: round(self._at_s * NS)),
            by_hand=self._by_hand,
            planted=self._faults,
        )
        slots = [_still(card) for card in cards.all()]
        return Robot(
            name=_text(profile, "name"),
            version=_text(profile, "version"),
            serial_number=_text(profile, "serial_number"),
            released=_text(profile, "released"),
            manufacturer=_text(profile, "manufacturer"),
            links=[str(one) for one in links],
            beat_s=number_of(blueprint.get("beat_s")) or 1.0,
            tick_s=number_of(blueprint.get("tick_s")) or 1.0,
            life=int(number_of(blueprint.get("life")) or 0),
            stopped=stop.stopped,
            stop=stop_state(stop, lambda: round(self._at_s * NS)),
            window_s=0.0,
            trouble="",
            slots=slots,
            arrivals=0,
            faults=list(self._faults("")),
        )

    def _stop(self) -> StopStatus:
        value = self._states.get(STOP, {})
        since = value.get("since_ns")
        held_ms = (self._at_s * NS - since) / 1e6 if isinstance(since, int) else 0.0
        told = [
            StopConfirmation(_text(one, "part"), number_of(one.get("ms")) or 0.0)
            for one in _objects(value, "confirmed")
        ]
        confirmed = [one for one in told if one.ms <= held_ms]
        late = [one.part for one in told if one.ms > held_ms]
        silent = [*(str(one) for one in _list(value.get("silent"))), *late]
        return StopStatus(
            stopped=value.get("stopped") is True,
            by=_text(value, "by"),
            reason=_text(value, "reason"),
            since_ns=since if isinstance(since, int) else None,
            confirmed=tuple(confirmed),
            silent=tuple(silent),
        )

    def _by_hand(self) -> Mapping[tuple[str, str], Mapping[str, Scalar]]:
        rows = self._states.get(SHOWN, {}).get("by_hand")
        found: dict[tuple[str, str], Mapping[str, Scalar]] = {}
        for row in rows if isinstance(rows, list) else ():
            match row:
                case [str(slot), str(port), dict(fields)]:
                    found[slot, port] = fields
        return found

    def _faults(self, slot: str) -> Sequence[str]:
        rows = _object(self._states.get(SHOWN, {}), "faults").get(slot)
        return [from_json(one) for one in rows] if isinstance(rows, list) else []

    def _read_frames(self, endpoints: Sequence[KnownEndpoint]) -> FrameRing:
        # Objects are numbered by each session anew: what is known today holds for those sessions that were there then.
        present = {info.client_key for info in self._infos if info.state.is_registered}
        objects = {(one.node, one.object_id): one.known for one in endpoints if one.client_key in present}
        ring = FrameRing()
        classes = (message_class(message) for message in self._library.messages.values())
        ring.learn(classes, lambda node, object_id: objects.get((node, object_id)), self._library.units)
        for message in self._frames:
            frame = frame_of(message)
            if frame is not None:
                ring.tap(message.at_ns / NS, "here" if message.data[SENT_AT] else "bus", frame)
        return ring

    def _bus(self) -> BusFigures:
        if not self._frames:
            return BusFigures(
                watched=False, name="", bitrate=0, frames=0, load_percent=0.0, frames_per_second=0.0, errors=0
            )
        after_ns = round((self._at_s - LOAD_S) * NS)
        links = {one.topic: one.channel.metadata for one in self._frames}
        bitrates = {topic: number_of(words.get(BITRATE)) or 0.0 for topic, words in links.items()}
        data_bitrates = {topic: number_of(words.get(DATA_BITRATE)) for topic, words in links.items()}
        latest = [one for one in self._frames if one.at_ns > after_ns]
        busy_s = [
            busy_seconds(frame, bitrates[one.topic], data_bitrates[one.topic])
            for one in latest
            if bitrates[one.topic] and (frame := frame_of(one)) is not None
        ]
        measured = sum(rate > 0 for rate in bitrates.values())
        return BusFigures(
            watched=True,
            name=", ".join(topic.removeprefix(FRAMES) for topic in links),
            bitrate=round(sum(bitrates.values())),
            frames=0,
            load_percent=100 * sum(busy_s) / (LOAD_S * max(measured, 1)),
            frames_per_second=len(latest) / LOAD_S,
            errors=0,
        )


_NOBODY: Final = bytes(16)


def _still(card: SlotCard) -> SlotCard:
    """A card on which nothing moves."""
    return card.model_copy(update={"next_beat_s": None})


def _binding(value: Mapping[str, object]) -> Binding:
    ends = [_end(value.get("from")), *(_end(one) for one in _list(value.get("to")))]
    return Binding(_text(value, "topic"), _text(value, "type"), ends[0], tuple(ends[1:]), value.get("reliable") is True)


def _end(value: object) -> SlotPort:
    match value:
        case [str(slot), str(port)]:
            return SlotPort(slot, port)
    return SlotPort("", "")


def object_of(message: RecordedMessage) -> dict[str, object]:
    """What a JSON message says; empty if it makes no sense."""
    try:
        found = read_json(message.data)
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}


def _state(event: Mapping[str, object]) -> PartState:
    word = event.get("to")
    return PartState(word) if word in {one.value for one in PartState} else PartState.LEFT


def _text(value: Mapping[str, object], name: str) -> str:
    found = value.get(name)
    return found if isinstance(found, str) else ""


def _object(value: Mapping[str, object], name: str) -> dict[str, object]:
    found = value.get(name)
    return found if isinstance(found, dict) else {}


def _list(value: object) -> list[object]:
    return value if isinstance(value, list) else []


def _objects(value: Mapping[str, object], name: str) -> list[dict[str, object]]:
    return [one for one in _list(value.get(name)) if isinstance(one, dict)]
