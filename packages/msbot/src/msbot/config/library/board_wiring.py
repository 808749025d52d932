"""What is wired to a board: `HC-SR04 eye: trigger=5, echo=18`, the value of a parameter of type `part`.

Part number, the part's name (its number if absent), a colon, then its wires: NAME=PIN, where PIN is a number or a name
that MicroPython knows (`PB8`, `X1`). Chips on I2C have `scl`, `sda` and, unless it is the usual one, `address`. Options
of the driver may follow: `sound_m_s=340`. An empty text: nothing is wired.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from msbot.config.library.board_drivers import ADDRESS, BOARD_DRIVERS
from msbot.config.library.part_library import Library
from msbot.config.library.part_types import DriverSpec, PartType
from msbot_agent.text.sentence import Sentence, said
from msbot_agent.toml.problems import suggestion
from msbot_agent.toml.table import Scalar
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

MOST_PARTS = 8
"""Most parts of one board: each has a session of its own, and takes some kilobytes of the board's memory."""
MOST_NAME = 60
MOST_PIN = 255
EXAMPLE = "HC-SR04 eye: trigger=5, echo=18"
_PIN = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,11}")

BoardPin = int | str
"""A pin as MicroPython's `Pin` wants it."""


@dataclass(frozen=True, slots=True)
class WiredPart:
    """One part that is wired to a board."""

    part_type: PartType
    number: str
    """The part number that it shows, perhaps with a version."""
    name: str
    pins: Mapping[str, BoardPin]
    address: int | None
    """Of a chip on I2C."""
    options: Mapping[str, Scalar]


def wired_part(text: str, library: Library) -> WiredPart | None:
    """What a text says; None: nothing is wired.

    Raises:
        ConfigError: it makes no sense; the text says what would be right.
    """
    if not text.strip():
        return None
    head, colon, wires = text.partition(":")
    number, name = part_number_and_name(head)
    if not (colon and number and len(name) <= MOST_NAME):
        raise ConfigError(
            said(
                "{text!r}: write part number, name, colon and wires, for example {example}", text=text, example=EXAMPLE
            )
        )
    part_type = library.require(number)
    spec = part_type.driver
    if not spec.board.driver:
        raise ConfigError(said("part {number} has no driver for boards; see `msbot library list`", number=number))
    said_wires = _pairs(text, wires)
    options = {name: said_wires.pop(name) for name in [one.name for one in spec.options] if name in said_wires}
    address = _address(number, spec, said_wires.pop(ADDRESS, ""))
    return WiredPart(part_type, number, name, _pins(number, spec, said_wires), address, _options(spec, options))


def part_number_and_name(text: str) -> tuple[str, str]:
    """Part number and name that the part of a text shows; the wires may be missing."""
    number, _, name = text.partition(":")[0].strip().partition(" ")
    return number, name.strip() or number


def wired_parts(texts: Mapping[str, str], library: Library) -> dict[str, WiredPart]:
    """The parts of a board, by the parameters that say so.

    Raises:
        ConfigError: one makes no sense, or two want the same pin, name or address.
    """
    found: dict[str, WiredPart] = {}
    for parameter, text in texts.items():
        try:
            part = wired_part(text, library)
        except ConfigError as error:
            raise ConfigError(said("{parameter}: {fault}", parameter=parameter, fault=error.args[0])) from None
        if part is not None:
            found[parameter] = part
    _check_together(found)
    return found


def _check_together(parts: Mapping[str, WiredPart]) -> None:
    taken: dict[str, tuple[str, bool]] = {}
    names: dict[str, str] = {}
    for parameter, part in parts.items():
        if (other := names.setdefault(part.name, parameter)) != parameter:
            raise ConfigError(
                said(
                    "{parameter}: {other} is called {name!r}, too; give each part of a board a name of its own",
                    parameter=parameter,
                    other=other,
                    name=part.name,
                )
            )
        on_i2c = part.address is not None
        claims = {said("pin {pin}", pin=pin): on_i2c for pin in part.pins.values()}
        if on_i2c:
            address = said(
                "address 0x{address:02x} of the I2C at pin {sda}", address=part.address, sda=part.pins["sda"]
            )
            claims[address] = False
        if len(part.pins) != len(set(part.pins.values())):
            raise ConfigError(said("{parameter}: two wires are at one pin; give each its own", parameter=parameter))
        for claim, shared in claims.items():
            owner, was_shared = taken.setdefault(claim, (parameter, shared))
            if owner != parameter and not (shared and was_shared):
                raise ConfigError(
                    said(
                        "{parameter}: {claim} is taken by {owner}; wire one of them elsewhere",
                        parameter=parameter,
                        claim=claim,
                        owner=owner,
                    )
                )


