"""The cards of the slots: which part holds a slot, its state, and what it does at this moment.

What an actuator does is not always what it was told: under STOP, and without its partner, it applies its safe values.
That is shown only as far as it is known: a part that has not confirmed STOP may still move.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial

from msbot.config import Binding, Blueprint, Library, MessageType, PartType, Port, Slot, scalar_text
from msbot.pnp import PartInfo, PartState, SelfDescription, StopStatus
from msbot_agent.agent import SessionFaultCounts
from msbot_agent.text.sentence import said
from msbot_web.glances import PartGlance, SlotGlance
from msbot_web.live_values import LiveValues, TopicWatch
from msbot_web.models.robot_models import (
    TOLD,
    PartDeclaration,
    PartLine,
    PartStopConfirmation,
    PortDeclaration,
    PortLine,
    Scalar,
    SessionFaults,
    SettingDeclaration,
    SlotCard,
    StopState,
    unchecked,
)
from msbot_xrce.lazy import dataclass

STALE_PERIODS = 3
"""A value is stale when this many of its periods have passed without a new one."""
SHORTEST_PERIOD_S = 0.2
"""A value that comes more often is not called stale because of a hiccup."""


NOTHING_PLUGGED_IN = said("nothing is plugged in")

_slot_card, _port_line = unchecked(SlotCard), unchecked(PortLine)
_part_line, _session_faults = unchecked(PartLine), unchecked(SessionFaults)

SaidByHand = Callable[[], Mapping[tuple[str, str], Mapping[str, Scalar]]]
"""What people say to the ports that they drive by hand: `(slot, port)` -> fields."""


def no_session_faults(_client_key: int) -> SessionFaultCounts | None:
    """For who does not know how a session fared."""
    return None


def stop_state(status: StopStatus, epoch_ns: Callable[[], int] = time.time_ns) -> StopState:
    """STOP as pages and API show it."""
    return StopState(
        stopped=status.stopped,
        number=status.number,
        by=status.by,
        also_by=list(status.also_by),
        place=status.place,
        reason=status.reason,
        since_s=None if status.since_ns is None else max(epoch_ns() - status.since_ns, 0) / 1e9,
        confirmed=[PartStopConfirmation(part=one.part, ms=one.ms) for one in status.confirmed],
        silent=list(status.silent),
        trouble=status.trouble,
    )


class SlotCards:
    """See the module's docstring; the other arguments are those of `ModelBuilder`.

    Args:
        parts: all parts, at a time of the robot's clock.
        beat_s: seconds between two beats of a part.
        plugged: the slots whose parts are simulated in this process, and whether these are on the wire.
        wear: what went wrong in the session of that client.
        is_frozen: whether that client is the program of a pupil who is held: it says and hears nothing.
    """

    def __init__(
        self,
        *,
        parts: Callable[[float], Sequence[PartInfo]],
        beat_s: Callable[[], float],
        blueprint: Callable[[], Blueprint],
        library: Library,
        live: LiveValues,
        clock: Callable[[], float],
        ignored: Callable[[PartInfo], bool],
        stop: Callable[[], StopState],
        by_hand: SaidByHand,
        plugged: Callable[[], Mapping[str, bool]] = dict,
        wear: Callable[[int], SessionFaultCounts | None] = no_session_faults,
        planted: Callable[[str], Sequence[str]] = lambda _: (),
        type_differences: Callable[[int], Sequence[str]] = lambda _: (),
        is_frozen: Callable[[int], bool] = lambda _: False,
    ) -> None:
        self.live = live
        self.library = library
        self._parts = parts
        self._beat_s = beat_s
        self._plugged = plugged
        self._is_frozen = is_frozen
        self._wear_of = wear
        self._blueprint = blueprint
        self._clock = clock
        self._ignored = ignored
        self._stop = stop
        self._by_hand = by_hand
        self._planted = planted
        self._type_differences = type_differences
        self._places_are_of: tuple[Blueprint, Library] | None = None
        self._places: Mapping[str, _Place] = {}

    def all(self, parts: Sequence[PartInfo] | None = None) -> list[SlotCard]:
        """All slots, in the order of the blueprint; `parts` are all parts as they are now, if somebody has them."""
        look = self._look(parts)
        return [self._card(place, look) for place in self._places.values()]

    def glances(self, parts: Sequence[PartInfo]) -> list[SlotGlance]:
        """Likewise, what can be seen from afar; `parts` are all parts as they are now."""
        look = self._look(parts)
        return [self._glance(place, look) for place in self._places.values()]

    def card(self, name: str) -> SlotCard:
        """The slot of that name, which there is."""
        look = self._look()
        return self._card(self._places[name], look)

    def _look(self, parts: Sequence[PartInfo] | None = None) -> _RobotSnapshot:
        now, blueprint, library = self._clock(), self._blueprint(), self.library
        known = self._places_are_of
        if known is None or known[0] is not blueprint or known[1] is not library:
            self._places_are_of, self._places = (blueprint, library), _places_of(blueprint, library)
        view = self._parts(now) if parts is None else parts
        infos = {info.slot: info for info in view if info.slot}
        spares = self._spares(info for info in view if info.state is PartState.STANDBY)
        stop = self._stop()
        confirmed = frozenset(one.part for one in stop.confirmed)
        return _RobotSnapshot(
            now, infos, spares, self._plugged(), stop.stopped, confirmed, self._by_hand(), self._beat_s()
        )

    def _spares(self, waiting: Iterable[PartInfo]) -> Mapping[str, list[str]]:
        """The names of the parts that stand by, by the part numbers of the slots that they can fill."""
        found: dict[str, list[str]] = {}
        for info in waiting:
            part_type = self.library.find(info.part_number)
            for number in () if part_type is None else (part_type.number, *part_type.compatible_with):
                found.setdefault(number, []).append(info.part)
        return found

    def _glance(self, place: _Place, look: _RobotSnapshot) -> SlotGlance:
        slot = place.slot
        info = look.infos.get(slot.name)
        # An adopted part may be of another type than the slot is for, also of one that the library does not know.
        own_number = "" if info is None else info.part_number
        own_type = self.library.get(own_number) if own_number else place.part_type
        part, next_beat_s = None, None
        if info is not None:
            age_s = info.beat_age_s
            part = PartGlance(info.part, info.state.value, info.nature.label, info.life, info.beats, age_s)
            if age_s is not None and info.state.is_registered:
                next_beat_s = look.beat_s - age_s
        return SlotGlance(
            name=slot.name,
            shown_number=own_number or slot.part_number,
            type_name="" if own_type is None else own_type.name,
            state="empty" if info is None else info.state.value,
            reason=NOTHING_PLUGGED_IN if info is None else info.reason,
            part=part,
            next_beat_s=next_beat_s,
            spares=list(look.spares.get(slot.part_number, ())),
            plugged=look.plugged.get(slot.name),
            faults=list(self._planted(slot.name)),
            type_differences=[] if info is None else list(self._type_differences(info.client_key)),
            port=partial(self._main_port, place, look),
        )

    def _card(self, place: _Place, look: _RobotSnapshot) -> SlotCard:
        slot, part_type, seen = place.slot, place.part_type, self._glance(place, look)
        info = look.infos.get(slot.name)
        return _slot_card(
            name=slot.name,
            part_number=slot.part_number,
            type_name=seen.type_name,
            category="" if part_type is None else part_type.category.value,
            description=slot.description,
            state=seen.state,
            reason=seen.reason,
            part=None if info is None else part_line(info, is_ignored=self._ignored(info)),
            ports=[self._port(end, slot, look) for end in place.ends],
            next_beat_s=seen.next_beat_s,
            spares=seen.spares,
            simulated=seen.simulated,
            plugged=seen.plugged,
            faults=seen.faults,
            type_differences=seen.type_differences,
            wear=self._wear(info),
        )

    def _main_port(self, place: _Place, look: _RobotSnapshot) -> PortLine | None:
        """As `SlotCard.main_port`."""
        ends = place.ends_by_weight
        for end in ends:
            told = look.by_hand.get((place.slot.name, end.port))
            if told is None:
                watch = self.live.topic(end.binding.topic)
                told = {} if watch is None else self.live.shown(watch)
            if told:
                return self._port(end, place.slot, look)
        return self._port(place.ends[0], place.slot, look) if ends else None

    def _wear(self, info: PartInfo | None) -> SessionFaults | None:
        """What went wrong between agent and part in its session."""
        wear = None if info is None or not info.state.is_registered else self._wear_of(info.client_key)
        return None if wear is None else _session_faults(repeated=wear.repeated, resent=wear.resent, unread=wear.unread)

    def _port(self, end: _End, slot: Slot, look: _RobotSnapshot) -> PortLine:
        binding, now = end.binding, look.now
        watch = self.live.topic(binding.topic)
        told = look.by_hand.get((slot.name, end.port))
        held = "" if end.publishes else "by hand" if told is not None else self._held(look, slot.name, binding)
        return _port_line(
            port=end.port,
            topic=binding.topic,
            type_name=binding.type_name,
            publishes=end.publishes,
            reliable=binding.reliable,
            rate_hz=0.0 if watch is None else round(watch.rate_hz(now), 2),
            count=0 if watch is None else watch.count,
            age_s=None if watch is None or watch.at is None else now - watch.at,
            fields=dict(told) if told is not None else {} if watch is None else self.live.fields(watch),
            stale=told is None and watch is not None and _is_stale(watch, end, look),
            held=held,
            safe=dict(end.safe) if held in ("stopped", "partner lost") else {},
        )

    def _held(self, look: _RobotSnapshot, slot: str, binding: Binding) -> str:
        """Why the part in a slot does not obey what comes in on a topic; see `PortLine.held`."""
        info = look.infos.get(slot)
        if info is None or not info.state.is_registered:
            return "gone"
        if look.is_stopped:
            return "stopped" if info.part in look.confirmed else "unconfirmed"
        source = look.infos.get(binding.source.slot)
        if source is None or not source.state.is_registered:
            return "partner lost"
        # Either end that is frozen has been told, as has its partner, that the other one is not there.
        return "partner lost" if self._is_frozen(source.client_key) or self._is_frozen(info.client_key) else ""


def _is_stale(watch: TopicWatch, end: _End, look: _RobotSnapshot) -> bool:
    """Whether a value is out of date."""
    if watch.at is None:
        return False
    source = look.infos.get(end.binding.source.slot)
    if source is None or not source.state.is_registered:
        return True
    if not end.rate_hz:  # sent when something happens: silence is no sign
        return False
    return look.now - watch.at > STALE_PERIODS * max(watch.period_s, 1 / end.rate_hz, SHORTEST_PERIOD_S)


def part_line(info: PartInfo, *, is_ignored: bool) -> PartLine:
    """A part as pages and API show it."""
    return _part_line(
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
        ignored=is_ignored,
        nature=info.nature.label,
        hardware=info.hardware,
        software=info.software,
        home=info.home,
        msbot=info.msbot,
        says=None if info.says is None else _says(info.says),
        refusal="" if info.refusal is None else info.refusal.name.lower(),
    )


def _says(said: SelfDescription) -> PartDeclaration:
    if said.described is None:
        return PartDeclaration(checked=False, fault=said.fault)
    part_type = said.described.part_type
    return PartDeclaration(
        name=part_type.name,
        description=part_type.description,
        ports=[_says_port(port) for port in part_type.ports],
        settings=[
            SettingDeclaration(
                name=one.name, default=scalar_text(one.default), least=one.least, most=one.most, unit=one.unit
            )
            for one in part_type.parameters
        ],
        checked=True,
    )


def _says_field(port: Port, message: MessageType, name: str) -> str:
    """`percent 0 … 100 %`."""
    ends = "" if name not in port.ranges else "{:g} … {:g}".format(*port.ranges[name])
    return " ".join(filter(None, (name, ends, message.units.get(name, ""))))


def _says_port(port: Port) -> PortDeclaration:
    message = port.message
    fields = [] if message is None else [_says_field(port, message, name) for name in message.fields]
    safe = ", ".join(f"{name} = {scalar_text(value)}" for name, value in (port.safe or {}).items())
    if port.stops_by:
        safe = f"{safe} (STOP: {port.stops_by})".lstrip()
    return PortDeclaration(
        name=port.name,
        direction=port.direction.value,
        type=port.type_name,
        fields=fields,
        safe=safe,
    )


@dataclass(frozen=True, slots=True)
class _RobotSnapshot:
    """What all cards of one look at the robot have in common."""

    now: float
    infos: Mapping[str, PartInfo]
    """By slot."""
    spares: Mapping[str, list[str]]
    """Names of parts that stand by, by the part number of the slots that they fit."""
    plugged: Mapping[str, bool]
    """Slots whose parts are simulated in this process, and whether these are on the wire."""
    is_stopped: bool
    confirmed: frozenset[str]
    """Names of the parts that have confirmed STOP."""
    by_hand: Mapping[tuple[str, str], Mapping[str, Scalar]]
    """What people say to ports that they drive by hand."""
    beat_s: float
    """Seconds between two beats of a part."""


@dataclass(frozen=True, slots=True)
class _End:
    """A slot's end of a binding, with what the library says of the port."""

    binding: Binding
    port: str
    publishes: bool
    rate_hz: float
    """How often the binding's source publishes; 0: when something happens, or it is not known."""
    safe: Mapping[str, Scalar]
    """The port's safe value; empty: it has none."""


