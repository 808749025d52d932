"""The little world of one simulated part: controls, messages and settings in, readings and messages out. Pure."""

from __future__ import annotations

import json
import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from random import Random

from msbot.config import (
    BoundedText,
    Direction,
    EnumType,
    FieldKind,
    FieldType,
    LeafType,
    ListType,
    MessageType,
    Output,
    PartType,
    Port,
    Scalar,
    Simulator,
    format_text,
    sources_in,
)
from msbot.config.library.simulator import FieldSource, scalars_of
from msbot.part.messages.wire_types import FLOAT32_MAX
from msbot.sim.simulated_reading import SimulatedReading, as_number, number

STEP_S = 0.02
"""Longest time step in which movement is computed."""
MOST_STEPS = 250
"""Most steps for one advance; a longer time is divided into this many."""
MOST_WAITING = 32
"""Most changes that wait to be published; beyond that the oldest is dropped."""


class PartModel:
    """Everything about a simulated part but its link to the robot."""

    def __init__(self, part_type: PartType, random: Random, *, ideal: bool = False) -> None:
        """Start with everything at rest.

        Args:
            part_type: its simulator is the model.
            random: the source of noise and of whatever readings draw.
            ideal: add no noise and no lag, because the real device has its own. Limits from settings still apply.
        """
        simulator = part_type.simulator or Simulator()
        self.forgotten = 0
        """Changes that were never published because too many were waiting."""
        self._ports = {port.name: port for port in part_type.ports}
        self._values: dict[str, Scalar] = {entry.name: entry.default for entry in part_type.parameters}
        self._values |= {control.name: control.start for control in simulator.controls}
        # For a port that publishes, this is the number of the next message, from 1.
        self._values |= {f"#{port.name}": int(port.direction is Direction.PUBLISH) for port in part_type.ports}
        for port in part_type.ports:
            if port.direction is Direction.SUBSCRIBE and port.message is not None:
                rest = {name: kind.zero for name, kind in port.message.leaves.items()} | dict(port.safe or {})
                self._values |= {f"{port.name}.{name}": value for name, value in rest.items()}
        self._measured: dict[str, Scalar] = {}
        readings = [replace(reading, noise=0.0, lag_s=0.0) if ideal else reading for reading in simulator.readings]
        self._gauges = [SimulatedReading(reading, random) for reading in readings]
        self._moves = any(gauge.moves for gauge in self._gauges)
        self._needs_steps = self._is_coarse_in_one_step()
        """What moves must be computed in short steps."""
        self._is_restless = any(gauge.is_restless for gauge in self._gauges)
        """Something changes for ever by itself."""
        self._is_moving = self._is_under_way = True
        """Something moves; something will change by itself, once or for a while."""
        self._is_changed = True
        """Something has changed of which the readings do not know yet."""
        self._came_at: dict[str, float] = {}
        self._now: float | None = None
        self._mouths = [_OutputState(output, self._ports[output.port], self._gauges) for output in simulator.outputs]
        named = set().union(*(gauge.sources() for gauge in self._gauges), *(mouth.sources() for mouth in self._mouths))
        self._counted = frozenset(name for name in named if name.startswith("#"))
        """The numbers of messages that something depends on."""
        self._expiring = frozenset(gauge.port for gauge in self._gauges if gauge.reading.lasts)
        """Ports of which something depends on when their message came."""
        self._evaluate(0.0, 0.0, final=True)

    def advance(self, now: float) -> None:
        """Let time pass until `now`."""
        if self._now is None:
            self._now = now
        if not self._is_changed and (now == self._now or not (self._is_restless or self._is_under_way)):
            self._now = now
            return
        passed_s = max(0.0, now - self._now)
        moves = self._is_moving or (self._moves and self._is_changed)
        steps = 1
        if moves:
            steps = min(MOST_STEPS if self._needs_steps else 1, math.ceil(passed_s / STEP_S))
        for step in range(1, steps + 1):
            self._evaluate(self._now + passed_s * step / steps, passed_s / steps, final=step == steps)
        if steps == 0:
            self._evaluate(now, 0.0, final=True)
        self._now = now

    def start_at(self, now: float) -> None:
        """Start the clock: nothing has happened before `now`."""
        self._now = now

    def value(self, source: str) -> Scalar:
        """The value of a source."""
        return self._values[source]

    def set(self, source: str, value: Scalar, now: float) -> None:
        """Change a control or a parameter."""
        self.advance(now)
        self._values[source] = value
        self._is_changed = True
        self.advance(now)

    def feed(self, measured: Mapping[str, Scalar], now: float) -> list[str]:
        """Take values measured at the real device: controls, or readings, which are then no longer computed.

        Returns:
            The names that are no sources of the model; their values are not taken.
        """
        self.advance(now)
        unknown = [name for name in measured if name not in self._values]
        measured = {name: value for name, value in measured.items() if name in self._values}
        names = {gauge.reading.name for gauge in self._gauges}
        self._measured |= {name: value for name, value in measured.items() if name in names}
        self._values |= measured
        self._is_changed = True
        self.advance(now)
        return unknown

    def jump_to_targets(self, now: float) -> None:
        """Let everything that moves arrive at once: a safe value has no ramp."""
        self.advance(now)
        self._evaluate(now, math.inf, final=True)

    def receive(self, port: str, fields: Mapping[str, Scalar], now: float, *, counts: bool = True) -> bool:
        """Take a message at a subscribing port; False: it says what is known, and changes nothing.

        `counts` is False for a safe value, which nobody has sent.
        """
        self.advance(now)
        values, count = self._values, f"#{port}"
        told = {f"{port}.{name}": value for name, value in fields.items()}
        is_news = (
            port not in self._came_at
            or port in self._expiring
            or count in self._counted
            or any(values[name] != value or type(values[name]) is not type(value) for name, value in told.items())
        )
        values |= told
        if counts:
            values[count] = int(as_number(values[count])) + 1
        self._came_at[port] = now
        if is_news:
            self._is_changed = True
            self.advance(now)
        return is_news

    def readings(self) -> dict[str, Scalar]:
        """What one would see, by name."""
        return {gauge.reading.name: self._values[gauge.reading.name] for gauge in self._gauges if gauge.reading.shown}

    @property
    def values(self) -> Mapping[str, Scalar]:
        """Every source by its name."""
        return self._values

    def join(self, now: float, due_at: float | None = None) -> None:
        """Begin to publish.

        Args:
            now: the time.
            due_at: when every output is due, and from when its periods count; `now` if absent.
        """
        self.advance(now)
        for mouth in self._mouths:
            mouth.begin(now if due_at is None else due_at)

    def note_changes(self) -> None:
        """Note what has changed and must be published, even if it changes back before that can happen."""
        for mouth in self._mouths:
            if not mouth.look(self._values):
                self.forgotten += 1

    def due_messages(self, now: float) -> list[tuple[str, dict[str, Scalar]]]:
        """The messages that are due, each with its port; call `advance` first."""
        self.note_changes()
        said = []
        for mouth in self._mouths:
            count = f"#{mouth.output.port}"
            for fields in mouth.due(self._values, now):
                said.append((mouth.output.port, fields))
                self._values[count] = int(as_number(self._values[count])) + 1
                self._is_changed = self._is_changed or count in self._counted
        return said

    def quiet_until(self, now: float, is_heard: Callable[[str], bool] = lambda _: True) -> float:
        """When a port that is heard may have something to say next, if nothing comes from outside before.

        Args:
            now: the time; the result is this if the ports must be looked at often.
            is_heard: whether what that port says goes anywhere.
        """
        heard = [
            mouth for mouth in self._mouths if is_heard(mouth.output.port) or f"#{mouth.output.port}" in self._counted
        ]
        if any(mouth.output.on_change and (self._is_changed or mouth.may_change(self._values)) for mouth in heard):
            return now
        at = min((mouth.next_at(self._values) for mouth in heard), default=math.inf)
        # What moves is computed in steps of limited number: a longer rest would make them coarser.
        return min(at, now + MOST_STEPS * STEP_S) if self._is_moving and self._needs_steps else at

    def _is_coarse_in_one_step(self) -> bool:
        """Whether something moves after what changes by itself meanwhile.

        After a source that stays as it is, one step of any length comes to the same as many short ones: a lag's steps
        multiply, a slew's and an integral's add up. That is not so with a lag and a slew in one reading.
        """
        by_name = {gauge.reading.name: gauge for gauge in self._gauges}
        for gauge in self._gauges:
            if not gauge.moves:
                continue
            if gauge.changes_by_itself or (gauge.reading.lag_s and gauge.reading.slew_per_s):
                return True
            sources, seen = gauge.sources(), set[str]()
            while sources:
                seen |= sources
                found = [by_name[name] for name in sources if name in by_name]
                if any(one.moves or one.is_restless or one.changes_by_itself for one in found):
                    return True
                sources = set().union(*(one.sources() for one in found)) - seen
        return False

    def _evaluate(self, now: float, step_s: float, *, final: bool) -> None:
        values, measured, came_at = self._values, self._measured, self._came_at
        self._is_moving = self._is_under_way = False
        for gauge in self._gauges:
            name = gauge.reading.name
            if name in measured:
                values[name] = measured[name]
                gauge.is_under_way = False
            else:
                values[name] = gauge.update(values, now, step_s, came_at.get(gauge.port), final=final)
            if gauge.is_under_way:
                self._is_under_way = True
                self._is_moving = self._is_moving or gauge.moves
        self._is_changed = False


