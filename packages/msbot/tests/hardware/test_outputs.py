"""Outputs on mock pins: what messages and settings make of them, and that nothing stays on."""

from __future__ import annotations

import asyncio
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from msbot.config import Scalar
from msbot.hardware import make_wiring
from msbot.hardware.drivers.motion import HALF_STEPS
from msbot.hardware.drivers.strip import LAMPS, RESET, frame
from tests.hardware.robot import Bench, machine_at, play
from tests.sim.robot import LIBRARY

Orders = list[tuple[str, dict[str, Scalar]]]
OUTPUTS: dict[str, tuple[Orders, dict[str, Scalar], dict[int, float]]] = {
    "LED": ([("on", {"on": True})], {"brightness": 40.0}, {17: 0.4}),
    "RELAY-1": ([("on", {"on": True})], {}, {17: 1}),
    "FAN-5V": ([("power", {"percent": 60.0})], {}, {18: 0.6}),
    "BUZZER": ([("tone", {"hertz": 440.0, "seconds": 0.0})], {"volume": 50.0}, {18: 0.25}),
    "RGB-LED": ([("colour", {"red": 255, "green": 51, "blue": 0})], {}, {17: 1, 27: 0.2, 22: 0}),
    "SG90": ([("angle", {"degrees": 180.0})], {}, {18: 2.4 / 20}),
    "MG90S": ([("angle", {"degrees": 0.0})], {}, {18: 0.5 / 20}),
    "MG996R": ([("angle", {"degrees": 90.0})], {}, {18: 1.5 / 20}),
    "GRIPPER": ([("grip", {"percent": 100.0})], {}, {18: 1.0 / 20}),
    "L298N": ([("left", {"percent": 50.0}), ("right", {"percent": -100.0})], {},
              {5: 0.5, 6: 0, 12: 1, 20: 0, 21: 1, 13: 1}),
    "TB6612FNG": ([("left", {"percent": -25.0}), ("right", {"percent": 100.0})], {"most": 80.0},
                  {5: 0, 6: 0.25, 12: 1, 20: 0.8, 21: 0, 13: 1}),
}  # fmt: skip
"""Messages, settings, and the levels or duty cycles of pins that follow."""
SAFE: dict[str, dict[int, float]] = {
    **{
        number: {18: (0.5 + 0.5 * (most - 0.5)) / 20}
        for number, most in (("SG90", 2.4), ("MG90S", 2.4), ("MG996R", 2.5))
    },
    "GRIPPER": {18: 2.0 / 20},
    "L298N": dict.fromkeys((5, 6, 20, 21), 0),
    "TB6612FNG": dict.fromkeys((5, 6, 20, 21), 0),
}
"""What is not simply off in the safe state: a servo stands in the middle, a gripper is open."""


def states(pins: Any, expected: dict[int, float]) -> dict[int, float]:
    return {gpio: pins.pin(gpio).state for gpio in expected}


@pytest.mark.parametrize("number", OUTPUTS)
def test_a_message_switches_and_stop_and_the_end_switch_off(number: str, tmp_path: Path, pins: Any) -> None:
    orders, settings, expected = OUTPUTS[number]
    safe = SAFE.get(number, dict.fromkeys(expected, 0))

    async def scene(bench: Bench) -> None:
        for port, fields in orders:
            bench.send(port, **fields)
        await asyncio.sleep(2)
        assert states(pins, expected) == pytest.approx(expected, abs=1e-4)
        bench.master.say_stop("a test")
        await asyncio.sleep(1)
        assert states(pins, safe) == pytest.approx(safe, abs=1e-4)
        assert bench.master.stop.silent == ()
        for port, fields in orders:
            bench.send(port, **fields)
        await asyncio.sleep(1)
        assert states(pins, safe) == pytest.approx(safe, abs=1e-4), "STOP holds"
        bench.master.say_go("a test")
        await asyncio.sleep(0.5)
        for port, fields in orders:
            bench.send(port, **fields)
        await asyncio.sleep(2)
        assert states(pins, expected) == pytest.approx(expected, abs=1e-4)

    play(number, machine_at(tmp_path), scene, settings=settings)
    assert {pins.pin(gpio).function for gpio in expected} == {"input"}, "at the end every pin is let go"
    assert set(states(pins, expected).values()) == {0}


@pytest.mark.parametrize("number", OUTPUTS)
def test_an_output_is_safe_when_its_master_is_lost(number: str, tmp_path: Path, pins: Any) -> None:
    orders, settings, expected = OUTPUTS[number]
    safe = SAFE.get(number, dict.fromkeys(expected, 0))

    async def scene(bench: Bench) -> None:
        for port, fields in orders:
            bench.send(port, **fields)
        await asyncio.sleep(2)
        bench.running.cancel()
        await bench.until_gone()
        await asyncio.sleep(0.1)
        assert states(pins, safe) == pytest.approx(safe, abs=1e-4)

    play(number, machine_at(tmp_path), scene, settings=settings)


def test_a_motor_follows_its_ramp_but_stops_at_once(tmp_path: Path, pins: Any) -> None:
    async def scene(bench: Bench) -> None:
        bench.send("left", percent=100.0)
        await asyncio.sleep(1)
        assert 0.4 < pins.pin(5).state < 0.6, "50 % a second"
        await asyncio.sleep(2)
        assert pins.pin(5).state == 1
        bench.send("left", percent=0.0)
        await asyncio.sleep(1)
        assert 0.4 < pins.pin(5).state < 0.6, "down, too"
        bench.send("left", percent=100.0)
        await asyncio.sleep(2)
        bench.master.say_stop("a test")
        await asyncio.sleep(0.1)
        assert pins.pin(5).state == 0
        bench.master.say_go("a test")
        await asyncio.sleep(0.5)
        assert pins.pin(5).state == 0, "nothing of the old order is left"

    play("TB6612FNG", machine_at(tmp_path), scene, settings={"ramp": 50.0})


