"""Sensors behind files of the kernel, in a tree below a temporary folder: converters, 1-Wire, iio; and a GPS."""

from __future__ import annotations

import asyncio
import math
import os
import pty
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot.hardware import make_wiring
from msbot.hardware.drivers.converters import gas_ppm
from msbot.hardware.drivers.gps import place, sentence
from tests.hardware.robot import Bench, machine_at, play
from tests.sim.robot import LIBRARY

IIO = "sys/bus/iio/devices"
MCP3008_SCALE = 3300 / 1024
"""LSB = VREF / 1024 (Microchip DS21295, equation 4-1), in mV; the kernel's driver mcp320x says it so."""


def write(root: Path, files: dict[str, object], folder: str = f"{IIO}/iio:device0") -> None:
    (root / folder).mkdir(parents=True, exist_ok=True)
    for name, value in files.items():
        (root / folder / name).write_text(f"{value}\n")


def volts(*channels: float) -> dict[str, object]:
    """What the kernel says when an MCP3008 measures these."""
    raw: dict[str, object] = {f"in_voltage{n}_raw": round(v * 1024 / 3.3) for n, v in enumerate(channels)}
    return raw | {"in_voltage_scale": MCP3008_SCALE, "name": "mcp3008"}


@pytest.mark.parametrize(
    ("number", "port", "field", "measured", "expected"),
    [
        ("POT-10K", "level", "percent", 1.65, 50),
        ("POT-10K", "level", "percent", 0.0, 0),
        ("SOIL", "moisture", "percent", 2.0, 50),
        ("SOIL", "moisture", "percent", 3.3, 0),
        ("KY-037", "level", "percent", 0.825, 25),
    ],
)
def test_volts_become_what_the_port_says(
    number: str, port: str, field: str, measured: float, expected: float, tmp_path: Path
) -> None:
    write(tmp_path, volts(measured))

    async def scene(bench: Bench) -> None:
        await asyncio.sleep(2)
        assert bench.last(port)[field] == pytest.approx(expected, abs=0.3)

    play(number, machine_at(tmp_path), scene)


def test_a_knob_that_hardly_moves_is_not_news(tmp_path: Path) -> None:
    write(tmp_path, volts(1.65))

    async def scene(bench: Bench) -> None:
        await asyncio.sleep(1)
        write(tmp_path, {"in_voltage0_raw": 514})
        await asyncio.sleep(1)
        assert bench.last("level") == {"percent": 50}
        write(tmp_path, {"in_voltage0_raw": 1023})
        await asyncio.sleep(0.2)
        assert bench.last("level")["percent"] == pytest.approx(99.9, abs=0.05)

    play("POT-10K", machine_at(tmp_path), scene)


def test_a_loud_noise_is_told(tmp_path: Path) -> None:
    write(tmp_path, volts(0.3))

    async def scene(bench: Bench) -> None:
        await asyncio.sleep(0.5)
        assert bench.last("loud") == {"on": False}
        write(tmp_path, volts(3.0))
        await asyncio.sleep(0.2)
        assert bench.last("loud") == {"on": True}

    play("KY-037", machine_at(tmp_path), scene)


def test_a_converter_that_is_not_there_and_one_with_its_own_scale(tmp_path: Path) -> None:
    async def scene(bench: Bench) -> None:
        await asyncio.sleep(1)
        assert "dtoverlay=mcp3008" in bench.unit.fault
        # An ADS1115 has a scale and an offset for each channel.
        write(
            tmp_path,
            {"in_voltage2_raw": 15000, "in_voltage2_scale": 0.125, "in_voltage2_offset": -1800},
            f"{IIO}/iio:device1",
        )
        await bench.until_active()
        await asyncio.sleep(0.5)
        assert bench.last("level") == {"percent": 50}
        (tmp_path / IIO / "iio:device1/in_voltage2_raw").unlink()
        await bench.until_gone()

    wiring = make_wiring(LIBRARY.require("POT-10K"), adc="out=1:2")
    play("POT-10K", machine_at(tmp_path), scene, wiring=wiring, joins=False)


@pytest.mark.parametrize(
    ("black", "position", "seen"),
    [((1,), -1, True), ((8,), 1, True), ((4, 5), 0, True), ((5,), 0.14, True), ((), None, False)],
)
def test_a_line_is_where_the_dark_sensors_are(
    black: tuple[int, ...], position: float | None, seen: bool, tmp_path: Path
) -> None:
    write(tmp_path, volts(*(3.2 if sensor in black else 0.3 for sensor in range(1, 9))))

    async def scene(bench: Bench) -> None:
        await asyncio.sleep(0.5)
        line = bench.last("line")
        assert line["seen"] is seen
        if position is not None:
            assert line["position"] == pytest.approx(position, abs=0.01)

    play("QTR-8A", machine_at(tmp_path), scene)


