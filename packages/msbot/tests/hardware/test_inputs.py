"""Inputs on mock pins: levels, edges, clicks, keys, echoes, pulses, and the clocked bits of a load cell."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any, ClassVar

import pytest
from gpiozero.pins.mock import MockPin, MockPWMPin

from msbot.config import Scalar
from msbot.hardware import make_wiring
from msbot.hardware.drivers.switches import KEYS
from msbot_xrce.errors import ConfigError
from tests.hardware.robot import Bench, machine_at, play
from tests.sim.robot import LIBRARY

SWITCHES = {
    "BUTTON": ("pressed", True),
    "TOGGLE": ("on", True),
    "ESTOP": ("stop", True),
    "HC-SR501": ("motion", True),
    "KY-025": ("closed", True),
    "KY-032": ("near", False),
}
"""The port, and what it says when the pin is high."""


@pytest.mark.parametrize("number", SWITCHES)
def test_a_switch_says_each_change_at_once(number: str, tmp_path: Path, pins: Any) -> None:
    port, when_high = SWITCHES[number]
    pin = pins.pin(27 if number == "TOGGLE" else 17)

    async def scene(bench: Bench) -> None:
        await asyncio.sleep(0.5)
        for level in (False, True, False, True):
            pin.drive_high() if level else pin.drive_low()
            await asyncio.sleep(0.1)
            assert bench.last(port) == {"on": level == when_high}

    play(number, machine_at(tmp_path), scene)


def test_the_shortest_press_is_not_missed(tmp_path: Path, pins: Any) -> None:
    pin = pins.pin(17)

    async def scene(bench: Bench) -> None:
        await asyncio.sleep(0.5)
        bench.heard["pressed"].clear()
        pin.drive_high()
        pin.drive_low()
        await asyncio.sleep(0.2)
        assert [getattr(message, "on") for message in bench.heard["pressed"]] == [True, False]  # noqa: B009

    play("BUTTON", machine_at(tmp_path), scene)


def test_a_cut_wire_of_the_stop_button_says_stop(tmp_path: Path, pins: Any) -> None:
    pin = pins.pin(17)

    async def scene(bench: Bench) -> None:
        assert pin.pull == "up"
        pin.drive_low()
        await asyncio.sleep(0.5)
        assert bench.last("stop") == {"on": False}
        pin.drive_high()  # nothing holds it low any more
        await asyncio.sleep(0.1)
        assert bench.last("stop") == {"on": True}
        assert bench.master.stop.stopped
        assert bench.desk.stopped
        with pytest.raises(ConfigError, match="release the STOP button"):
            bench.master.say_go("ann")
        pin.drive_low()
        await asyncio.sleep(0.2)
        bench.master.say_go("ann")
        await asyncio.sleep(0.2)
        assert not bench.desk.stopped

    play("ESTOP", machine_at(tmp_path), scene)


@pytest.mark.parametrize(("options", "pressed_when"), [([], True), (["pull=up", "active_low=true"], False)])
def test_a_button_between_pin_and_either_supply(
    options: list[str], pressed_when: bool, tmp_path: Path, pins: Any
) -> None:
    pin = pins.pin(17)

    async def scene(bench: Bench) -> None:
        await asyncio.sleep(0.2)
        assert bench.last("pressed") == {"on": False}
        pin.drive_high() if pressed_when else pin.drive_low()
        await asyncio.sleep(0.1)
        assert bench.last("pressed") == {"on": True}

    play("BUTTON", machine_at(tmp_path), scene, wiring=make_wiring(LIBRARY.require("BUTTON"), options=options))


def turn(pins: Any, *, back: bool = False) -> None:
    """One click of the knob: both contacts close and open, one before the other."""
    first, second = (pins.pin(18), pins.pin(17)) if back else (pins.pin(17), pins.pin(18))
    for step in (first.drive_low, second.drive_low, first.drive_high, second.drive_high):
        step()


def test_a_knob_counts_clicks_both_ways_and_says_when_it_is_pressed(tmp_path: Path, pins: Any) -> None:
    async def scene(bench: Bench) -> None:
        await asyncio.sleep(0.5)
        for _ in range(3):
            turn(pins)
        await asyncio.sleep(0.1)
        three = bench.last("count")["value"]
        assert abs(int(str(three))) == 3
        for _ in range(5):
            turn(pins, back=True)
        await asyncio.sleep(0.1)
        assert int(str(bench.last("count")["value"])) == -2 * int(str(three)) // 3
        pins.pin(27).drive_low()
        await asyncio.sleep(0.1)
        assert bench.last("pressed") == {"on": True}

    play("KY-040", machine_at(tmp_path), scene)


class KeyPin(MockPWMPin):  # type: ignore[misc]  # the library has no types
    """A column of a keypad: low when a pressed key joins it with a row that is low."""

    pressed: ClassVar[set[str]] = set()

    def _get_state(self) -> float:
        column = COLUMNS.get(self.info.name)
        if column is not None:
            for row, keys in enumerate(KEYS):
                wire = self.factory.pin(ROWS[row])
                if keys[column] in self.pressed and wire.function == "output" and wire._state == 0:
                    return 0
        state: float = super()._get_state()
        return state


ROWS = (5, 6, 13, 19)
COLUMNS = {"GPIO12": 0, "GPIO16": 1, "GPIO20": 2, "GPIO21": 3}


def test_every_key_of_a_keypad(tmp_path: Path, pins: Any) -> None:
    pins.pin_class = KeyPin

    async def scene(bench: Bench) -> None:
        for key in "".join(KEYS):
            KeyPin.pressed = {key}
            await asyncio.sleep(0.1)
            assert bench.last("key") == {"key": key, "pressed": True}
            KeyPin.pressed = set()
            await asyncio.sleep(0.1)
            assert bench.last("key") == {"key": key, "pressed": False}
        assert {pins.pin(row).function for row in ROWS} == {"input"}, "no row drives between two looks"

    play("KEYPAD-4X4", machine_at(tmp_path), scene)


class Echo(MockPin):  # type: ignore[misc]  # the library has no types
    """The echo pin; the kernel's time stamps come from the test."""

    stamp_s = 0.0

    def _call_when_changed(self) -> None:
        super(MockPin, self)._call_when_changed(self.stamp_s, self._state)


