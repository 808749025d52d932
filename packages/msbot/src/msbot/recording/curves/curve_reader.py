"""Curves out of recordings: of a file, or of the files of a ring.

What is not wanted is not decoded. The load of a bus is worked out from its frames, with their stuff bits, a second at a
time.
"""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import field as with_default
from pathlib import Path
from typing import Final

from msbot.config import Library
from msbot.recording.curves.curve import (
    BUS,
    FRAMES,
    LATE,
    LATENCY,
    Curve,
    Figures,
    Point,
    ack_curve,
    beat_curve,
    field_name,
    figures_of,
    is_wanted,
    measured_unit,
    number_of,
    port_curve,
    setting_curve,
    thinned,
)
from msbot.recording.recorder.batch import BITRATE, DATA_BITRATE, MEASURED
from msbot.recording.recorder.recording_file import begun_segments
from msbot.recording.recordings.mcap_reader import FRAMES as FRAME_TOPICS
from msbot.recording.recordings.mcap_reader import NS, OWN, Decoder, RecordedMessage, RecordingReader
from msbot.recording.recordings.summary import flat_fields, frame_of
from msbot_agent.link.can.protocol import busy_seconds
from msbot_agent.text.untrusted_input import read_json
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

MOST_POINTS: Final = 2_000_000
"""Of all curves together; some 200 MB."""
UnitOf = Callable[[str, str], str]
"""`(type of a message, field) -> unit`; `(part number, setting) -> unit` for a setting, whose type begins with `:`."""


@dataclass(frozen=True, slots=True)
class ReadCurves:
    """What was read."""

    curves: tuple[Curve, ...]
    """Those that were wanted and are there; times in seconds since 1970."""
    figures: Mapping[str, Figures]
    """By name, of all points, though a curve may have been thinned."""
    known: tuple[str, ...]
    """Every curve that there is."""
    first_s: float
    """When the recording begins, seconds since 1970; 0: it is empty."""
    last_s: float
    damages: tuple[str, ...] = ()
    """What could not be read, in sentences."""
    unread: Counter[str] = with_default(default_factory=Counter)
    """Samples whose meaning is not known, by topic."""


def no_unit(_kind: str, _field: str) -> str:
    """For who does not know any."""
    return ""


def ring_files(folder: Path, from_s: float | None = None, to_s: float | None = None) -> list[Path]:
    """The files of a ring that have something of a time, seconds since 1970; oldest first.

    Raises:
        ConfigError: the folder cannot be read.
    """
    try:
        found = begun_segments(folder)
    except FileNotFoundError:
        return []  # nothing was recorded yet
    except OSError as error:
        raise ConfigError(f"cannot read the recorder's folder {folder}: {error.strerror}") from None
    if not found:
        return []  # its first file has not been begun yet
    begins = [segment.began_s for segment in found]
    ends = [*begins[1:], float("inf")]
    return [
        segment.path
        for segment, begin, end in zip(found, begins, ends, strict=True)
        if (to_s is None or begin <= to_s) and (from_s is None or end + 1 >= from_s)  # names have whole seconds
    ]


def read_curves(
    paths: Sequence[Path],
    wanted: Collection[str],
    *,
    from_s: float | None = None,
    to_s: float | None = None,
    unit_of: UnitOf = no_unit,
    most_points: int | None = None,
) -> ReadCurves:
    """Read some curves.

    Args:
        paths: recordings, one after the other in time.
        wanted: names of curves, or of ports or slots with all their curves; none: only tell which there are.
        from_s: seconds since 1970.
        to_s: likewise.
        unit_of: says units, which recordings do not have.
        most_points: of each curve; of more, those are kept that show the same curve.

    Raises:
        ConfigError: a file is no recording, or there is too much of it.
    """
    reading = _Reading(frozenset(wanted), from_s, to_s, unit_of)
    damages = []
    for path in paths:
        reader = RecordingReader(path)
        for message in reader.messages():
            reading.take(message)
        if reader.damage:
            damages.append(f"{path.name} is damaged: {reader.damage}")
    curves = reading.curves()
    return ReadCurves(
        tuple(
            curve if most_points is None else Curve(curve.name, thinned(curve.points, most_points), curve.unit)
            for curve in curves
        ),
        {curve.name: found for curve in curves if (found := figures_of([value for _, value in curve.points]))},
        tuple(sorted(reading.known)),
        reading.first_ns / NS,
        reading.last_ns / NS,
        tuple(damages),
        reading.unread,
    )


