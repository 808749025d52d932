"""Where a part is connected: what is said on the command line or in the file, the defaults, and every mistake."""

from __future__ import annotations

from typing import Any

import pytest

from msbot.config import BusKind
from msbot.hardware import driver_class, make_wiring
from msbot.hardware.driver import bus_of
from msbot.hardware.output_guard import as_json, from_json
from msbot_xrce.errors import ConfigError
from tests.sim.robot import LIBRARY

DRIVEN = [part_type for part_type in LIBRARY if part_type.driver.entry_point]


def test_most_types_have_a_driver_and_the_others_say_why_not() -> None:
    assert len(DRIVEN) >= 43
    assert all(part_type.driver.none for part_type in LIBRARY if part_type not in DRIVEN)


@pytest.mark.parametrize("part_type", DRIVEN, ids=lambda part_type: part_type.number)
def test_every_driver_fits_its_type(part_type: Any) -> None:
    made = driver_class(part_type)
    assert made.samples or made.drives
    wiring = make_wiring(part_type)
    assert wiring.describe() or part_type.number == "DS18B20"
    assert from_json(as_json(wiring)) == wiring
    assert bus_of(part_type, wiring, "x")
    published = [port for port in part_type.ports if port.direction.value == "publish"]
    assert made.samples or not published or set(made.unknown_ports) == {port.name for port in published}, (
        "what a port says is measured, or not said"
    )
    assert made.drives == any(port.direction.value == "subscribe" for port in part_type.ports)
    wired = {pin.pin for pin in part_type.driver.pins}
    signals = {pin.name for pin in part_type.pins if pin.kind.value == "signal"}
    if part_type.driver.bus is BusKind.PINS:
        assert signals - wired <= {"RING", "NC2", "EN"}, "every signal of the part is wired"


def test_pins_by_name() -> None:
    sonar = LIBRARY.require("HC-SR04")
    assert dict(make_wiring(sonar).pins) == {"trigger": 23, "echo": 24}
    assert dict(make_wiring(sonar, pins="trigger=5, echo=GPIO6").pins) == {"trigger": 5, "echo": 6}
    assert dict(make_wiring(sonar, pins={"echo": 7}).pins) == {"trigger": 23, "echo": 7}
    assert make_wiring(sonar).describe() == "trigger = GPIO 23, echo = GPIO 24"


def test_i2c_channels_devices_and_options() -> None:
    barometer = LIBRARY.require("BMP280")
    assert make_wiring(barometer).i2c == (1, 0x76)
    assert make_wiring(barometer, i2c="0:0x77").i2c == (0, 0x77)
    assert make_wiring(barometer, i2c="3").i2c == (3, 0x76)
    knob = LIBRARY.require("POT-10K")
    assert dict(make_wiring(knob, adc="out=1:3").channels) == {"out": (1, 3)}
    assert make_wiring(knob, options=["full_v=5"]).number("full_v") == 5
    assert make_wiring(LIBRARY.require("NUMATO-8"), device="/dev/ttyACM3").device == "/dev/ttyACM3"
    assert make_wiring(LIBRARY.require("LED"), options={"active_low": True}).flag("active_low")


WRONG: list[tuple[str, dict[str, Any], str]] = [
    ("HC-SR04", {"pins": "trig=23"}, 'has no wire to a GPIO pin "trig"; did you mean "trigger"?'),
    ("HC-SR04", {"pins": "trigger"}, "'trigger' needs a name and a number"),
    ("HC-SR04", {"pins": "trigger=x"}, "'x' is no GPIO number; write trigger=17"),
    ("HC-SR04", {"pins": "trigger=1,trigger=2"}, "trigger is there twice"),
    ("HC-SR04", {"pins": "trigger=5,echo=5"}, "two wires are at GPIO 5"),
    ("HC-SR04", {"i2c": "1:0x76"}, "is not on I2C but on pins; leave --i2c out"),
    ("HC-SR04", {"device": "/dev/x"}, "has no device; it is connected by pins"),
    ("BMP280", {"i2c": "1:0x20"}, "a BMP280 cannot have the I2C address 0x20; it can have 0x76, 0x77"),
    ("BMP280", {"i2c": "one"}, "write bus and address, for example --i2c 1:0x76"),
    ("BMP280", {"pins": "sda=2"}, 'has no wire to a GPIO pin "sda"; leave it out'),
    ("POT-10K", {"adc": "out=a"}, "'a' is none; write out=0, or out=1:0 for channel 0 of iio:device1"),
    ("POT-10K", {"options": ["full_v"]}, "write NAME=VALUE; part POT-10K has full_v"),
    ("POT-10K", {"options": ["full_v=no"]}, "option full_v of part POT-10K is 'no'; it must be a number"),
    ("POT-10K", {"options": ["full_v=0"]}, "is 0.0; it must be 0.1 to 30 V"),
    ("POT-10K", {"options": {"fullv": 3}}, 'has no option "fullv"; did you mean "full_v"?'),
    ("ABCD", {}, "has no driver for hardware: what the thesis has it measure is drawn at random"),
]


@pytest.mark.parametrize(("number", "said", "sentence"), WRONG)
def test_a_mistake_is_one_sentence(number: str, said: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ConfigError) as caught:
        make_wiring(LIBRARY.require(number), **said)
    assert sentence in str(caught.value)
    assert "\n" not in str(caught.value)