class Trigger(MockPin):  # type: ignore[misc]  # the library has no types
    """The trigger pin of an HC-SR04: when it falls, the echo pin is high for a while."""

    echo_s: float | None = 0.0

    def _change_state(self, value: bool) -> bool:
        changed: bool = super()._change_state(value)
        echo = self.factory.pin(24, pin_class=Echo)
        if changed and not value and self.echo_s is not None and self.function == "output" and self._fired:
            echo.stamp_s = 100.0
            echo.drive_high()
            echo.stamp_s += self.echo_s
            echo.drive_low()
        self._fired = changed and value
        return changed

    _fired = False


@pytest.fixture
def trigger(pins: Any) -> Any:
    pins.pin_class = MockPin
    pins.pin(24, pin_class=Echo)
    return pins.pin(23, pin_class=Trigger)


@pytest.mark.parametrize(
    ("echo_us", "metres", "in_range"),
    [
        # Data sheet: range = high level time x 340 m/s / 2; a 1 is rounded to the resolution of 3 mm.
        (5882, 1.0, True),
        (147, 0.024, True),
        (23529, 4.0, True),
        (38000, 4.0, False),
    ],
)
def test_an_echo_is_a_distance(echo_us: float, metres: float, in_range: bool, trigger: Any, tmp_path: Path) -> None:
    trigger.echo_s = echo_us / 1e6

    async def scene(bench: Bench) -> None:
        await asyncio.sleep(1)
        assert bench.last("distance") == {"metres": pytest.approx(metres, abs=0.003), "in_range": in_range}

    wiring = make_wiring(LIBRARY.require("HC-SR04"), options=["sound_m_s=340"])
    play("HC-SR04", machine_at(tmp_path), scene, wiring=wiring)


def test_an_offset_holds_for_a_real_distance_as_well(trigger: Any, tmp_path: Path) -> None:
    trigger.echo_s = 5882e-6

    async def scene(bench: Bench) -> None:
        await asyncio.sleep(1)
        assert bench.last("distance")["metres"] == pytest.approx(1.109, abs=0.005)

    play("HC-SR04", machine_at(tmp_path), scene, settings={"offset_m": 0.1})


def test_a_silent_range_sensor_is_said_and_comes_back(trigger: Any, tmp_path: Path) -> None:
    trigger.echo_s = 0.001

    async def scene(bench: Bench) -> None:
        await asyncio.sleep(0.5)
        trigger.echo_s = None
        await bench.until_gone()
        assert "GPIO 23 (trigger) and GPIO 24 (echo) does not answer: check its 5 V" in bench.unit.fault
        trigger.echo_s = 0.001
        await bench.until_active()

    play("HC-SR04", machine_at(tmp_path), scene)