def _pairs(text: str, wires: str) -> dict[str, str]:
    found: dict[str, str] = {}
    for piece in filter(None, (piece.strip() for piece in wires.replace(",", " ").split())):
        name, sign, value = piece.partition("=")
        if not (sign and name and value):
            raise ConfigError(said("{text!r}: {piece!r} needs a name and a pin, as in echo=18", text=text, piece=piece))
        if name in found:
            raise ConfigError(said("{text!r}: {name} is there twice", text=text, name=name))
        found[name] = value
    return found


def _pins(number: str, spec: DriverSpec, wires: Mapping[str, str]) -> dict[str, BoardPin]:
    known = list(spec.board.pins)
    optional = {pin.name for pin in spec.pins if pin.default is None}
    for name in wires:
        if name not in known:
            more = [ADDRESS] if BOARD_DRIVERS[spec.board.driver].on_i2c else []
            words = [*known, *more, *(option.name for option in spec.options)]
            right = suggestion(name, words, none_known=said("leave it out"))
            raise ConfigError(
                said('part {number} has no wire or option "{name}"; {right}', number=number, name=name, right=right)
            )
    if missing := [name for name in known if name not in wires and name not in optional]:
        example = ", ".join(f"{name}={pin}" for pin, name in enumerate(missing, 4))
        raise ConfigError(
            said(
                "part {number} has the wires {known}; say which pins of the board they go to: {example}",
                number=number,
                known=", ".join(known),
                example=example,
            )
        )
    return {name: _pin(number, name, wires[name]) for name in known if name in wires}


def _pin(number: str, name: str, text: str) -> BoardPin:
    if text.isdecimal() and text.isascii() and int(text) <= MOST_PIN:
        return int(text)
    if not _PIN.fullmatch(text):
        raise ConfigError(
            said(
                "pin {name} of part {number}: {text!r} is no pin; write {name}=17 or {name}=PB8",
                name=name,
                number=number,
                text=text,
            )
        )
    return text


def _address(number: str, spec: DriverSpec, text: str) -> int | None:
    if not BOARD_DRIVERS[spec.board.driver].on_i2c:
        if text:
            raise ConfigError(said("part {number} is not on I2C and has no address; leave it out", number=number))
        return None
    if not text:
        return spec.addresses[0]
    try:
        address = int(text, 0)
    except ValueError:
        address = -1
    if address not in spec.addresses:
        known = ", ".join(f"0x{one:02x}" for one in spec.addresses)
        raise ConfigError(
            said(
                "a {number} cannot have the I2C address {text}; it can have {known}",
                number=number,
                text=text,
                known=known,
            )
        )
    return address


def _options(spec: DriverSpec, given: Mapping[str, str]) -> dict[str, Scalar]:
    values: dict[str, Scalar] = {}
    for option in spec.options:
        text = given.get(option.name)
        value = option.default if text is None else option.kind.parse(text)
        wrong = said("must be {wanted}", wanted=option.kind.describe)
        fault = wrong if value is None else option.fault(value)
        if value is None or fault is not None:
            raise ConfigError(said("option {name} {fault}", name=option.name, fault=fault))
        values[option.name] = value
    return values


# What the pins of common boards can do, so that a wire at the wrong pin is seen before anybody solders it.
#
# Sources: Raspberry Pi Pico datasheet, 2.1 (pinout; GPIO 23 to 25 and 29 serve the board itself); ESP32 series
# datasheet, table "Pin overview" and section 2.4 (GPIO 34 to 39 are inputs only; 6 to 11 go to the flash), and ESP32
# technical reference manual 29.3 (ADC2 cannot measure while Wi-Fi is on, so only ADC1, GPIO 32 to 39, counts).


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
_DRIVEN = {"ultrasonic": ("trigger",), "keypad": ("r1", "r2", "r3", "r4"), "onewire": ("data",), "dht22": ("data",)}
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
                said(
                    "{wire}: pin {pin} of the {board} cannot measure a voltage; these can: {known}",
                    wire=wire,
                    pin=pin,
                    board=board,
                    known=known,
                )
            )
        elif wire in driven and pin in chip.inputs_only:
            faults.append(
                said(
                    "{wire}: pin {pin} of the {board} is an input only: no output, no PWM; take another one",
                    wire=wire,
                    pin=pin,
                    board=board,
                )
            )
    return faults
