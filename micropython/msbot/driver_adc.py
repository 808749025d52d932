"""Drivers of analog inputs on a generic board (docs/reference/generic_board.md)."""

import math

from machine import ADC, Pin

from .driver import Driver

_BOARD_V = 3.3  # what the converters of most boards call full
_H2_PPM = 1000.0
_SLOPE = math.log(0.6) / math.log(3.0)  # MQ-2 data sheet, table B: from 1000 to 3000 ppm, 0.6 of the resistance


class _Channel:
    def __init__(self, pin):
        self._adc = ADC(Pin(pin))
        if hasattr(ADC, "ATTN_11DB"):  # ESP32: otherwise it measures up to 1 V only
            self._adc.atten(ADC.ATTN_11DB)

    def volts(self):
        if hasattr(self._adc, "read_uv"):  # measured against the chip's own reference
            return self._adc.read_uv() / 1000000
        return self._adc.read_u16() / 65535 * _BOARD_V


def _between(volts, low, high):
    return min(1.0, max(0.0, (volts - low) / ((high - low) or 1.0)))


class Analog(Driver):
    """Percent of the way from one voltage to another: the options say which."""

    samples = True
    poll = 20

    def open(self):
        options = self.options
        self._channel = _Channel(self.pins["out"])
        self._low = options.get("quiet_v", options.get("dry_v", 0.0))
        self._high = options.get("wet_v", options.get("full_v", _BOARD_V))

    def sample(self, values):
        return {self.sources[0]: 100 * _between(self._channel.volts(), self._low, self._high)}


class Stick(Driver):
    """Two channels, and a button that closes to ground."""

    samples = True
    poll = 20

    def open(self):
        self._channels = [_Channel(self.pins[name]) for name in "xy"]
        self._button = Pin(self.pins["sw"], Pin.IN, Pin.PULL_UP) if "sw" in self.pins else None

    def sample(self, values):
        full = self.options.get("full_v", _BOARD_V)
        leans = [200 * _between(channel.volts(), 0.0, full) - 100 for channel in self._channels]
        pressed = self._button is not None and not self._button.value()
        return dict(zip(self.sources, leans + [pressed]))


class Gas(Driver):
    """MQ-2: an estimate of the gas from the data sheet's curve."""

    samples = True

    def open(self):
        self._channel = _Channel(self.pins["out"])

    def sample(self, values):
        options, volts = self.options, max(0.001, self._channel.volts())
        ohms = max(0.0, options["supply_v"] - volts) * options["load_kohm"] / volts
        ratio = max(1e-6, ohms / options["r0_kohm"])
        return {self.sources[0]: min(10000.0, _H2_PPM * math.pow(ratio, 1 / _SLOPE))}


class Line(Driver):
    """Eight reflectance sensors in a row; a dark line reflects little."""

    samples = True

    def open(self):
        self._channels = [_Channel(self.pins[str(sensor)]) for sensor in range(1, 9)]

    def sample(self, values):
        white, black = self.options["white_v"], self.options["black_v"]
        dark = [_between(channel.volts(), white, black) for channel in self._channels]
        seen, place = self.sources
        if max(dark) < 0.5:
            return {seen: False}
        middle = sum([one * (index - 3.5) / 3.5 for index, one in enumerate(dark)]) / sum(dark)
        return {seen: True, place: middle}


DRIVERS = {"analog": Analog, "stick": Stick, "gas": Gas, "line": Line}