def test_a_wheel_counts_pulses_and_tells_its_speed(tmp_path: Path, pins: Any) -> None:
    pin = pins.pin(17)
    machine = machine_at(tmp_path)

    async def scene(bench: Bench) -> None:
        machine.clock = asyncio.get_running_loop().time
        await asyncio.sleep(0.5)
        for _ in range(40):  # 20 slots a turn; 10 pulses a second are half a turn a second
            pin.drive_high()
            pin.drive_low()
            await asyncio.sleep(0.1)
        assert bench.last("count") == {"value": pytest.approx(40, abs=1)}
        assert bench.last("speed") == {"rpm": pytest.approx(30, abs=1)}
        await asyncio.sleep(1)
        assert bench.last("speed") == {"rpm": 0}

    play("LM393-SPEED", machine, scene, settings={"period_s": 0.5})


class Clock(MockPWMPin):  # type: ignore[misc]  # the library has no types
    """PD_SCK of an HX711: each rising edge shifts the next bit out at DT, which is low when a value is ready."""

    counts = 0
    ready = True
    position = 0

    def _change_state(self, value: float) -> bool:
        changed: bool = super()._change_state(value)
        data = self.factory.pin(5)
        if changed and value and data.function == "input":
            bit = self.counts >> (23 - self.position) & 1 if self.position < 24 else 1
            self.position += 1
            data.drive_high() if bit else data.drive_low()
            if self.position == 25:
                self.position = 0
                data.drive_high()
        elif changed and not value and self.position == 0 and self.ready and data.function == "input":
            data.drive_low()
        return changed


@pytest.fixture
def clock(pins: Any) -> Any:
    return pins.pin(6, pin_class=Clock)


class AlwaysHigh(MockPWMPin):  # type: ignore[misc]  # the library has no types
    """DT of a chip that is not there, with its pull-up."""

    def _get_state(self) -> float:
        return 1


def still(values: dict[str, float]) -> Any:
    """A clock that a test moves."""
    return lambda: values["now"]


@pytest.mark.parametrize("counts", [0, 1, 0x7FFFFF, 0x800000, 0xFFFFFF, 420 * 100])
def test_the_24_bits_of_a_load_cell(counts: int, clock: Any, tmp_path: Path, pins: Any) -> None:
    machine = machine_at(tmp_path)
    machine.clock = still({"now": 0.0})
    clock.counts = counts
    grams = (counts - (1 << 24) * (counts >> 23)) / 420.0

    async def scene(bench: Bench) -> None:
        await asyncio.sleep(1)
        assert bench.last("weight") == {"grams": pytest.approx(grams - 10, abs=0.06)}

    play("HX711", machine, scene, settings={"tare_g": 10.0})


def test_a_load_cell_that_is_never_ready_is_said(tmp_path: Path, pins: Any) -> None:
    machine = machine_at(tmp_path)
    now = {"now": 0.0}

    def wait(seconds: float) -> None:
        now["now"] += seconds

    machine.clock, machine.wait = still(now), wait
    pins.pin(5, pin_class=AlwaysHigh)

    async def scene(bench: Bench) -> None:
        await asyncio.sleep(2)
        assert "HX711 at GPIO 6 (SCK) and GPIO 5 (DT) is not ready" in bench.unit.fault

    play("HX711", machine, scene, joins=False)


def test_a_measurement_with_a_clock_pulse_that_was_too_long_is_thrown_away(clock: Any, tmp_path: Path) -> None:
    machine = machine_at(tmp_path)
    now = {"now": 0.0}

    def busy() -> float:
        now["now"] += 100e-6
        return now["now"]

    machine.clock = busy

    async def scene(bench: Bench) -> None:
        await asyncio.sleep(2)
        assert "too busy to read the HX711" in bench.unit.fault

    play("HX711", machine, scene, joins=False)


def test_a_stick_is_pressed_by_a_pin_and_leans_by_volts(tmp_path: Path, pins: Any) -> None:
    folder = tmp_path / "sys/bus/iio/devices/iio:device0"
    folder.mkdir(parents=True)
    for name, text in {"in_voltage0_raw": "1023", "in_voltage1_raw": "256", "in_voltage_scale": "3.2258"}.items():
        (folder / name).write_text(text)

    async def scene(bench: Bench) -> None:
        await asyncio.sleep(0.3)
        wanted: dict[str, Scalar] = {"pressed": False}
        assert bench.last("stick")["pressed"] == wanted["pressed"]
        assert bench.last("stick")["x"] == pytest.approx(100, abs=0.1)
        assert bench.last("stick")["y"] == pytest.approx(-50, abs=0.2)
        pins.pin(17).drive_low()
        await asyncio.sleep(0.1)
        assert bench.last("stick")["pressed"] is True

    play("KY-023", machine_at(tmp_path), scene)
