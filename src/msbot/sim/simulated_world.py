"""The little world of one simulated part: controls, messages and settings in, readings and what to say out. Pure."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import replace
from random import Random

from msbot.config import Direction, FieldKind, Output, PartType, Port, Scalar, Simulator, format_text
from msbot.part.messages.wire_types import FLOAT32_MAX
from msbot.sim.simulated_reading import Gauge, as_number, number

STEP_S = 0.02
"""Longest step in which something that moves is computed."""
MOST_STEPS = 250
"""Longest series of steps; a longer time is cut into this many."""
MOST_WAITING = 32
"""Changes that wait to be said; with more the oldest is dropped."""


class World:
    """Everything about a simulated part but its link to the robot."""

    def __init__(self, part_type: PartType, random: Random, *, ideal: bool = False) -> None:
        """Begin with everything at rest.

        Args:
            part_type: its simulator is the model.
            random: noise, and what readings draw.
            ideal: no noise and no lag is made: the real thing has its own. What a setting limits stays limited.
        """
        simulator = part_type.simulator or Simulator()
        self.forgotten = 0
        """Changes that could not be said because too many were waiting."""
        self._ports = {port.name: port for port in part_type.ports}
        self._values: dict[str, Scalar] = {entry.name: entry.default for entry in part_type.parameters}
        self._values |= {control.name: control.start for control in simulator.controls}
        # At a port that publishes it is the number of the next message, from 1.
        self._values |= {f"#{port.name}": int(port.direction is Direction.PUBLISH) for port in part_type.ports}
        for port in part_type.ports:
            if port.direction is Direction.SUBSCRIBE and port.message is not None:
                rest = {name: kind.zero for name, kind in port.message.fields.items()} | dict(port.safe or {})
                self._values |= {f"{port.name}.{name}": value for name, value in rest.items()}
        self._measured: dict[str, Scalar] = {}
        readings = [replace(reading, noise=0.0, lag_s=0.0) if ideal else reading for reading in simulator.readings]
        self._gauges = [Gauge(reading, random) for reading in readings]
        self._moves = any(gauge.moves for gauge in self._gauges)
        self._came_at: dict[str, float] = {}
        self._now: float | None = None
        self._mouths = [_Mouth(output, self._ports[output.port]) for output in simulator.outputs]
        self._evaluate(0.0, 0.0, final=True)

    def advance(self, now: float) -> None:
        """Let time pass until `now`."""
        if self._now is None:
            self._now = now
        passed_s = max(0.0, now - self._now)
        steps = min(MOST_STEPS, math.ceil(passed_s / STEP_S)) if self._moves else 1
        for step in range(1, steps + 1):
            self._evaluate(self._now + passed_s * step / steps, passed_s / steps, final=step == steps)
        if steps == 0:
            self._evaluate(now, 0.0, final=True)
        self._now = now

    def start_at(self, now: float) -> None:
        """The clock begins: nothing has happened before `now`."""
        self._now = now

    def value(self, source: str) -> Scalar:
        """What a source says."""
        return self._values[source]

    def set(self, source: str, value: Scalar, now: float) -> None:
        """Change a control or a parameter."""
        self.advance(now)
        self._values[source] = value
        self.advance(now)

    def feed(self, measured: Mapping[str, Scalar], now: float) -> None:
        """Take what was measured at the real thing: controls, or readings that are not computed any more then."""
        self.advance(now)
        names = {gauge.reading.name for gauge in self._gauges}
        self._measured |= {name: value for name, value in measured.items() if name in names}
        self._values |= measured
        self.advance(now)

    def settle(self, now: float) -> None:
        """Let everything that moves arrive at once: for a safe value there is no ramp."""
        self.advance(now)
        self._evaluate(now, math.inf, final=True)

    def receive(self, port: str, fields: Mapping[str, Scalar], now: float, *, counts: bool = True) -> None:
        """Take a message at a port that subscribes; `counts` is False for a safe value, which nobody has sent."""
        self.advance(now)
        self._values |= {f"{port}.{name}": value for name, value in fields.items()}
        if counts:
            self._values[f"#{port}"] = int(as_number(self._values[f"#{port}"])) + 1
        self._came_at[port] = now
        self.advance(now)

    def readings(self) -> dict[str, Scalar]:
        """What one would see, by name."""
        return {gauge.reading.name: self._values[gauge.reading.name] for gauge in self._gauges if gauge.reading.shown}

    @property
    def values(self) -> Mapping[str, Scalar]:
        """Every source by its name."""
        return self._values

    def join(self, now: float) -> None:
        """Begin to speak: every output is due."""
        self.advance(now)
        for mouth in self._mouths:
            mouth.begin(now)

    def look(self) -> None:
        """Note what has changed and must be said, even if it changes back before anybody can say it."""
        for mouth in self._mouths:
            if not mouth.look(self._values):
                self.forgotten += 1

    def say(self, now: float) -> list[tuple[str, dict[str, Scalar]]]:
        """The messages that are due, each with its port; time has been advanced before."""
        self.look()
        said = []
        for mouth in self._mouths:
            for fields in mouth.due(self._values, now):
                said.append((mouth.output.port, fields))
                self._values[f"#{mouth.output.port}"] = int(as_number(self._values[f"#{mouth.output.port}"])) + 1
        return said

    def _evaluate(self, now: float, step_s: float, *, final: bool) -> None:
        for gauge in self._gauges:
            if gauge.reading.name in self._measured:
                self._values[gauge.reading.name] = self._measured[gauge.reading.name]
                continue
            port = gauge.reading.follows.partition(".")[0].removeprefix("#")
            came_at = self._came_at.get(port)
            self._values[gauge.reading.name] = gauge.update(self._values, now, step_s, came_at, final=final)


class _Mouth:
    """One output: what it said last and when it speaks again."""

    def __init__(self, output: Output, port: Port) -> None:
        self.output = output
        self._kinds = port.message.fields if port.message is not None else {}
        self._said: dict[str, Scalar] | None = None
        self._next_at = 0.0
        self._waiting: deque[dict[str, Scalar]] = deque(maxlen=MOST_WAITING)

    def begin(self, now: float) -> None:
        """Speak at the next chance."""
        self._said = None
        self._next_at = now
        self._waiting.clear()

    def look(self, values: Mapping[str, Scalar]) -> bool:
        """Queue what has changed; False when an older change had to be dropped for it."""
        if not self.output.on_change or self._is_silent(values):
            return True
        fields = self._fields(values)
        if self._said is not None and not self._differs(fields, values):
            return True
        self._said = fields
        full = len(self._waiting) == MOST_WAITING
        self._waiting.append(fields)
        return not full

    def due(self, values: Mapping[str, Scalar], now: float) -> list[dict[str, Scalar]]:
        """What is said now."""
        said = list(self._waiting)
        self._waiting.clear()
        period_s = number(self.output.every, values)
        # A period that was shortened holds at once.
        self._next_at = min(self._next_at, now + period_s)
        if period_s > 0 and now >= self._next_at - 1e-9:
            behind = max(0.0, now - self._next_at)
            self._next_at += (behind // period_s + 1) * period_s
            if not said and not self._is_silent(values):
                fields = self._fields(values)
                if self._said is None or self._differs(fields, values):
                    self._said = fields
                said.append(self._said)  # what has hardly changed is said again as it was
        return said

    def _is_silent(self, values: Mapping[str, Scalar]) -> bool:
        return bool(self.output.only_if) and not values[self.output.only_if]

    def _fields(self, values: Mapping[str, Scalar]) -> dict[str, Scalar]:
        return {name: fit(self._kinds[name], _said(source, values)) for name, source in self.output.fields.items()}

    def _differs(self, fields: Mapping[str, Scalar], values: Mapping[str, Scalar]) -> bool:
        assert self._said is not None
        least = number(self.output.change, values)
        for name, value in fields.items():
            before = self._said[name]
            if value == before:
                continue
            if isinstance(value, float) and isinstance(before, float) and abs(value - before) < least:
                continue
            return True
        return False


def fit(kind: FieldKind, value: Scalar) -> Scalar:
    """A value as a field of a message takes it: rounded, limited, or as text."""
    match kind:
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


def _said(source: Scalar, values: Mapping[str, Scalar]) -> Scalar:
    """What a source, a text with sources in it or a fixed value says."""
    if not isinstance(source, str):
        return source
    return format_text(source, values) if "{" in source else values[source]
