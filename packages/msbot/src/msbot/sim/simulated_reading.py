"""How one reading follows its source: patterns, thresholds, lag, slew, noise. Pure: time comes in as steps.

The order of the steps is that of the fields of `msbot.config.Reading`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from random import Random

from msbot.config import Operand, Reading, Scalar, format_text, sources_in

Values = Mapping[str, Scalar]
"""Every source by its name."""


_FUNCTIONS = {"sin": math.sin, "cos": math.cos}

LARGEST_NOISE = 4.0
"""No measurement is further off than so many standard deviations."""

_OPERANDS = (
    "random_every",
    "lasts",
    "above",
    "scale",
    "offset",
    "divide_by",
    "wrap",
    "least",
    "most",
    "lag_s",
    "slew_per_s",
    "noise",
    "step",
)
"""The fields of a reading that may name a source instead of having a number."""


class SimulatedReading:
    """One reading with its memory."""

    def __init__(self, reading: Reading, random: Random) -> None:
        self.reading = reading
        self.moves = bool(reading.integrate or reading.lag_s or reading.slew_per_s)
        """Whether its value depends on the time between two updates."""
        self.is_restless = bool(reading.noise) or reading.random_every is not None
        """Whether it changes for ever by itself."""
        self.changes_by_itself = bool(reading.lasts)
        """Its source changes without a message: when the last one expires."""
        self.is_under_way = self.moves
        """It will change without a change of its sources: it has not followed them yet, or its message expires."""
        self.port = reading.follows.partition(".")[0].removeprefix("#")
        """The port that it follows, if it follows one."""
        self._waits = reading.start is not None and "." in reading.follows
        """It has a value of its own until a message has come."""
        # Most steps do nothing in most readings, and a robot updates thousands of them a second.
        self._is_scaled = (reading.scale, reading.divide_by) != (1.0, 1.0)
        self._is_numeric = self.moves or self._is_scaled or bool(reading.negate or reading.function or reading.offset)
        self._is_limited = reading.least is not None or reading.most is not None
        self._random = random
        self._pattern = re.compile(reading.pattern) if reading.pattern else None
        self.state: float | None = None
        """The value before noise and rounding."""
        self._found: str | None = None
        self._drawn_at: float | None = None

    def sources(self) -> set[str]:
        """The names of all sources that its value depends on."""
        reading = self.reading
        operands = {operand for name in _OPERANDS if isinstance(operand := getattr(reading, name), str)}
        return {reading.follows, reading.negate} - {""} | operands | sources_in(reading.text)

    def farthest(self, values: Values) -> tuple[float, float] | None:
        """The value without noise, and how far off a measurement may be; None: nothing has been measured."""
        if self.state is None:
            return None
        noise, step = number(self.reading.noise, values), number(self.reading.step, values)
        return self.state, LARGEST_NOISE * abs(noise) + abs(step) / 2

    def update(self, values: Values, now: float, step_s: float, came_at: float | None, *, final: bool) -> Scalar:
        """The reading's value now.

        Args:
            values: the sources.
            now: the time.
            step_s: seconds since the last update.
            came_at: when the message that it follows came; None = not yet, or it follows no message.
            final: False: an intermediate step, in which noise is left out.
        """
        reading = self.reading
        self.is_under_way = False
        if reading.text:
            return self._shown(format_text(reading.text, values))
        if reading.random_every is not None:
            return self._draw(values, now)
        value = self._taken(values, now, came_at) if self._waits or reading.lasts else values[reading.follows]
        if self._pattern is not None:
            value = self._pick(value)
        if reading.equals is not None:
            return _same(value, reading.equals)
        if reading.above is not None:
            return as_number(value) > number(reading.above, values)
        if isinstance(value, bool | str) and not self._is_numeric:
            return self._shown(value) if isinstance(value, str) else value
        return self._measure(as_number(value), values, step_s, final=final)

    def _taken(self, values: Values, now: float, came_at: float | None) -> Scalar:
        """The value of the source, or `start` before anything has come or when it has expired."""
        reading = self.reading
        value = values[reading.follows]
        lasts_s = number(reading.lasts, values)
        if lasts_s > 0 and (came_at is None or now - came_at >= lasts_s):
            return type(value)() if reading.start is None else reading.start
        self.is_under_way = lasts_s > 0
        if self._waits and came_at is None and reading.start is not None:
            return reading.start
        return value

    def _pick(self, value: Scalar) -> Scalar:
        """The part of a text that the pattern matches; a text without a match changes nothing."""
        assert self._pattern is not None
        found = self._pattern.search(str(value))
        if found is not None:
            self._found = found[1] or ""
        if self._found is None:
            return "" if self.reading.start is None else self.reading.start
        return self._found

    def _measure(self, value: float, values: Values, step_s: float, *, final: bool) -> float:
        reading = self.reading
        if reading.negate and values[reading.negate]:
            value = -value
        if reading.function:
            value = _FUNCTIONS[reading.function](math.radians(value))
        if self._is_scaled:
            value *= number(reading.scale, values)
        value += number(reading.offset, values)  # also if it is 0: there is no -0
        if self._is_scaled and (divisor := number(reading.divide_by, values)) != 0:
            value /= divisor
        if reading.integrate:
            self.is_under_way = self.is_under_way or value != 0
            value = (self.state or 0.0) + value * step_s
        if reading.wrap is not None and (wrap := number(reading.wrap, values)) > 0:
            value %= wrap
        if self._is_limited:
            value = self._limited(value, values)
        if self.moves and not reading.integrate:
            value = self._followed(value, values, step_s)
        if not math.isfinite(value):
            value = self.state or 0.0  # numbers too large to be multiplied: keep the last valid one
        self.state = value
        if final and reading.noise and (noise := number(reading.noise, values)):
            off = max(-LARGEST_NOISE, min(LARGEST_NOISE, self._random.gauss(0.0, 1.0)))
            value = self._limited(value + noise * off, values)
        return _stepped(value, number(reading.step, values)) if reading.step else value

    def _followed(self, value: float, values: Values, step_s: float) -> float:
        """The value after lag and slew; the first one applies at once."""
        if self.state is None:
            if self.reading.start is None:
                return value
            self.state = as_number(self.reading.start)
        before, target = self.state, value
        lag_s, slew = number(self.reading.lag_s, values), number(self.reading.slew_per_s, values)
        if lag_s > 0:
            value = value + (before - value) * math.exp(-step_s / lag_s)
        if slew > 0:
            most = slew * step_s
            value = before + min(most, max(-most, value - before))
        if value != target:
            self.is_under_way = True
        return value

    def _limited(self, value: float, values: Values) -> float:
        reading = self.reading
        if reading.least is not None:
            value = max(value, number(reading.least, values))
        if reading.most is not None:
            value = min(value, number(reading.most, values))
        return value

    def _draw(self, values: Values, now: float) -> float:
        assert self.reading.random_every is not None
        period_s = number(self.reading.random_every, values)
        if self.state is None or self._drawn_at is None or now - self._drawn_at >= period_s:
            self._drawn_at = now
            least, most = number(self.reading.least or 0.0, values), number(self.reading.most or 0.0, values)
            step = number(self.reading.step, values)
            drawn = self._random.uniform(0.0, most - least + step) - step / 2
            self.state = max(least, min(most, least + _stepped(drawn, step)))
        return self.state

    def _shown(self, text: str) -> str:
        """A text in the rows and columns of a display."""
        reading = self.reading
        if not (reading.rows or reading.columns):
            return text
        rows = text.split("\n")
        if reading.columns:
            rows = [row[: reading.columns] for row in rows]
        return "\n".join(rows[: reading.rows] if reading.rows else rows)


def _stepped(value: float, step: float) -> float:
    """The nearest multiple of the step; a step that is 0 or too small for the number changes nothing."""
    steps = value / step if step > 0 else math.inf
    # Rounded once more, because 3 x 0.1 is not 0.3.
    return round(round(steps) * step, 9) if math.isfinite(steps) else value


def number(operand: Operand, values: Values) -> float:
    """The number that an operand stands for."""
    return as_number(values[operand]) if isinstance(operand, str) else operand


def as_number(value: Scalar) -> float:
    """A value as a number: true is 1, a text is the number in it or 0, and a value that is not finite is 0."""
    try:
        result = float(value)
    except ValueError:
        return 0.0
    return result if math.isfinite(result) else 0.0


def _same(value: Scalar, wanted: Scalar) -> bool:
    """Whether two values are equal; a text that is a number counts as one."""
    if isinstance(value, str) and not isinstance(wanted, str):
        return bool(value) and as_number(value) == wanted
    return value == wanted