@pytest.mark.parametrize(
    ("number", "option"), [("LED", "active_low"), ("RELAY-1", "active_low"), ("RGB-LED", "common_anode")]
)
def test_an_output_that_is_on_when_low(number: str, option: str, tmp_path: Path, pins: Any) -> None:
    port, fields = ("colour", {"red": 255}) if number == "RGB-LED" else ("on", {"on": True})

    async def scene(bench: Bench) -> None:
        assert pins.pin(17).state == 1
        bench.send(port, **fields)
        await asyncio.sleep(0.2)
        assert pins.pin(17).state == 0

    wiring = make_wiring(LIBRARY.require(number), options=[f"{option}=true"])
    play(number, machine_at(tmp_path), scene, wiring=wiring)


def test_a_fan_that_would_not_turn_gets_nothing(tmp_path: Path, pins: Any) -> None:
    async def scene(bench: Bench) -> None:
        bench.send("power", percent=10.0)
        await asyncio.sleep(0.2)
        assert pins.pin(18).state == 0

    play("FAN-5V", machine_at(tmp_path), scene)


def test_a_tone_ends_by_itself(tmp_path: Path, pins: Any) -> None:
    async def scene(bench: Bench) -> None:
        bench.send("tone", hertz=1000.0, seconds=0.5)
        await asyncio.sleep(0.2)
        assert (pins.pin(18).frequency, pins.pin(18).state) == (1000, 0.25)
        await asyncio.sleep(0.5)
        assert pins.pin(18).state == 0

    play("BUZZER", machine_at(tmp_path), scene)


def test_a_camera_is_pressed_and_pictures_are_counted(tmp_path: Path, pins: Any) -> None:
    async def scene(bench: Bench) -> None:
        for index in (1, 2, 3):
            bench.send("trigger", index=index)
            await asyncio.sleep(0.1)
            assert pins.pin(17).state == 1
            await asyncio.sleep(0.9)
            assert pins.pin(17).state == 0
        assert bench.last("taken") == {"value": 3}

    play("CAM-TRIGGER", machine_at(tmp_path), scene)


def test_a_gripper_does_not_say_what_it_cannot_feel(tmp_path: Path, pins: Any) -> None:
    async def scene(bench: Bench) -> None:
        bench.send("grip", percent=100.0)
        await asyncio.sleep(3)
        assert bench.heard["holding"] == []

    play("GRIPPER", machine_at(tmp_path), scene)


def test_a_pin_that_is_used_twice_is_said(tmp_path: Path, pins: Any) -> None:
    from gpiozero import LED

    other = LED(17)

    async def scene(bench: Bench) -> None:
        await asyncio.sleep(3)
        assert "GPIO 17 is used twice" in bench.unit.fault
        other.close()
        await bench.until_active()

    play("LED", machine_at(tmp_path), scene, joins=False)


def test_a_stepper_steps_in_the_order_of_the_data_sheet_and_counts(tmp_path: Path, pins: Any) -> None:
    gpios = (17, 18, 27, 22)
    seen: list[int] = []

    async def scene(bench: Bench) -> None:
        bench.send("speed", rpm=15.0)
        stepper = bench.unit._driver
        original = stepper.step  # type: ignore[attr-defined]

        def step(direction: int) -> None:
            original(direction)
            seen.append(sum(int(pins.pin(gpio).state) << bit for bit, gpio in enumerate(gpios)))

        stepper.step = step  # type: ignore[attr-defined]
        await bench.until(lambda: len(seen) >= 40)
        bench.master.say_stop("a test")
        await asyncio.sleep(0.5)
        await bench.unit._in_bus(lambda: None)

    play("28BYJ-48", machine_at(tmp_path), scene)
    order = [HALF_STEPS.index(pattern) for pattern in seen]
    assert {(after - before) % 8 for before, after in pairwise(order)} == {1}
    assert {pins.pin(gpio).state for gpio in gpios} == {0}


def test_the_strip_gets_three_bits_for_each_of_its_bits() -> None:
    octets = frame([(0, 255, 0b10000001)])
    bits = "".join(f"{octet:08b}" for octet in octets.removesuffix(RESET))
    assert bits == "110" * 8 + "100" * 8 + "110" + "100" * 6 + "110", "green, red, blue; highest bit first"
    assert len(frame([(1, 2, 3)] * LAMPS)) == LAMPS * 9 + len(RESET)


def test_a_strip_shines_and_is_dark_at_the_end(tmp_path: Path) -> None:
    device = tmp_path / "dev" / "spidev0.0"
    device.parent.mkdir()
    device.touch()
    size = LAMPS * 9 + len(RESET)

    async def scene(bench: Bench) -> None:
        bench.send("colour", red=200, green=0, blue=100)
        bench.send("lamps", value=3)
        await asyncio.sleep(0.3)
        assert device.read_bytes()[-size:] == frame([(100, 0, 50)] * 3 + [(0, 0, 0)] * 5)

    play("WS2812B-8", machine_at(tmp_path), scene)
    assert device.read_bytes()[-size:] == frame([(0, 0, 0)] * LAMPS)


def test_a_strip_without_spi_is_said(tmp_path: Path) -> None:
    async def scene(bench: Bench) -> None:
        await asyncio.sleep(1)
        assert "switch SPI on with `sudo raspi-config nonint do_spi 0`" in bench.unit.fault

    play("WS2812B-8", machine_at(tmp_path), scene, joins=False)