def test_gas_by_the_figures_of_the_data_sheet() -> None:
    assert gas_ppm(1.0) == pytest.approx(1000), "R0 is the resistance at 1000 ppm of hydrogen"
    assert gas_ppm(0.6) == pytest.approx(3000), "concentration slope rate, 3000 to 1000 ppm"
    assert gas_ppm(1e-9) == 10_000


@given(st.floats(0, 1e6, allow_nan=False))
def test_no_resistance_makes_a_gas_that_cannot_be(ratio: float) -> None:
    assert 0 <= gas_ppm(ratio) <= 10_000


def test_gas_warns(tmp_path: Path) -> None:
    # 10 kilo-ohms of sensor over 5 of load at 5 V: a third of the supply.
    write(tmp_path, {"in_voltage0_raw": round(5 / 3 * 1000), "in_voltage_scale": 1.0})

    async def scene(bench: Bench) -> None:
        await asyncio.sleep(1)
        assert bench.last("gas")["ppm"] == pytest.approx(1000, abs=2)
        write(tmp_path, {"in_voltage0_raw": 4500})
        await asyncio.sleep(1)
        assert bench.last("alarm") == {"on": True}

    play("MQ-2", machine_at(tmp_path), scene)


W1 = "sys/bus/w1/devices"
GOOD = "91 01 4b 46 7f ff 0f 10 25 : crc=25 YES\n91 01 4b 46 7f ff 0f 10 25 t=25062"
"""0191h is +25.0625 degrees (DS18B20 data sheet, table 1)."""
NEGATIVE = "5e ff 4b 46 7f ff 02 10 c9 : crc=c9 YES\n5e ff 4b 46 7f ff 02 10 c9 t=-10125"
BAD = GOOD.replace("YES", "NO")
RESET = "50 05 4b 46 7f ff 0c 10 1c : crc=1c YES\n50 05 4b 46 7f ff 0c 10 1c t=85000"


@pytest.mark.parametrize(("text", "celsius"), [(GOOD, 25.0625), (NEGATIVE, -10.125)])
def test_a_thermometer_on_1_wire(text: str, celsius: float, tmp_path: Path) -> None:
    write(tmp_path, {"w1_slave": text}, f"{W1}/28-0316a2795eff")

    async def scene(bench: Bench) -> None:
        await asyncio.sleep(2)
        assert bench.last("temperature") == {"celsius": celsius}

    play("DS18B20", machine_at(tmp_path), scene)


@pytest.mark.parametrize(("text", "words"), [(BAD, "wrong CRC"), (RESET, "lost its power"), ("", "wrong CRC")])
def test_what_a_thermometer_cannot_have_measured_is_not_said(text: str, words: str, tmp_path: Path) -> None:
    write(tmp_path, {"w1_slave": GOOD}, f"{W1}/28-0316a2795eff")

    async def scene(bench: Bench) -> None:
        await asyncio.sleep(1)
        write(tmp_path, {"w1_slave": text}, f"{W1}/28-0316a2795eff")
        await bench.until_gone()
        assert words in bench.unit.fault
        assert bench.last("temperature") == {"celsius": 25.0625}
        write(tmp_path, {"w1_slave": GOOD}, f"{W1}/28-0316a2795eff")
        await bench.until_active()

    play("DS18B20", machine_at(tmp_path), scene)


def test_of_several_thermometers_one_must_be_named(tmp_path: Path) -> None:
    for name in ("28-aaaa", "28-bbbb"):
        write(tmp_path, {"w1_slave": GOOD}, f"{W1}/{name}")

    async def scene(bench: Bench) -> None:
        await asyncio.sleep(1)
        assert "name one with --device 28-aaaa or 28-bbbb" in bench.unit.fault

    async def named(bench: Bench) -> None:
        await asyncio.sleep(2)
        assert bench.heard["temperature"]

    play("DS18B20", machine_at(tmp_path), scene, joins=False)
    play("DS18B20", machine_at(tmp_path), named, wiring=make_wiring(LIBRARY.require("DS18B20"), device="28-bbbb"))


