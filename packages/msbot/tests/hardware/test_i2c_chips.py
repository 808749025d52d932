"""Chips on I2C: what the data sheets' worked examples say, a chip that is not there, one that vanishes, a stuck bus.

Where a data sheet prints a register image and a result, both are in `chips.py` with their source.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot.config import Scalar
from msbot.hardware import PartWiring, make_wiring
from msbot.hardware.drivers.lcd1602 import character
from msbot.hardware.drivers.light import bh1750_lux, colour_octet, tcs34725_lux
from msbot.pnp import PartState
from msbot_agent.link import Peer
from msbot_agent.link.disturbed_link import DisturbedLink
from tests.hardware.chips import Bus, Chip, bh1750, bmp280, ina219, mpu6050, tcs34725
from tests.hardware.robot import Bench, machine_at, play
from tests.sim.robot import LIBRARY

GRAVITY = 9.80665
SENSORS: dict[str, tuple[int, Callable[[], Chip], dict[str, dict[str, float | bool]]]] = {
    "BMP280": (0x76, bmp280, {"temperature": {"celsius": 25.08}, "pressure": {"hectopascal": 1006.53}}),
    "BH1750": (0x23, bh1750, {"light": {"lux": 28067}}),
    "INA219": (0x40, ina219, {"battery": {"volts": 11.98, "amperes": 10.0}}),
    "MPU-6050": (0x68, mpu6050, {"acceleration": {"x": 0, "y": 0, "z": GRAVITY}, "rotation": {"x": 0, "z": 1}}),
    "TCS34725": (0x29, tcs34725, {"colour": {"red": 85, "green": 85, "blue": 85}}),
}


def wiring_of(number: str) -> PartWiring:
    part_type = LIBRARY.require(number)
    # The worked example of the INA219 has a shunt of 2 milliohms.
    return make_wiring(part_type, options=["shunt_ohm=0.002"] if number == "INA219" else [])


@pytest.mark.parametrize("number", SENSORS)
def test_the_worked_example_of_the_data_sheet_reaches_a_partner(number: str, tmp_path: Path) -> None:
    address, make, expected = SENSORS[number]
    bus = Bus(**{f"at_{address:02x}": make()})

    async def scene(bench: Bench) -> None:
        await asyncio.sleep(2.5)
        for port, fields in expected.items():
            said = bench.last(port)
            for name, value in fields.items():
                assert said[name] == pytest.approx(value, rel=1e-5, abs=1e-4), (port, name)

    play(number, machine_at(tmp_path, bus), scene, wiring=wiring_of(number))
    assert not bus.is_open, "the bus is closed with the part"


@pytest.mark.parametrize("number", SENSORS)
def test_a_chip_that_vanishes_is_said_and_comes_back(number: str, tmp_path: Path) -> None:
    address, make, _ = SENSORS[number]
    bus = Bus(**{f"at_{address:02x}": make()})

    async def scene(bench: Bench) -> None:
        await asyncio.sleep(1)
        chip = bus.chips.pop(address)
        await bench.until_gone()
        assert f"no {number} answers at 0x{address:02x} on I2C bus 1" in bench.unit.fault
        assert "`i2cdetect -y 1`" in bench.unit.fault
        said = [len(heard) for heard in bench.heard.values()]
        await asyncio.sleep(5)
        assert bench.unit.fault[:180] in bench.master.why("unit")[0], "the robot knows why it has gone"
        assert [len(heard) for heard in bench.heard.values()] == said, "nothing is said without a chip"
        bus.chips[address] = chip
        await bench.until_active()
        assert bench.unit.fault == ""
        await asyncio.sleep(2)
        assert [len(heard) for heard in bench.heard.values()] != said

    play(number, machine_at(tmp_path, bus), scene, wiring=wiring_of(number))


class Deaf:
    """Loses what the part says until `until` (a treatment of `DisturbedLink`)."""

    until = 0.0

    def applies_to(self, peer: Peer, packet: bytes, *, inward: bool) -> bool:
        return not inward

    def delays(self, peer: Peer, now: float, *, inward: bool) -> tuple[float, ...]:
        return () if now < self.until else (0.0,)

    def free_at(self, peer: Peer, now: float) -> float:
        return now


def test_the_reason_reaches_the_robot_also_when_it_has_to_be_said_again(tmp_path: Path) -> None:
    bus, deaf = Bus(at_76=bmp280()), Deaf()

    async def scene(bench: Bench) -> None:
        deaf.until = asyncio.get_running_loop().time() + 1.5
        del bus.chips[0x76]
        await bench.until(lambda: bench.master.inventory.view(0.0)[-1].state is PartState.LEFT)
        assert "it said: no BMP280 answers at 0x76" in bench.master.why("unit")[0]
        assert bench.unit.part.trouble_heard

    play("BMP280", machine_at(tmp_path, bus), scene, around=lambda link: DisturbedLink(link, deaf))


def test_a_reason_that_the_robot_has_not_heard_is_told_when_it_hears_again(tmp_path: Path) -> None:
    bus, deaf = Bus(at_76=bmp280()), Deaf()

    async def scene(bench: Bench) -> None:
        deaf.until = asyncio.get_running_loop().time() + 30
        del bus.chips[0x76]
        await bench.until_gone()
        await asyncio.sleep(60)
        assert "it said: no BMP280 answers at 0x76" in bench.master.why("BMP280")[0]

    play("BMP280", machine_at(tmp_path, bus), scene, around=lambda link: DisturbedLink(link, deaf))


@pytest.mark.parametrize("number", SENSORS)
def test_a_chip_that_is_not_there_keeps_its_part_out_of_the_robot(number: str, tmp_path: Path) -> None:
    async def scene(bench: Bench) -> None:
        await asyncio.sleep(5)
        assert bench.unit.part.slot == ""
        assert "check its supply, the wires SDA and SCL, and its address" in bench.unit.fault
        assert bench.unit.fault[:100] in str(bench.master.why(number)[0]), "the robot is told"
        assert bench.heard == {name: [] for name in bench.heard}

    play(number, machine_at(tmp_path, Bus()), scene, wiring=wiring_of(number), joins=False)


def test_why_a_chip_is_not_there_is_told_once_to_a_master_that_comes_later_and_the_part_joins_when_it_answers(
    tmp_path: Path,
) -> None:
    bus = Bus()

    async def scene(bench: Bench) -> None:
        await asyncio.sleep(100)
        (part,) = [info for info in bench.master.inventory.view(0.0) if info.part_number == "BMP280"]
        assert part.state is PartState.LEFT
        history = bench.master.why("BMP280")
        await asyncio.sleep(100)
        assert len(bench.master.why("BMP280")) == len(history), "it does not come and go every second"
        bus.chips[0x76] = bmp280()
        await bench.until_active()
        assert "it said" not in bench.master.why("BMP280")[0]

    play("BMP280", machine_at(tmp_path, bus), scene, joins=False)


def test_a_stuck_bus_is_told_from_a_missing_chip(tmp_path: Path) -> None:
    bus = Bus(at_76=bmp280())

    async def scene(bench: Bench) -> None:
        bus.stuck = True
        await bench.until_gone()
        assert "I2C bus 1 is stuck" in bench.unit.fault
        assert "holds SDA or SCL low" in bench.unit.fault
        bus.stuck = False
        await bench.until_active()

    play("BMP280", machine_at(tmp_path, bus), scene)


def test_one_disturbed_measurement_is_no_missing_chip(tmp_path: Path) -> None:
    bus = Bus(at_76=bmp280())

    async def scene(bench: Bench) -> None:
        await asyncio.sleep(1)
        chip = bus.chips.pop(0x76)
        await bench.until(lambda: bench.unit.faults)
        bus.chips[0x76] = chip
        await asyncio.sleep(3)
        assert (bench.unit.faults, bench.unit.fault) == (1, "")

    play("BMP280", machine_at(tmp_path, bus), scene)


def test_another_chip_at_the_address_is_refused_by_its_identity(tmp_path: Path) -> None:
    async def scene(bench: Bench) -> None:
        await asyncio.sleep(2)
        assert "is no BMP280: it calls itself 0x68" in bench.unit.fault

    play("BMP280", machine_at(tmp_path, Bus(at_76=Chip({0xD0: 0x68}))), scene, joins=False)


def test_a_chip_that_had_no_power_in_between_is_set_up_again(tmp_path: Path) -> None:
    bus = Bus(at_76=bmp280())

    async def scene(bench: Bench) -> None:
        chip = bus.chips[0x76]
        chip.registers[0xF4] = 0
        chip.fill(0xF7, bytes([0x80, 0, 0, 0x80, 0, 0]))  # the reset state of the data registers
        await bench.until_gone()
        assert "it had no power in between" in bench.unit.fault
        await bench.until(lambda: chip.registers[0xF4])
        chip.fill(0xF7, bmp280_data())
        await bench.until_active()

    play("BMP280", machine_at(tmp_path, bus), scene)


def bmp280_data() -> bytes:
    registers = bmp280().registers
    return bytes(registers[register] for register in range(0xF7, 0xFD))


def test_a_calibration_setting_holds_at_once(tmp_path: Path) -> None:
    async def scene(bench: Bench) -> None:
        await asyncio.sleep(1)
        assert bench.last("light") == {"lux": 56133}

    play("BH1750", machine_at(tmp_path, Bus(at_23=bh1750())), scene, settings={"gain": 2.0})


@pytest.mark.parametrize(("period_s", "about"), [(0.5, 20), (2.0, 5)])
def test_the_period_is_the_settings(period_s: float, about: int, tmp_path: Path) -> None:
    async def scene(bench: Bench) -> None:
        bench.heard["pressure"].clear()
        await asyncio.sleep(10)
        assert abs(len(bench.heard["pressure"]) - about) <= 1

    play("BMP280", machine_at(tmp_path, Bus(at_76=bmp280())), scene, settings={"period_s": period_s})


def test_light_and_colour_by_their_formulas() -> None:
    assert bh1750_lux(0b1000001110010000) == pytest.approx(28066.67, abs=0.01)
    assert colour_octet(10, 0) == 0
    assert tcs34725_lux(0, 0, 0, 0, gain=1) == 0.0
    # White without infrared: (0.136 + 1 - 0.444) x 333 counts x 310 / (50.4 ms x gain 4), ams DN40.
    assert tcs34725_lux(999, 333, 333, 333, gain=4) == pytest.approx(0.692 * 333 * 310 / 201.6)
    # What all colours see and clear does not count twice is infrared, and is taken off.
    assert tcs34725_lux(300, 200, 200, 200, gain=1) < tcs34725_lux(600, 200, 200, 200, gain=1)


@given(st.integers(0, 0xFFFF), st.integers(0, 0xFFFF), st.integers(0, 0xFFFF), st.integers(0, 0xFFFF))
def test_no_count_makes_a_colour_or_light_that_cannot_be(clear: int, red: int, green: int, blue: int) -> None:
    assert tcs34725_lux(clear, red, green, blue, gain=1) >= 0
    assert 0 <= colour_octet(red, clear) <= 255


class Display:
    """An HD44780U behind a PCF8574: takes nibbles when ENABLE falls, and keeps what is in its DDRAM."""

    def __init__(self, written: list[tuple[int, int]]) -> None:
        self.memory = bytearray(b" " * 0x80)
        self.lit = False
        self.four_bits = False
        self._at = 0
        self._upper: int | None = None
        before = 0
        for _, octet in written:
            self.lit = bool(octet & 0x08)
            if before & 0x04 and not octet & 0x04:
                self._take(octet & 0xF0, data=bool(octet & 0x01))
            before = octet

    def _take(self, nibble: int, *, data: bool) -> None:
        if not self.four_bits:
            self.four_bits = nibble == 0x20
            return
        if self._upper is None:
            self._upper = nibble
            return
        octet, self._upper = self._upper | nibble >> 4, None
        if data:
            self.memory[self._at] = octet
            self._at += 1
        elif octet & 0x80:
            self._at = octet & 0x7F
        elif octet == 0x01:
            self.memory[:] = b" " * 0x80
            self._at = 0

    @property
    def rows(self) -> tuple[str, str]:
        return self.memory[:16].decode("latin-1"), self.memory[0x40:0x50].decode("latin-1")


def test_a_display_shows_text_after_the_initialisation_of_figure_24(tmp_path: Path) -> None:
    chip = Chip()
    bus = Bus(at_27=chip)

    async def scene(bench: Bench) -> None:
        bench.send("text", text="Hello, robot\n21.5 °C ~")
        await asyncio.sleep(0.5)
        display = Display(chip.written)
        assert display.four_bits
        assert display.lit
        assert display.rows == ("Hello, robot    ", "21.5 \xdfC ?       ")
        wrote = len(chip.written)
        bench.send("text", text="Hello, robot\n21.5 °C ~")
        await asyncio.sleep(0.5)
        assert len(chip.written) == wrote, "what is shown already is not written again"
        bench.master.say_stop("a test")
        await asyncio.sleep(1)
        assert Display(chip.written).rows == (" " * 16, " " * 16)
        assert bench.master.stop.silent == ()

    play("LCD1602", machine_at(tmp_path, bus), scene)


@pytest.mark.parametrize(("letter", "code"), [("A", 0x41), ("°", 0xDF), ("ü", 0xF5), ("\\", 0x3F), ("日", 0x3F)])
def test_letters_of_the_display(letter: str, code: int) -> None:
    assert character(letter) == code


def test_a_display_that_vanishes_is_initialised_again(tmp_path: Path) -> None:
    chip = Chip()
    bus = Bus(at_27=chip)

    async def scene(bench: Bench) -> None:
        del bus.chips[0x27]
        fields: dict[str, Scalar] = {"text": "one"}
        bench.send("text", **fields)
        for attempt in range(5):
            await asyncio.sleep(0.3)
            bench.send("text", text=f"try {attempt}")
        await bench.until_gone()
        assert "no LCD1602 answers" in bench.unit.fault
        chip.written.clear()
        bus.chips[0x27] = chip
        await bench.until_active()
        bench.send("text", text="back")
        await asyncio.sleep(0.5)
        assert Display(chip.written).rows[0].strip() == "back"

    play("LCD1602", machine_at(tmp_path, bus), scene)
