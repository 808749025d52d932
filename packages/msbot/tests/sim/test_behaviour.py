"""What the parts of the library do, one by one: the things a teacher would try first."""

from __future__ import annotations

import asyncio

import pytest

from msbot.config import Scalar
from tests.sim.robot import Bench, play


def test_a_relay_and_what_hangs_on_the_other_contact() -> None:
    async def scene(bench: Bench) -> None:
        assert bench.unit.readings() == {"coil": False, "closed": True}
        bench.send("on", on=True)
        await asyncio.sleep(0.1)
        assert bench.unit.readings() == {"coil": True, "closed": False}

    play("RELAY-1", scene, {"invert": True})


def test_a_buzzer_is_silent_when_its_time_is_over() -> None:
    async def scene(bench: Bench) -> None:
        bench.send("tone", hertz=440.0, seconds=2.0)
        await asyncio.sleep(1)
        assert bench.unit.readings() == {"hertz": 440.0, "loudness": 30.0}
        await asyncio.sleep(1.5)
        assert bench.unit.readings() == {"hertz": 0.0, "loudness": 0.0}

    play("BUZZER", scene, {"volume": 30.0})


def test_a_colour_lamp_shows_its_colour_dimmed() -> None:
    async def scene(bench: Bench) -> None:
        bench.send("colour", red=255, green=128, blue=0)
        await asyncio.sleep(0.1)
        assert bench.unit.readings() == {"shines": "#804000"}

    play("RGB-LED", scene, {"brightness": 0.5})


def test_a_display_shows_what_fits() -> None:
    async def scene(bench: Bench) -> None:
        bench.send("text", text="Hello, this is a long line\nsecond\nthird")
        await asyncio.sleep(0.1)
        assert bench.unit.readings() == {"screen": "Hello, this is a\nsecond", "lit": True}

    play("LCD1602", scene)


def test_an_imu_that_lies_flat_feels_gravity_from_below_and_tilted_from_the_side() -> None:
    async def scene(bench: Bench) -> None:
        await asyncio.sleep(0.2)
        flat = bench.last("acceleration")
        assert [flat[axis] for axis in "xyz"] == [pytest.approx(value, abs=0.2) for value in (0, 0, 9.81)]
        bench.unit.set("roll", 90)
        bench.unit.set("spin", 90)
        await asyncio.sleep(0.2)
        tilted = bench.last("acceleration")
        assert [tilted[axis] for axis in "xyz"] == [pytest.approx(value, abs=0.2) for value in (0, 9.81, 0)]
        assert bench.last("rotation")["z"] == pytest.approx(90, abs=1)

    play("MPU-6050", scene)


def test_a_keypad_says_which_key_is_pressed_and_let_go() -> None:
    async def scene(bench: Bench) -> None:
        assert bench.heard["key"] == []
        for key in ("7", "none", "#", "none"):
            bench.unit.set("finger", key)
            await asyncio.sleep(0.2)
        heard = [(getattr(message, "key", ""), getattr(message, "pressed", None)) for message in bench.heard["key"]]
        assert heard == [("7", True), ("7", False), ("#", True), ("#", False)]

    play("KEYPAD-4X4", scene)


@pytest.mark.parametrize(("volts", "percent"), [(8.4, 100), (7.4, 50), (6.0, 0)])
def test_a_battery_monitor_knows_how_full_it_is(volts: float, percent: float) -> None:
    async def scene(bench: Bench) -> None:
        bench.unit.set("voltage", volts)
        await asyncio.sleep(1.5)
        assert bench.last("battery")["percent"] == pytest.approx(percent, abs=1)
        assert bench.last("low") == {"on": percent < 20}

    play("INA219", scene)


def test_a_gripper_closes_until_it_holds_something() -> None:
    async def scene(bench: Bench) -> None:
        bench.unit.set("thing", 20)
        bench.send("grip", percent=100.0)
        await asyncio.sleep(2)
        assert bench.unit.readings() == {"opening": 20.0, "holds": True}
        assert bench.last("holding") == {"on": True}
        bench.unit.set("thing", 0)
        await asyncio.sleep(2)
        assert bench.unit.readings() == {"opening": 0.0, "holds": False}

    play("GRIPPER", scene)