class _OutputState:
    """One output: what it published last and when it publishes again."""

    def __init__(self, output: Output, port: Port, gauges: Sequence[SimulatedReading]) -> None:
        self.output = output
        self._kinds = port.message.leaves if port.message is not None else {}
        self._said: dict[str, Scalar] | None = None
        self._next_at = 0.0
        self._waiting: deque[dict[str, Scalar]] = deque(maxlen=MOST_WAITING)
        # What it depends on, directly or not: a reading follows only those before it.
        sources, self._gauges = self.sources(), list[SimulatedReading]()
        for gauge in reversed(gauges):
            if gauge.reading.name in sources:
                self._gauges.append(gauge)
                sources |= gauge.sources()
        passed_on = set().union(*(gauge.sources() for gauge in self._gauges)) | self._conditions()
        self._noisy = [gauge for gauge in self._gauges if gauge.is_restless]
        self._is_restless = any(
            gauge.reading.random_every is not None or gauge.reading.name in passed_on for gauge in self._noisy
        )
        """A noise may change it in other ways than by its size."""

    def _conditions(self) -> set[str]:
        """The sources that its fields do not say as they are."""
        output = self.output
        texts = [text for text in output.scalars() if isinstance(text, str) and "{" in text]
        return {output.only_if} | set().union(*map(sources_in, texts))

    def sources(self) -> set[str]:
        """The names of what its messages depend on."""
        output = self.output
        plain = {source for source in output.scalars() if isinstance(source, str)}
        return plain | self._conditions() | {word for word in (output.every, output.change) if isinstance(word, str)}

    def begin(self, due_at: float) -> None:
        """Publish at that time, or at the next opportunity after it."""
        self._said = None
        self._next_at = due_at
        self._waiting.clear()

    def look(self, values: Mapping[str, Scalar]) -> bool:
        """Queue what has changed; False when an older change had to be dropped to make room."""
        if not self.output.on_change or self._is_silent(values):
            return True
        fields = self._fields(values)
        if self._said is not None and not self._differs(fields, values):
            return True
        self._said = fields
        full = len(self._waiting) == MOST_WAITING
        self._waiting.append(fields)
        return not full

    def may_change(self, values: Mapping[str, Scalar]) -> bool:
        """Whether it may have a change to publish though nothing comes from outside."""
        if self._is_restless or any(gauge.is_under_way for gauge in self._gauges):
            return True
        if not self._noisy or self._is_silent(values):
            return False
        return any(self._noise_differs(field, source, values) for field, source in self.output.fields.items())

    def _noise_differs(self, field: str, source: FieldSource, values: Mapping[str, Scalar]) -> bool:
        """Whether the noise of what a field says may count as a change."""
        if isinstance(source, tuple):
            noisy = {gauge.reading.name for gauge in self._noisy}
            return any(one in noisy for one in scalars_of(source))
        gauge = next((gauge for gauge in self._noisy if gauge.reading.name == source), None)
        if gauge is None:
            return False
        before, farthest = None if self._said is None else self._said[field], gauge.farthest(values)
        if farthest is None or not isinstance(before, float):
            return True
        value, off = farthest
        # A little less, because a field may have fewer digits.
        return abs(value - before) + off >= number(self.output.change, values) * (1 - 1e-6)

    def next_at(self, values: Mapping[str, Scalar]) -> float:
        """When it publishes next, if nothing changes; inf: not by the clock."""
        if self._waiting:
            return -math.inf
        return self._next_at if number(self.output.every, values) > 0 else math.inf

    def due(self, values: Mapping[str, Scalar], now: float) -> list[dict[str, Scalar]]:
        """The messages to publish now."""
        said = list(self._waiting)
        self._waiting.clear()
        period_s = number(self.output.every, values)
        # A shortened period takes effect at once.
        self._next_at = min(self._next_at, now + period_s)
        if period_s > 0 and now >= self._next_at - 1e-9:
            behind = max(0.0, now - self._next_at)
            self._next_at += (behind // period_s + 1) * period_s
            if not said and not self._is_silent(values):
                fields = self._fields(values)
                if self._said is None or self._differs(fields, values):
                    self._said = fields
                said.append(self._said)  # a value that has hardly changed is repeated as it was
        return said

    def _is_silent(self, values: Mapping[str, Scalar]) -> bool:
        return bool(self.output.only_if) and not values[self.output.only_if]

    def _fields(self, values: Mapping[str, Scalar]) -> dict[str, Scalar]:
        return {name: _field(self._kinds[name], source, values) for name, source in self.output.fields.items()}

    def _differs(self, fields: Mapping[str, Scalar], values: Mapping[str, Scalar]) -> bool:
        assert self._said is not None
        least = number(self.output.change, values)
        for name, value in fields.items():
            before = self._said[name]
            if value == before:
                continue
            if isinstance(value, float) and isinstance(before, float) and abs(value - before) < least:
                continue
            if isinstance(self._kinds[name], ListType) and _are_near(
                json.loads(str(value)), json.loads(str(before)), least
            ):
                continue
            return True
        return False


def fit(kind: LeafType, value: Scalar) -> Scalar:
    """A value in the form that a message field accepts: rounded, limited, or as text."""
    match kind:
        case BoundedText():
            octets = str(fit(FieldKind.TEXT, value)).encode()[: kind.most]
            return octets.decode(errors="ignore")
        case EnumType():
            at = value if isinstance(value, int) and not isinstance(value, bool) else -1
            named = kind.names[at] if 0 <= at < len(kind.names) else value
            return named if named in kind.names else kind.zero
        case ListType():
            return value if kind.fault(value) is None else kind.zero
        case FieldKind.BOOL:
            return bool(value)
        case FieldKind.TEXT:
            # Neither NUL nor half a character can travel.
            return format_text("{value}", {"value": value}).replace("\0", "").encode(errors="replace").decode()
        case FieldKind.FLOAT32:
            return min(FLOAT32_MAX, max(-FLOAT32_MAX, as_number(value)))
        case FieldKind.FLOAT64:
            return as_number(value)
        case _:
            least, most = kind.limits
            return min(most, max(least, round(as_number(value))))


def _field(kind: LeafType, source: FieldSource, values: Mapping[str, Scalar]) -> Scalar:
    """What a field says; a list is a JSON text, as everywhere where one value is expected."""
    if isinstance(kind, ListType) and isinstance(source, tuple):
        return json.dumps([_element(kind.element, one, values) for one in source])
    assert not isinstance(source, tuple)
    return fit(kind, _said(source, values))


def _element(kind: FieldType, source: FieldSource, values: Mapping[str, Scalar]) -> object:
    if isinstance(kind, MessageType):
        assert isinstance(source, tuple)
        return [_element(inner, one, values) for inner, one in zip(kind.fields.values(), source, strict=True)]
    return _field(kind, source, values)


def _are_near(value: object, before: object, least: float) -> bool:
    """Whether no number in two lists differs by as much as that."""
    if isinstance(value, list) and isinstance(before, list):
        return len(value) == len(before) and all(_are_near(*pair, least) for pair in zip(value, before, strict=True))
    if isinstance(value, float) and isinstance(before, float):
        return abs(value - before) < least
    return value == before


def _said(source: Scalar, values: Mapping[str, Scalar]) -> Scalar:
    """The value of a source, of a text with sources in it, or of a constant."""
    if not isinstance(source, str):
        return source
    return format_text(source, values) if "{" in source else values[source]
