"""What a part's settings mean and what it publishes, as its type says: the model of a part on a generic board.

The same rules as `msbot.sim` on a computer, without noise and lag, which a real part has by itself. The document of the
part (`board_document` of `msbot.config`) says what is in it: values, settings, readings, outputs. Times are in ms.
"""

import math

_STEP = 20  # ms: the longest step in which movement is computed
_STEPS = 250
_WAITING = 32


def number(value):
    """A value as a number: true is 1, a text is the number in it or 0, and a value that is not finite is 0."""
    try:
        value = float(value)
    except (ValueError, TypeError):
        return 0.0
    return value if math.isfinite(value) else 0.0


class _Gauge:
    """One reading with its memory."""

    def __init__(self, reading):
        self.get = reading.get
        self.name = reading["name"]
        self.moves = bool(reading.get("integrate") or reading.get("slew_per_s"))
        self._counts = self.moves or any(key in reading for key in ("negate", "function", "scale", "offset"))
        self._counts = self._counts or "divide_by" in reading
        self._state = self._found = None

    def update(self, values, now, step_s, came_at):
        get = self.get
        value = self._taken(values, now, came_at)
        if get("pattern"):
            import re

            found = re.search(get("pattern"), str(value))
            if found:
                self._found = found.group(1) or ""
            value = self._found
            if value is None:
                value = get("start", "")
        if get("equals") is not None:
            return _same(value, get("equals"))
        if get("above") is not None:
            return number(value) > _number(get("above"), values)
        if isinstance(value, (bool, str)) and not self._counts:
            return value
        return self._measure(number(value), values, step_s)

    def _taken(self, values, now, came_at):
        follows, start = self.get("follows"), self.get("start")
        value = values[follows]
        rest = type(value)() if start is None else start
        lasts = _number(self.get("lasts", 0.0), values)
        if lasts > 0 and (came_at is None or now - came_at >= lasts * 1000):
            return rest
        return rest if start is not None and came_at is None and "." in follows else value

    def _measure(self, value, values, step_s):
        get = self.get
        if get("negate") and values[get("negate")]:
            value = -value
        if get("function"):
            value = getattr(math, get("function"))(math.radians(value))
        value = value * _number(get("scale", 1.0), values) + _number(get("offset", 0.0), values)
        value /= _number(get("divide_by", 1.0), values) or 1.0
        if get("integrate"):
            value = (self._state or 0.0) + value * step_s
        wrap = _number(get("wrap") or 0.0, values)
        if wrap > 0:
            value %= wrap
        if get("least") is not None:
            value = max(value, _number(get("least"), values))
        if get("most") is not None:
            value = min(value, _number(get("most"), values))
        slew = _number(get("slew_per_s", 0.0), values)
        if not get("integrate") and self.moves:
            before = self._state
            if before is None:
                before = value if get("start") is None else number(get("start"))
            if slew > 0:
                value = before + min(slew * step_s, max(-slew * step_s, value - before))
        if not math.isfinite(value):
            value = self._state or 0.0
        self._state = value
        step = _number(get("step", 0.0), values)
        return round(round(value / step) * step, 9) if step > 0 else value