def test_a_camera_takes_a_picture_for_each_trigger() -> None:
    async def scene(bench: Bench) -> None:
        for index in range(3):
            bench.send("trigger", index=index)
            await asyncio.sleep(0.1)
            assert bench.unit.readings() == {"pictures": index + 1, "shutter": True}
            await asyncio.sleep(1)
        assert bench.unit.readings()["shutter"] is False
        assert bench.last("taken") == {"value": 3}

    play("CAM-TRIGGER", scene)


def test_a_stepper_counts_its_steps() -> None:
    async def scene(bench: Bench) -> None:
        bench.send("speed", rpm=15.0)
        await asyncio.sleep(4)
        bench.send("speed", rpm=0.0)
        await asyncio.sleep(2)
        assert bench.last("position")["value"] == pytest.approx(2048, abs=20)
        assert bench.unit.readings()["turning"] == 0

    play("28BYJ-48", scene)


def test_beyond_its_range_a_range_sensor_sees_nothing() -> None:
    async def scene(bench: Bench) -> None:
        bench.unit.set("obstacle", 2.5)
        await asyncio.sleep(0.3)
        assert bench.last("distance")["in_range"] is False
        bench.unit.set("obstacle", 0.5)
        await asyncio.sleep(0.3)
        assert bench.last("distance")["in_range"] is True

    play("VL53L0X", scene)


def test_the_usb_module_switches_pins_and_reads_others() -> None:
    async def scene(bench: Bench) -> None:
        await asyncio.sleep(10)  # it says how all its inputs stand that often
        bench.send("out_3", on=True)
        bench.unit.set("pin_7", True)
        await asyncio.sleep(0.2)
        on = {name for name, value in bench.unit.readings().items() if value}
        assert on == {"output_3"}
        assert bench.last("in_7") == {"on": True}
        assert bench.last("in_6") == {"on": False}

    play("NUMATO-8", scene)


def test_the_thesis_toggle_switch_switches_the_output_it_is_told() -> None:
    readings: list[dict[str, Scalar]] = []

    async def scene(bench: Bench) -> None:
        for number in (3, 5):
            bench.send("in", index=1, message=f"Publisher A(1) turn-on {number}")
            await asyncio.sleep(1.1)
            readings.append(dict(bench.unit.readings()))
        texts = [getattr(message, "message", "") for message in bench.heard["out"]]
        assert texts[-2:] == ["Publisher B(2) gpio-3 = 1", "Publisher B(2) gpio-3 = 0"]

    play("EFGH", scene)
    assert readings == [{"output": "3", "gpio_3": True}, {"output": "5", "gpio_3": False}]


def test_a_scanner_says_eight_distances_from_right_to_left() -> None:
    async def scene(bench: Bench) -> None:
        bench.unit.set("left", 0.5)
        bench.unit.set("right", 9.0)
        await asyncio.sleep(0.3)
        scan = bench.last("scan")
        metres = scan["metres"]
        assert isinstance(metres, list)
        expected = [4.0] * 3 + [2.0] * 2 + [0.5] * 3
        assert metres == [pytest.approx(value, abs=0.05) for value in expected]
        assert (scan["angle_min"], scan["angle_step"], scan["reach"]) == (-19.6875, 5.625, 4.0)

    play("VL53L5CX", scene)


def test_a_strip_shows_the_colours_that_it_was_told_and_none_when_it_is_safe() -> None:
    async def scene(bench: Bench) -> None:
        bench.send("strip", colours="[[255, 0, 0], [0, 0, 9]]")
        await asyncio.sleep(0.1)
        assert bench.unit.readings() == {"colours": "[[255, 0, 0], [0, 0, 9]]"}
        bench.master.say_stop("ada")
        await asyncio.sleep(0.5)
        assert bench.unit.readings() == {"colours": "[]"}

    play("WS2812B-STRIP", scene)