def test_no_thermometer_at_all_is_said(tmp_path: Path) -> None:
    async def scene(bench: Bench) -> None:
        await asyncio.sleep(1)
        assert "dtoverlay=w1-gpio" in bench.unit.fault

    play("DS18B20", machine_at(tmp_path), scene, joins=False)


def test_climate_by_the_kernels_driver(tmp_path: Path) -> None:
    # 0000 0010 1001 0010 = 65.8 %, 0000 0001 0000 1101 = 26.9 degrees (Aosong AM2302 manual, section 5).
    files = {"name": "dht11@0", "in_temp_input": 26900, "in_humidityrelative_input": 65800}
    write(tmp_path, {"name": "mcp3008"})
    write(tmp_path, files, f"{IIO}/iio:device1")

    async def scene(bench: Bench) -> None:
        await asyncio.sleep(5)
        assert bench.last("temperature") == {"celsius": pytest.approx(26.9)}
        assert bench.last("humidity") == {"percent": pytest.approx(65.8)}
        (tmp_path / IIO / "iio:device1/in_temp_input").unlink()
        await bench.until_gone()
        write(tmp_path, files, f"{IIO}/iio:device1")
        await bench.until_active()

    play("DHT22", machine_at(tmp_path), scene)


@pytest.mark.parametrize(("millimetres", "metres", "in_range"), [(345, 0.345, True), (8190, 2.0, False)])
def test_time_of_flight_by_the_kernels_driver(millimetres: int, metres: float, in_range: bool, tmp_path: Path) -> None:
    write(tmp_path, {"name": "vl53l0x", "in_distance_raw": millimetres, "in_distance_scale": "0.001000"})

    async def scene(bench: Bench) -> None:
        await asyncio.sleep(0.5)
        assert bench.last("distance") == {"metres": pytest.approx(metres), "in_range": in_range}

    play("VL53L0X", machine_at(tmp_path), scene)


def test_a_sensor_that_the_kernel_does_not_know_is_said(tmp_path: Path) -> None:
    async def scene(bench: Bench) -> None:
        await asyncio.sleep(1)
        assert "the kernel knows no VL53L0X" in bench.unit.fault
        assert "new_device" in bench.unit.fault

    play("VL53L0X", machine_at(tmp_path), scene, joins=False)


GGA = b"$GPGGA,092725.00,4717.11399,N,00833.91590,E,1,8,1.01,499.6,M,48.0,M,,0*5B\r\n"
"""The example of the u-blox 6 receiver description, section "GGA"."""


def test_the_place_in_the_example_of_the_manual() -> None:
    found = place(sentence(GGA))
    assert found is not None
    assert tuple(found) == pytest.approx((47 + 17.11399 / 60, 8 + 33.9159 / 60, 499.6, 8))


@pytest.mark.parametrize(
    "line",
    [
        GGA.replace(b"5B", b"5C"),
        GGA.replace(b"4717", b"4718"),
        b"",
        b"$*",
        b"$GPGGA*" + b"\xff" * 20,
        b"$GPTXT,01,01,02,ANTSTATUS=OK*3B",
    ],
)
def test_what_is_no_place_is_none(line: bytes) -> None:
    assert place(sentence(line)) is None


@given(st.binary(max_size=120))
def test_any_octets_are_a_place_or_none(line: bytes) -> None:
    found = place(sentence(line))
    assert found is None or math.isfinite(found.latitude)


@pytest.fixture
def receiver(tmp_path: Path) -> Iterator[int]:
    """The receiver's end of a serial line at /dev/serial0."""
    ours, theirs = pty.openpty()
    (tmp_path / "dev").mkdir()
    (tmp_path / "dev/serial0").symlink_to(os.ttyname(theirs))
    os.close(theirs)
    yield ours
    os.close(ours)


def test_a_gps_says_where_it_is_and_nothing_without_satellites(tmp_path: Path, receiver: int) -> None:
    async def scene(bench: Bench) -> None:
        os.write(receiver, b"$GPGGA,,,,,,0,00,99.99,,,,,,*48\r\n" + GGA[:20])
        await asyncio.sleep(2)
        assert bench.heard["place"] == []
        os.write(receiver, GGA[20:])
        await asyncio.sleep(2)
        assert bench.last("place") == {
            "latitude": pytest.approx(47.285233),
            "longitude": pytest.approx(8.565265),
            "altitude": pytest.approx(499.6),
            "satellites": 8,
        }
        said = len(bench.heard["place"])
        await asyncio.sleep(3)
        assert len(bench.heard["place"]) == said, "what it says once is said once"

    play("NEO-6M", machine_at(tmp_path), scene)
