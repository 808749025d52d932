"""Drivers of outputs on a generic board: lamps, relays, motors, servos (docs/reference/generic_board.md).

A driver is opened with every output off, and closed with every output off and its pins free.
"""

from machine import PWM, Pin

from .driver import Driver

_FULL = 65535
_LOWEST_HZ = 1
_FRAME_HZ = 50  # servos want a pulse every 20 ms
_FRAME_MS = 20


def share(value, most=100):
    """A value as a share of the maximum, 0 to 1."""
    return min(1.0, max(0.0, float(value) / most))


class _Dimmer:
    """A pin with PWM."""

    def __init__(self, pin, hertz, inverted=False):
        self._pin = Pin(pin, Pin.OUT, value=int(inverted))
        self._inverted = inverted
        self._pwm = PWM(self._pin, freq=int(hertz), duty_u16=_FULL if inverted else 0)

    def set(self, level):
        """A share of the time, 0 to 1."""
        duty = int(level * _FULL + 0.5)
        self._pwm.duty_u16(_FULL - duty if self._inverted else duty)

    def frequency(self, hertz):
        self._pwm.freq(int(hertz + 0.5))

    def close(self):
        self.set(0)
        self._pwm.deinit()
        self._pin.init(Pin.IN)


class _Output:
    """A pin that is switched."""

    def __init__(self, pin, inverted=False):
        self._inverted = inverted
        self._pin = Pin(pin, Pin.OUT, value=int(inverted))

    def set(self, on):
        self._pin.value(int(bool(on) != self._inverted))

    def close(self):
        self.set(False)
        self._pin.init(Pin.IN)


class Pwm(Driver):
    """One output with PWM."""

    drives = True

    def open(self):
        self._out = self.keep(
            _Dimmer(self.pins["s"], self.options.get("frequency_hz", 200), self.options.get("active_low", False))
        )

    def outputs_for(self, values):
        return share(values[self.sources[0]])

    def drive(self, wanted):
        self._out.set(wanted)


class Relay(Driver):
    """One output without PWM."""

    drives = True
    place = 0

    def open(self):
        self._out = self.keep(_Output(self.pins["s"], self.options.get("active_low", False)))

    def outputs_for(self, values):
        return bool(values[self.sources[self.place]])

    def drive(self, wanted):
        self._out.set(wanted)


class Shutter(Relay):
    """A relay that counts."""

    samples = True
    poll = 50
    place = 1

    def open(self):
        super().open()
        self._count = 0
        self._on = False

    def drive(self, wanted):
        self._count += wanted and not self._on
        self._on = wanted
        super().drive(wanted)

    def sample(self, values):
        return {self.sources[0]: self._count}


class Colour(Driver):
    """Three outputs with PWM."""

    drives = True

    def open(self):
        inverted = self.options.get("common_anode", False)
        self._outs = [self.keep(_Dimmer(self.pins[name], 200, inverted)) for name in ("red", "green", "blue")]

    def outputs_for(self, values):
        return tuple([share(values[name], 255) for name in self.sources])

    def drive(self, wanted):
        for out, level in zip(self._outs, wanted):
            out.set(level)


class Tone(Driver):
    """A loudspeaker: the frequency is the tone, the duty cycle the loudness."""

    drives = True

    def open(self):
        self._out = self.keep(_Dimmer(self.pins["s"], 440))

    def outputs_for(self, values):
        hertz = float(values[self.sources[0]])
        if hertz < _LOWEST_HZ:
            return 0.0, 0.0
        return min(hertz, self.options.get("highest_hz", 10000)), share(values[self.sources[1]]) / 2

    def drive(self, wanted):
        hertz, duty = wanted
        if duty:
            self._out.frequency(hertz)
        self._out.set(duty)


class Servo(Driver):
    """The width of a pulse sets the position; no pulses before the first value."""

    drives = True

    def open(self):
        self._out = self.keep(_Dimmer(self.pins["pwm"], _FRAME_HZ))

    def travel(self, values):
        """The position as a share of the full travel."""
        return share(values[self.sources[0]], 180)

    def outputs_for(self, values):
        least, most = self.options["min_pulse_ms"], self.options["max_pulse_ms"]
        return least + self.travel(values) * (most - least)

    def drive(self, wanted):
        self._out.set(wanted / _FRAME_MS)


class Gripper(Servo):
    """Opening and width; the shortest pulse closes."""

    def travel(self, values):
        return share(values[self.sources[0]], float(values[self.sources[1]]) or 1.0)


class Motors(Driver):
    """An H-bridge for two motors: two pins set the direction, PWM the power."""

    drives = True

    def open(self):
        pins = self.pins
        self._motors = [
            (
                self.keep(_Dimmer(pins["pwm" + side], 1000)),
                self.keep(_Output(pins[side + "in1"])),
                self.keep(_Output(pins[side + "in2"])),
            )
            for side in "ab"
        ]

    def outputs_for(self, values):
        return tuple([share(values[name]) - share(-values[name]) for name in self.sources])

    def drive(self, wanted):
        for (power, ahead, back), level in zip(self._motors, wanted):
            if level == 0:
                power.set(0)
            ahead.set(level > 0)
            back.set(level < 0)
            power.set(abs(level))


class Strip(Driver):
    """WS2812B: a strip of colour lamps."""

    drives = True
    lamps = 8

    def open(self):
        from neopixel import NeoPixel

        self._pin = Pin(self.pins["data"], Pin.OUT, value=0)
        self._strip = NeoPixel(self._pin, self.lamps)
        self.keep(self)

    def close(self):
        if self in self.kept:
            self.kept.remove(self)
            self.drive((0, (0, 0, 0)))
            self._pin.init(Pin.IN)
        super().close()

    def outputs_for(self, values):
        lamps, red, green, blue = [values[name] for name in self.sources]
        colour = tuple([min(255, max(0, int(float(one) + 0.5))) for one in (red, green, blue)])
        return min(self.lamps, int(float(lamps))), colour

    def drive(self, wanted):
        lamps, colour = wanted
        for lamp in range(self.lamps):
            self._strip[lamp] = colour if lamp < lamps else (0, 0, 0)
        self._strip.write()


DRIVERS = {
    "pwm": Pwm,
    "relay": Relay,
    "shutter": Shutter,
    "colour": Colour,
    "tone": Tone,
    "servo": Servo,
    "gripper": Gripper,
    "motors": Motors,
    "strip": Strip,
}
