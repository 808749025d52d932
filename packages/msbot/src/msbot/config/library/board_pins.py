"""What the pins of common boards can do, so that a wire at the wrong pin is seen before anybody solders it.

Sources: Raspberry Pi Pico datasheet, 2.1 (pinout; GPIO 23 to 25 and 29 serve the board itself); ESP32 series datasheet,
table "Pin overview" and section 2.4 (GPIO 34 to 39 are inputs only; 6 to 11 go to the flash), and ESP32 technical
reference manual 29.3 (ADC2 cannot measure while Wi-Fi is on, so only ADC1, GPIO 32 to 39, counts).
"""

from __future__ import annotations

from collections.abc import Mapping

from msbot.config.library.board_drivers import BOARD_DRIVERS
from msbot.config.library.board_wiring import WiredPart
from msbot_agent.text.sentence import Sentence, said
from msbot_xrce.common.lazy_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class BoardChip:
    """The pins of one kind of board, by number."""

    pins: frozenset[int]
    """Those that are there for whoever uses the board."""
    inputs_only: frozenset[int]
    analog: frozenset[int]
    """Those that measure a voltage."""


CHIPS: Mapping[str, BoardChip] = {
    "Raspberry Pi Pico": BoardChip(frozenset({*range(23), 25, 26, 27, 28}), frozenset(), frozenset({26, 27, 28})),
    "ESP32": BoardChip(
        frozenset({*range(6), *range(12, 20), 21, 22, 23, 25, 26, 27, *range(32, 40)}),
        frozenset(range(34, 40)),
        frozenset(range(32, 40)),
    ),
}
"""On all of them each pin that can be an output can do PWM. Pin 25 of a Pico is its lamp."""
_DRIVEN = {"ultrasonic": ("trigger",), "keypad": ("r1", "r2", "r3", "r4"), "onewire": ("data",),
           "dht22": ("data",)}  # fmt: skip
"""Wires that a driver which reads must drive as well."""


def pin_faults(board: str, part: WiredPart) -> list[Sentence]:
    """What the pins of such a board cannot do for a part; nothing about boards that are not known, or named pins."""
    chip = CHIPS.get(board)
    if chip is None:
        return []
    spec = part.part_type.driver
    driver = BOARD_DRIVERS[spec.board.driver]
    analog = {pin.name for pin in spec.pins if pin.analog}
    driven = set(part.pins) if driver.module in ("driver_out", "driver_i2c") else {*_DRIVEN.get(spec.board.driver, ())}
    faults = []
    for wire, pin in part.pins.items():
        if not isinstance(pin, int):
            continue
        if pin not in chip.pins:
            faults.append(said("{wire}: the {board} has no free pin {pin}", wire=wire, board=board, pin=pin))
        elif wire in analog and pin not in chip.analog:
            known = ", ".join(map(str, sorted(chip.analog)))
            faults.append(
                said("{wire}: pin {pin} of the {board} cannot measure a voltage; these can: {known}",
                     wire=wire,
                     pin=pin,
                     board=board, known=known)
            )  # fmt: skip
        elif wire in driven and pin in chip.inputs_only:
            faults.append(
                said("{wire}: pin {pin} of the {board} is an input only: no output, no PWM; take another one",
                     wire=wire,
                     pin=pin, board=board)
            )  # fmt: skip
    return faults
