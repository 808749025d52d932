"""MicroPython's module `machine` without hardware, after its manual: pins with levels, PWM, converters, chips on I2C.

Runs in the MicroPython VM and under CPython. The functions at the end are for tests: the world that the pins are in.
"""

_pins = {}
_volts = {}
_chips = {}
_echo = {"us": -2}


class _Line:
    """The wire at a pin."""

    def __init__(self):
        self.mode = "in"
        self.level = 0
        self.pull = None
        self.driven = None
        self.duty = None
        self.freq = 0
        self.handler = None


def _line(number):
    if number not in _pins:
        _pins[number] = _Line()
    return _pins[number]


class Pin:
    IN, OUT, PULL_UP, PULL_DOWN = 0, 1, 1, 2
    IRQ_RISING, IRQ_FALLING = 1, 2

    def __init__(self, number, mode=-1, pull=-1, value=None):
        self.number = number
        self.init(mode, pull, value=value)

    def init(self, mode=-1, pull=-1, value=None):
        line = _line(self.number)
        if value is not None:
            line.level = value
        if mode != -1:
            line.mode = "out" if mode else "in"
            line.duty = None
            line.pull = pull if pull != -1 else None

    def value(self, level=None):
        line = _line(self.number)
        if level is not None:
            line.level = int(bool(level))
            return None
        if line.mode == "out":
            return line.level
        if line.driven is not None:
            return line.driven
        return 1 if line.pull == Pin.PULL_UP else 0

    def irq(self, handler=None, trigger=3):
        _line(self.number).handler = (lambda: handler(self), trigger) if handler else None


class PWM:
    def __init__(self, pin, freq=0, duty_u16=0):
        self._line = _line(pin.number)
        self._line.freq = freq
        self._line.duty = duty_u16

    def duty_u16(self, duty):
        assert isinstance(duty, int) and 0 <= duty <= 65535, duty
        self._line.duty = duty

    def freq(self, hertz):
        assert isinstance(hertz, int) and hertz > 0, hertz
        self._line.freq = hertz

    def deinit(self):
        self._line.duty = None


class ADC:
    def __init__(self, pin):
        self._number = pin.number

    def read_u16(self):
        return min(65535, int(_volts.get(self._number, 0.0) / 3.3 * 65535 + 0.5))


class SoftI2C:
    def __init__(self, scl, sda, freq):
        pass

    def _chip(self, address):
        if address not in _chips:
            raise OSError(19)  # ENODEV
        return _chips[address]

    def readfrom_mem(self, address, register, size):
        return bytes(self._chip(address)[register : register + size])

    def writeto_mem(self, address, register, octets):
        self._chip(address)[register : register + len(octets)] = octets

    def readfrom(self, address, size):
        return bytes(self._chip(address)[:size])

    def writeto(self, address, octets):
        self._chip(address)


def time_pulse_us(pin, level, timeout_us):
    return _echo["us"]


def unique_id():
    return b"\1\2\3"


# For tests.


def look(number):
    """A pin: what it is, and its level, or its duty cycle of 65535."""
    line = _line(number)
    return [line.mode, line.level if line.duty is None else line.duty]


def drive(number, level):
    """Apply a level from outside; None: nothing is connected."""
    line = _line(number)
    before, line.driven = line.driven, level
    if line.handler and before != level:
        function, trigger = line.handler
        if trigger & (1 if level else 2):
            function()


def set_volts(number, volts):
    """Apply a voltage."""
    _volts[number] = volts


def set_echo(us):
    """How long the echo pin is high; -2: it does not rise, -1: it does not fall."""
    _echo["us"] = us


def plug(address, registers):
    """Put a chip on the bus: pairs of a register and its octets, as hexadecimal digits."""
    _chips[address] = bytearray(256)
    for register, octets in registers:
        octets = bytes.fromhex(octets)
        _chips[address][register : register + len(octets)] = octets


def pull(address):
    """Take a chip off the bus."""
    del _chips[address]


def power_cut():
    """All pins are inputs, as after a reset."""
    for line in _pins.values():
        line.mode, line.level, line.duty, line.handler = "in", 0, None, None
