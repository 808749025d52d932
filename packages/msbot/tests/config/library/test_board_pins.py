"""A wire at a pin that cannot do what it is for is named; boards that are not known are not judged."""

from __future__ import annotations

import pytest

from msbot.config import load_library, wired_part
from msbot.config.library.board_wiring import pin_faults

LIBRARY = load_library()


@pytest.mark.parametrize(
    ("board", "text", "faults"),
    [
        ("ESP32", "HC-SR04: trigger=5, echo=34", []),
        ("ESP32", "HC-SR04: trigger=34, echo=5", ["trigger: pin 34 of the ESP32 is an input only"]),
        ("ESP32", "SG90: pwm=35", ["pwm: pin 35 of the ESP32 is an input only: no output, no PWM"]),
        ("ESP32", "BMP280: scl=36, sda=21", ["scl: pin 36 of the ESP32 is an input only"]),
        ("ESP32", "POT-10K: out=4", ["out: pin 4 of the ESP32 cannot measure a voltage; these can: 32, 33"]),
        ("ESP32", "LED: s=7", ["s: the ESP32 has no free pin 7"]),
        ("ESP32", "DHT22: data=39", ["data: pin 39"]),
        ("Raspberry Pi Pico", "POT-10K: out=26", []),
        ("Raspberry Pi Pico", "POT-10K: out=25", ["these can: 26, 27, 28"]),
        ("Raspberry Pi Pico", "LED: s=29", ["no free pin 29"]),
        ("Raspberry Pi Pico", "LED: s=LED", []),
        ("", "LED: s=200", []),
    ],
)
def test_what_a_pin_cannot_do_is_one_sentence(board: str, text: str, faults: list[str]) -> None:
    part = wired_part(text, LIBRARY)
    assert part is not None
    found = pin_faults(board, part)
    assert len(found) == len(faults)
    for fault, words in zip(found, faults, strict=True):
        assert words in fault