@dataclass(frozen=True, slots=True)
class _Place:
    """A slot of the blueprint, with what the library says of it."""

    slot: Slot
    part_type: PartType | None
    ends: Sequence[_End]
    ends_by_weight: Sequence[_End]
    """Those that say most about the part first; see `SlotCard.main_port`."""


def _places_of(blueprint: Blueprint, library: Library) -> Mapping[str, _Place]:
    """All slots by name, in the order of the blueprint."""
    types = {slot.name: library.get(slot.part_number) for slot in blueprint.slots}
    slots = {slot.name: slot for slot in blueprint.slots}

    def port_of(slot: str, name: str) -> Port | None:
        part_type = types.get(slot)
        return None if part_type is None else part_type.port(name)

    def end_of(binding: Binding, slot: str, name: str, rate_hz: float, *, publishes: bool) -> _End:
        port = port_of(slot, name)
        return _End(binding, name, publishes, rate_hz, {} if port is None else slots[slot].safe_at(port))

    ends: dict[str, list[_End]] = {slot.name: [] for slot in blueprint.slots}
    for binding in blueprint.bindings:
        source = port_of(binding.source.slot, binding.source.port)
        rate_hz = 0.0 if source is None or not source.rate_hz else source.rate_hz
        for publishes, one in ((True, binding.source), *((False, target) for target in binding.targets)):
            if one.slot in ends:
                ends[one.slot].append(end_of(binding, one.slot, one.port, rate_hz, publishes=publishes))

    def place_of(slot: Slot) -> _Place:
        part_type, own = types[slot.name], ends[slot.name]
        is_told = part_type is not None and part_type.category.value in TOLD
        return _Place(slot, part_type, own, sorted(own, key=lambda end: end.publishes is is_told))

    return {slot.name: place_of(slot) for slot in blueprint.slots}