class _Mouth:
    """One output: what it published last, and when it publishes again."""

    def __init__(self, output):
        self.get = output.get
        self.port = output["port"]
        self.waiting = []
        self._said = None
        self._next = 0

    def begin(self, now):
        self._said = None
        self._next = now
        self.waiting = []

    def look(self, values, rounded):
        """Note what has changed."""
        if not self.get("on_change") or self._is_silent(values):
            return
        fields = self._fields(values, rounded)
        if self._said is None or self._differs(fields, values):
            self._said = fields
            self.waiting = self.waiting[1 - _WAITING :] + [fields]

    def due(self, values, rounded, now):
        said, self.waiting = self.waiting, []
        period = int(_number(self.get("every", 0.0), values) * 1000 + 0.5)
        self._next = min(self._next, now + period)
        if period > 0 and now >= self._next:
            self._next += ((now - self._next) // period + 1) * period
            if not said and not self._is_silent(values):
                fields = self._fields(values, rounded)
                if self._said is None or self._differs(fields, values):
                    self._said = fields
                said.append(self._said)
        return said

    def _is_silent(self, values):
        return bool(self.get("only_if")) and not values[self.get("only_if")]

    def _fields(self, values, rounded):
        return {name: rounded(self.port, name, _said(source, values)) for name, source in self.get("fields").items()}

    def _differs(self, fields, values):
        least = _number(self.get("change", 0.0), values)
        for name, value in fields.items():
            before = self._said[name]
            if value != before and not (isinstance(value, float) and abs(value - before) < least):
                return True
        return False


class Model:
    """The model of one part; `fit(port, field, value)` gives a value the form of a message's field."""

    def __init__(self, document, fit):
        self.values = dict(document.get("values", ()))
        for name, port in document["ports"].items():
            comes_in = port[0]
            self.values["#" + name] = 0 if comes_in else 1
            safe = port[3] if len(port) > 3 else {}
            for pair in port[2].split(" ") if comes_in and port[2] else ():
                field, _, code = pair.partition(":")
                zero = {"s": "", "?": False, "f": 0.0, "d": 0.0}.get(code, 0)
                self.values["{}.{}".format(name, field)] = safe.get(field, zero)
        self._settings = document.get("settings", ())
        self._limits = document.get("limits", {})
        self._defaults = {name: self.values[name] for name in self._settings}
        self._gauges = [_Gauge(reading) for reading in document.get("readings", ())]
        self._moves = any([gauge.moves for gauge in self._gauges])
        self._mouths = [_Mouth(output) for output in document.get("outputs", ())]
        self._fit = fit
        self._came = {}
        self._now = None
        self._evaluate(0, 0.0)

    def advance(self, now):
        """Let time pass."""
        if self._now is None:
            self._now = now
        before, passed = self._now, max(0, now - self._now)
        steps = min(_STEPS, -(-passed // _STEP)) if self._moves and passed else 1
        for step in range(1, steps + 1):
            self._evaluate(before + passed * step // steps, passed / 1000 / steps)
        self._now = now

    def settle(self, now):
        """Let everything that moves arrive at once: a safe value has no ramp."""
        self.advance(now)
        self._evaluate(now, float("inf"))

    def feed(self, measured, now):
        """Take what was measured."""
        self.advance(now)
        self.values.update(measured)
        self.advance(now)

    def receive(self, port, fields, now, counts=True):
        """Take a message, or a safe value, which does not count."""
        self.advance(now)
        for field, value in fields.items():
            self.values["{}.{}".format(port, field)] = value
        self.values["#" + port] += counts
        self._came[port] = now
        self.advance(now)

    def settings(self, texts, now):
        """Take the slot's settings; one that makes no sense here changes nothing."""
        self.advance(now)
        for name in self._settings:
            self.values[name] = self._parsed(name, texts.get(name))
        self.advance(now)
        self.look()

    def begin(self, now):
        """Publish all at the next opportunity."""
        self.advance(now)
        for mouth in self._mouths:
            mouth.begin(now)

    def look(self):
        """Note what has changed and must be published, even if it changes back before that can happen."""
        for mouth in self._mouths:
            mouth.look(self.values, self._fit)

    def say(self, now):
        """The messages that are due: pairs of port and fields."""
        self.look()
        said = []
        for mouth in self._mouths:
            for fields in mouth.due(self.values, self._fit, now):
                said.append((mouth.port, fields))
                self.values["#" + mouth.port] += 1
        return said

    def period(self):
        """The shortest time between two publications that is set now, ms; None: only changes are published."""
        times = [int(_number(mouth.get("every", 0.0), self.values) * 1000 + 0.5) for mouth in self._mouths]
        return min([time for time in times if time > 0], default=None)

    def _parsed(self, name, text):
        default = self._defaults[name]
        if text is None or isinstance(default, str):
            return default if text is None else text
        if isinstance(default, bool):
            return {"true": True, "false": False}.get(text, default)
        try:
            value = float(text) if isinstance(default, float) else int(text)
        except ValueError:
            return default
        low, high = self._limits.get(name, (None, None))
        fits = (low is None or value >= low) and (high is None or value <= high) and math.isfinite(value)
        return value if fits else default

    def _evaluate(self, now, step_s):
        for gauge in self._gauges:
            port = gauge.get("follows").partition(".")[0].lstrip("#")
            self.values[gauge.name] = gauge.update(self.values, now, step_s, self._came.get(port))


def _number(operand, values):
    return number(values[operand]) if isinstance(operand, str) else operand


def _same(value, wanted):
    if isinstance(value, str) and not isinstance(wanted, str):
        return bool(value) and number(value) == wanted
    return value == wanted


def _said(source, values):
    return values[source] if isinstance(source, str) else source