class _Reading:
    def __init__(self, wanted: frozenset[str], from_s: float | None, to_s: float | None, unit_of: UnitOf) -> None:
        self.known: set[str] = set()
        self.first_ns = 0
        self.last_ns = 0
        self._wanted = wanted
        self._from_ns = None if from_s is None else round(from_s * NS)
        self._to_ns = None if to_s is None else round(to_s * NS)
        self._unit_of = unit_of
        self.unread: Counter[str] = Counter()
        self._decoder = Decoder()
        self._points: dict[str, list[Point]] = defaultdict(list)
        self._units: dict[str, str] = {}
        self._count = 0
        self._listeners: dict[str, dict[str, None]] = defaultdict(dict)
        """Topic -> `slot.port` of those who read it."""
        self._looked: dict[tuple[str, str, str], bool] = {}
        """(topic, slot, port) -> whether any field of it is wanted, once one was seen."""
        self._settings: dict[str, float] = {}
        self._buses: dict[str, _Bus] = {}

    def take(self, message: RecordedMessage) -> None:
        """One message."""
        if self._to_ns is not None and message.logged_ns > self._to_ns:
            return
        if not message.is_repeated:
            self.first_ns = self.first_ns or message.at_ns
            self.last_ns = max(self.last_ns, message.at_ns)
        is_early = self._from_ns is not None and message.at_ns < self._from_ns
        topic = message.topic
        if topic == f"{OWN}slots":
            self._take_slot(message)  # what it was before counts, too
        elif message.is_repeated:
            return
        elif topic.startswith(FRAME_TOPICS):
            self._take_frame(message, is_early=is_early)
        elif topic == MEASURED:
            self._take_measured(message)
        elif not topic.startswith(OWN) and message.slot and "port" in message.channel.metadata:
            self._take_sample(message, is_early=is_early)

    def curves(self) -> list[Curve]:
        """What was wanted, in the order of names."""
        for name, value in self._settings.items():  # a setting holds until it is changed
            if self.last_ns / NS > self._points[name][-1][0]:
                self._points[name].append((self.last_ns / NS, value))
        for name, points in self._bus_curves():
            self.known.add(name)
            if is_wanted(name, self._wanted):
                self._points[name] = points
        return [
            Curve(name, self._points[name], measured_unit(name) or self._units.get(name, ""))
            for name in sorted(self._points)
        ]

    def _add(self, name: str, at_ns: int, value: float) -> None:
        if self._from_ns is not None and at_ns < self._from_ns:
            return
        self._count += 1
        if self._count > MOST_POINTS:
            raise ConfigError(f"these are more than {MOST_POINTS} values: choose fewer curves, or a shorter time")
        self._points[name].append((at_ns / NS, value))

    def _take_sample(self, message: RecordedMessage, *, is_early: bool) -> None:
        metadata = message.channel.metadata
        topic, slot, port = metadata.get("topic", ""), message.slot, metadata["port"]
        ends = [f"{slot}.{port}", *self._listeners[topic]]
        seen = self._looked.get((topic, slot, port))
        if seen is False or (seen is True and is_early):
            return
        decoded = self._decoder.fields(message)
        if decoded is None:
            self.unread[message.topic] += 1
        fields = flat_fields(decoded or {})
        is_any_wanted = False
        for field, value in fields:
            number = number_of(value)
            if number is None or isinstance(value, str):
                continue
            for end in ends:
                own_slot, _, own_port = end.rpartition(".")
                name = port_curve(own_slot, own_port, field)
                if seen is None:
                    self.known.add(name)
                    self._units[name] = self._unit_of(metadata.get("type", ""), field)
                if is_wanted(name, self._wanted):
                    is_any_wanted = True
                    self._add(name, message.at_ns, number)
        if seen is None and fields:
            self._looked[topic, slot, port] = is_any_wanted

    def _take_slot(self, message: RecordedMessage) -> None:
        value = _object_of(message)
        slot, ports, settings = value.get("slot"), value.get("ports"), value.get("settings")
        if not isinstance(slot, str):
            return
        for port in ports if isinstance(ports, list) else ():
            if isinstance(port, dict) and not port.get("publishes") and isinstance(port.get("topic"), str):
                self._listeners[port["topic"]][f"{slot}.{port.get('port')}"] = None
                self._looked = {key: seen for key, seen in self._looked.items() if key[0] != port["topic"]}
        for name, text in (settings if isinstance(settings, dict) else {}).items():
            number = number_of(text)
            curve = setting_curve(slot, str(name))
            if number is None:
                continue
            self.known.add(curve)
            if not is_wanted(curve, self._wanted):
                continue
            self._units.setdefault(curve, self._unit_of(f":{value.get('part_number')}", str(name)))
            at_ns = max(message.at_ns, self._from_ns or message.at_ns)
            before = self._settings.get(curve)
            if before is not None and before != number:
                self._add(curve, at_ns - 1, before)  # it jumps
            if before != number:
                if at_ns == self._from_ns:
                    self._points[curve].clear()  # of what was set before the time, the last holds
                self._settings[curve] = number
                self._add(curve, at_ns, number)

    def _take_measured(self, message: RecordedMessage) -> None:
        value = _object_of(message)
        found = {LATE: value.get("late_ms"), LATENCY: value.get("latency_ms")}
        for key, curve in (("beats", beat_curve), ("acks_ms", ack_curve)):
            slots = value.get(key)
            found |= {curve(str(slot)): one for slot, one in (slots if isinstance(slots, dict) else {}).items()}
        for name, one in found.items():
            number = number_of(one)
            if number is not None:
                self.known.add(name)
                if is_wanted(name, self._wanted):
                    self._add(name, message.at_ns, number)

    def _take_frame(self, message: RecordedMessage, *, is_early: bool) -> None:
        bus = self._buses.get(message.topic)
        if bus is None:
            rates = [number_of(message.channel.metadata.get(name)) for name in (BITRATE, DATA_BITRATE)]
            bus = self._buses[message.topic] = _Bus(rates[0] or 0.0, rates[1])
        if not is_early and self._wanted & {BUS, FRAMES}:
            bus.take(message)

    def _bus_curves(self) -> Iterator[tuple[str, list[Point]]]:
        if self._buses:
            yield FRAMES, _summed(bus.frames for bus in self._buses.values())
        busy = [bus for bus in self._buses.values() if bus.bitrate]
        if busy:
            shares = _summed(bus.busy_s for bus in busy)
            yield BUS, [(at, 100 * share / len(busy)) for at, share in shares]


