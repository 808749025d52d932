"""Drivers of inputs on a generic board: contacts, pulses, knobs, keys, 1-Wire (docs/reference/generic_board.md)."""

import time

from machine import Pin

from .driver import Driver, Fault

_KEPT = 32  # changes that may wait for the loop
_TRIGGER_US = 10
_ECHO_US = 36000  # a longer pulse is no echo: the sensor has given up
_FAR_M = 10.0
_KEYS = ("123A", "456B", "789C", "*0#D")
_STEPS = (0, -1, 1, 0, 1, 0, 0, -1, -1, 0, 0, 1, 0, 1, -1, 0)  # quadrature: by old and new levels
_CONVERSION_MS = 750  # DS18B20 at 12 bits


def _input(pin, pull="none"):
    pulls = {"up": Pin.PULL_UP, "down": Pin.PULL_DOWN}
    return Pin(pin, Pin.IN, pulls[pull]) if pull in pulls else Pin(pin, Pin.IN)


class _Watched:
    """An input whose changes call a function."""

    def __init__(self, pin, function, pull="none", edges=None):
        self.pin = _input(pin, pull)
        self.pin.irq(handler=function, trigger=edges or Pin.IRQ_RISING | Pin.IRQ_FALLING)

    def close(self):
        self.pin.irq(handler=None)


class Switch(Driver):
    """One input; every change is noted when it happens."""

    samples = True
    poll = 20

    def open(self):
        self._changes = []
        self._low = self.options.get("active_low", False)
        self._watched = self.keep(_Watched(self.pins["s"], self._changed, self.options.get("pull", "none")))

    def _changed(self, pin):
        if len(self._changes) < _KEPT:
            self._changes.append(pin.value())

    def sample(self, values):
        changes, self._changes = self._changes, []
        changes.append(self._watched.pin.value())
        return [{self.sources[0]: bool(level) != self._low} for level in changes]


class Ultrasonic(Driver):
    """HC-SR04: how long the echo pin is high. The board waits for it: 2 ms at 30 cm, 25 ms at 4 m."""

    samples = True

    def open(self):
        self._trigger = Pin(self.pins["trigger"], Pin.OUT, value=0)
        self._echo = _input(self.pins["echo"])

    def close(self):
        super().close()
        if hasattr(self, "_trigger"):
            self._trigger.init(Pin.IN)

    def sample(self, values):
        from machine import time_pulse_us

        self._trigger.value(1)
        time.sleep_us(_TRIGGER_US)
        self._trigger.value(0)
        us = time_pulse_us(self._echo, 1, _ECHO_US)
        if us == -2:
            words = "the {} at pins {} (trigger) and {} (echo) does not answer: check its 5 V, ground, and both wires"
            raise Fault(words.format(self.number, self.pins["trigger"], self.pins["echo"]))
        metres = _FAR_M if us < 0 else us * self.options.get("sound_m_s", 343) / 2000000
        return {self.sources[0]: metres}


class Wheel(Driver):
    """Pulses, counted by interrupts; one sensor cannot tell the direction."""

    samples = True

    def open(self):
        self._pulses = self._seen = 0
        self._seen_at = time.ticks_ms()
        self.keep(_Watched(self.pins["s"], self._count, edges=Pin.IRQ_RISING))

    def _count(self, _pin):
        self._pulses += 1

    def sample(self, values):
        pulses, now = self._pulses, time.ticks_ms()
        passed = time.ticks_diff(now, self._seen_at)
        name, speed, per_turn, inverted = self.sources
        measured = {name: -pulses if values[inverted] else pulses}
        if passed > 0:
            measured[speed] = (pulses - self._seen) / float(values[per_turn]) * 60000 / passed
            self._seen, self._seen_at = pulses, now
        return measured


class Knob(Driver):
    """A rotary encoder with clicks (four steps each); contacts and button close to ground."""

    samples = True
    poll = 20

    def open(self):
        self._steps = 0
        self._clk = self.keep(_Watched(self.pins["clk"], self._turned, "up"))
        self._dt = self.keep(_Watched(self.pins["dt"], self._turned, "up"))
        self._button = _input(self.pins["sw"], "up")
        self._levels = self._look()

    def _look(self):
        return self._clk.pin.value() << 1 | self._dt.pin.value()

    def _turned(self, _pin):
        levels = self._look()
        self._steps += _STEPS[self._levels << 2 | levels]
        self._levels = levels

    def sample(self, values):
        clicks = abs(self._steps) // 4 * (1 if self._steps > 0 else -1)
        return {self.sources[0]: clicks, self.sources[1]: not self._button.value()}


class Keypad(Driver):
    """16 keys; one row at a time is driven low, the others float."""

    samples = True
    poll = 20

    def open(self):
        self._rows = [_input(self.pins["r{}".format(row)], "up") for row in range(1, 5)]
        self._columns = [_input(self.pins["c{}".format(column)], "up") for column in range(1, 5)]

    def sample(self, values):
        pressed = "none"
        for row, keys in zip(self._rows, _KEYS):
            row.init(Pin.OUT, value=0)
            low = [key for key, column in zip(keys, self._columns) if not column.value()]
            row.init(Pin.IN, Pin.PULL_UP)
            if low and pressed == "none":
                pressed = low[0]
        return {self.sources[0]: pressed}


class OneWireThermometer(Driver):
    """DS18B20; the first of several on the wire. A measurement takes 0.75 s, in which the board does not wait."""

    samples = True

    def open(self):
        import ds18x20
        import onewire

        self._sensor = ds18x20.DS18X20(onewire.OneWire(Pin(self.pins["data"])))
        found = self._sensor.scan()
        if not found:
            words = "no DS18B20 answers at pin {}: check its supply, and the 4.7 kilo-ohms between data and supply"
            raise Fault(words.format(self.pins["data"]))
        self._rom = found[0]
        self._begin()

    def _begin(self):
        self._sensor.convert_temp()
        self._at = time.ticks_ms()

    def sample(self, values):
        if time.ticks_diff(time.ticks_ms(), self._at) < _CONVERSION_MS:
            return None
        celsius = self._sensor.read_temp(self._rom)
        if celsius is None or celsius == 85.0:
            raise Fault("the DS18B20 at pin {} had no power in between".format(self.pins["data"]))
        self._begin()
        return {self.sources[0]: celsius}


class Dht22(Driver):
    """Warmth and moisture of the air; MicroPython's own driver reads the pulses."""

    samples = True

    def open(self):
        import dht

        self._sensor = dht.DHT22(Pin(self.pins["data"]))

    def sample(self, values):
        self._sensor.measure()
        return {self.sources[0]: self._sensor.temperature(), self.sources[1]: self._sensor.humidity()}

    def words(self, error):
        words = "no DHT22 answers at pin {}: check its supply and its wire, and ask it every 2 s at most"
        return super().words(error) if isinstance(error, Fault) else words.format(self.pins["data"])


DRIVERS = {
    "switch": Switch,
    "ultrasonic": Ultrasonic,
    "wheel": Wheel,
    "knob": Knob,
    "keypad": Keypad,
    "onewire": OneWireThermometer,
    "dht22": Dht22,
}
