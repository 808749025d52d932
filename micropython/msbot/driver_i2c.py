"""Drivers of chips on I2C on a generic board; `msbot.hardware.drivers` cites the data sheets of their registers."""

import struct
import time

from machine import Pin, SoftI2C

from .driver import Driver, Fault

_HERTZ = 100000
_GRAVITY = 9.80665
_buses = {}  # by their two pins: chips share them


class Chip(Driver):
    """One chip."""

    samples = True

    def open(self):
        wires = (self.pins["scl"], self.pins["sda"])
        if wires not in _buses:
            _buses[wires] = SoftI2C(scl=Pin(wires[0]), sda=Pin(wires[1]), freq=_HERTZ)
        self._bus = _buses[wires]
        self._address = self.pins["address"]

    def read(self, register, size=1):
        return self._bus.readfrom_mem(self._address, register, size)

    def put(self, register, octets):
        self._bus.writeto_mem(self._address, register, octets)

    def expect(self, register, identities):
        found = self.read(register)[0]
        if found not in identities:
            words = "the chip at 0x{:02x} is no {}: it calls itself 0x{:02x}"
            raise Fault(words.format(self._address, self.number, found))

    def words(self, error):
        if isinstance(error, Fault):
            return str(error)
        words = (
            "no {} answers at 0x{:02x} (scl at pin {}, sda at pin {}): check its supply, both wires, and its address"
        )
        return words.format(self.number, self.pins["address"], self.pins["scl"], self.pins["sda"])


class Bmp280(Chip):
    """Warmth and pressure of the air."""

    def open(self):
        super().open()
        self.expect(0xD0, (0x56, 0x57, 0x58, 0x60))
        self._c = struct.unpack("<HhhHhhhhhhhh", self.read(0x88, 24))
        if not (self._c[0] and self._c[3]):
            raise Fault("the BMP280 tells no calibration: it is broken, or SDA is disturbed")
        self.put(0xF5, b"\x00")
        self.put(0xF4, b"\x57")  # temperature twice, pressure 16 times, continuously
        time.sleep_ms(50)

    def sample(self, values):
        octets = self.read(0xF7, 6)
        pressure, temperature = [(octets[at] << 16 | octets[at + 1] << 8 | octets[at + 2]) >> 4 for at in (0, 3)]
        if temperature == 0x80000:
            raise Fault("the BMP280 does not measure any more: it had no power in between")
        t1, t2, t3, p1, p2, p3, p4, p5, p6, p7, p8, p9 = self._c
        fine = (temperature / 16384 - t1 / 1024) * t2 + (temperature / 131072 - t1 / 8192) ** 2 * t3
        x = fine / 2 - 64000
        y = (x * x * p6 / 32768 + x * p5 * 2) / 4 + p4 * 65536
        x = (1 + (p3 * x * x / 524288 + p2 * x) / 524288 / 32768) * p1
        pascal = 0.0
        if x:
            pascal = (1048576 - pressure - y / 4096) * 6250 / x
            pascal += (p9 * pascal * pascal / 2147483648 + pascal * p8 / 32768 + p7) / 16
        return {self.sources[0]: fine / 5120, self.sources[1]: pascal / 100}


class Bh1750(Chip):
    """Brightness; a chip without registers."""

    def open(self):
        super().open()
        for command in (b"\x01", b"\x10"):  # on; continuously at high resolution
            self._bus.writeto(self._address, command)
        time.sleep_ms(180)

    def sample(self, values):
        high, low = self._bus.readfrom(self._address, 2)
        return {self.sources[0]: (high << 8 | low) / 1.2}


class Ina219(Chip):
    """Voltage and current."""

    def open(self):
        super().open()
        self.put(0x00, b"\x39\x9f")

    def sample(self, values):
        shunt = struct.unpack(">h", self.read(0x01, 2))[0]
        bus = struct.unpack(">H", self.read(0x02, 2))[0]
        amperes = shunt * 10e-6 / self.options["shunt_ohm"]
        return {self.sources[0]: (bus >> 3) * 0.004, self.sources[1]: amperes}


class Mpu6050(Chip):
    """Acceleration and rate of turn."""

    def open(self):
        super().open()
        self.expect(0x75, (0x68, 0x70, 0x71, 0x72, 0x98))
        for register, value in ((0x6B, b"\x01"), (0x1A, b"\x03"), (0x1B, b"\x00"), (0x1C, b"\x00")):
            self.put(register, value)
        time.sleep_ms(50)

    def sample(self, values):
        counts = struct.unpack(">7h", self.read(0x3B, 14))
        if not any(counts):
            raise Fault("the MPU-6050 sleeps: it had no power in between")
        measured = [count / 16384 * _GRAVITY for count in counts[:3]] + [count / 131 for count in counts[4:]]
        return dict(zip(self.sources, measured))


class Tcs34725(Chip):
    """Brightness and colour."""

    def open(self):
        super().open()
        self.expect(0xB2, (0x44, 0x4D))
        self._gain = self.options.get("gain", 4)
        self.put(0xA1, bytes((256 - 21,)))  # 21 steps of 2.4 ms
        self.put(0xAF, bytes(({1: 0, 4: 1, 16: 2, 60: 3}.get(self._gain, 0),)))
        self.put(0xA0, b"\x01")
        time.sleep_ms(3)
        self.put(0xA0, b"\x03")
        time.sleep_ms(53)

    def sample(self, values):
        if not self.read(0xB3)[0] & 1:
            return None
        clear, red, green, blue = struct.unpack("<4H", self.read(0xB4, 8))
        infrared = max(0.0, (red + green + blue - clear) / 2)
        seen = 0.136 * (red - infrared) + (green - infrared) - 0.444 * (blue - infrared)
        colours = [min(255, round(255 * count / clear)) if clear else 0 for count in (red, green, blue)]
        return dict(zip(self.sources, [max(0.0, seen * 310 / (2.4 * 21 * self._gain))] + colours))


DRIVERS = {"bmp280": Bmp280, "bh1750": Bh1750, "ina219": Ina219, "mpu6050": Mpu6050, "tcs34725": Tcs34725}