class _Bus:
    """The traffic of one link, a second at a time."""

    def __init__(self, bitrate: float, data_bitrate: float | None) -> None:
        self.bitrate = bitrate
        self._data_bitrate = data_bitrate
        self.frames: dict[int, float] = {}
        """Second since 1970 -> frames."""
        self.busy_s: dict[int, float] = {}

    def take(self, message: RecordedMessage) -> None:
        """One frame."""
        second = message.at_ns // NS
        self.frames[second] = self.frames.get(second, 0.0) + 1
        frame = frame_of(message) if self.bitrate else None
        if frame is not None:
            seconds = busy_seconds(frame, self.bitrate, self._data_bitrate)
            self.busy_s[second] = self.busy_s.get(second, 0.0) + seconds


def _summed(parts: Iterable[Mapping[int, float]]) -> list[Point]:
    """The sums of whole seconds; a second in which nothing came is 0, the first and the last are not whole."""
    sums: dict[int, float] = defaultdict(float)
    for part in parts:
        for second, value in part.items():
            sums[second] += value
    if not sums:
        return []
    return [(second + 1.0, sums[second]) for second in range(min(sums) + 1, max(sums))]


def _object_of(message: RecordedMessage) -> Mapping[str, object]:
    try:
        found = read_json(message.data)
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}


# The units of curves, which the part library knows and recordings do not.


_PLACE = re.compile(r"\[\d+\]")
"""Of an element in its list: all have the unit of the list."""


def units_of(library: Library) -> UnitOf:
    """The units of messages' fields and of parts' settings."""
    known = {
        (name, field_name(field)): unit for name in library.messages for field, unit in library.units(name).items()
    }
    known |= {(f":{entry.number}", one.name): one.unit for entry in library for one in entry.parameters if one.unit}

    def unit_of(kind: str, field: str) -> str:
        field = _PLACE.sub("", field)
        return known.get((kind, field), "") or known.get((kind, field_name(field)), "")

    return unit_of
