"""Drivers and models of the generic board, compared with those of a computer: every type with a `[driver.board]`."""

from __future__ import annotations

import contextlib
import json
import math
import sys
import types
from collections.abc import Iterator
from random import Random
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msbot.config import (
    BOARD_DRIVERS,
    Direction,
    FieldKind,
    LeafType,
    ParameterKind,
    PartType,
    board_documents,
    wired_part,
)
from msbot.config.library.board_document import MOST_OCTETS, board_document
from msbot.sim.part_model import PartModel
from msbot_xrce.errors import ConfigError
from tests.homes import micro
from tests.homes.board_world import LIBRARY
from tests.homes.test_generic_board import BMP280, fake_machine

TYPES = [part_type for part_type in LIBRARY if part_type.driver.board.driver]
ON_A_BOARD = [part_type.number for part_type in TYPES]
ON_I2C = [one.number for one in TYPES if BOARD_DRIVERS[one.driver.board.driver].on_i2c]
OUTPUTS = [one.number for one in TYPES if BOARD_DRIVERS[one.driver.board.driver].module == "driver_out"]


def text_of(part_type: PartType, first: int = 2) -> str:
    """A wiring with a pin of its own for each wire."""
    wires = ", ".join(f"{wire}={pin}" for pin, wire in enumerate(part_type.driver.board.pins, first))
    return f"{part_type.number} unit: {wires}"


def document_of(part_type: PartType) -> dict[str, Any]:
    part = wired_part(text_of(part_type), LIBRARY)
    assert part is not None
    document: dict[str, Any] = json.loads(board_document(part))
    return document


@pytest.fixture
def board(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """The fake module `machine`; the home's modules are loaded anew."""
    micro.forget()
    machine = fake_machine()
    monkeypatch.setitem(sys.modules, "machine", machine)
    monkeypatch.setattr("time.sleep_ms", lambda _: None, raising=False)
    monkeypatch.setattr("time.sleep_us", lambda _: None, raising=False)
    yield machine
    micro.forget()


def driver_of(number: str, *, options: str = "") -> Any:
    """The opened driver of a part type, wired to pins 2, 3 and so on."""
    part_type = LIBRARY.require(number)
    part = wired_part(f"{text_of(part_type)} {options}", LIBRARY)
    assert part is not None
    document = json.loads(board_document(part))
    driver = micro.load(document["module"]).DRIVERS[document["driver"]](document)
    driver.open()
    return driver


def test_there_are_enough_and_eight_of_the_longest_fit() -> None:
    assert len(TYPES) >= 30
    longest = sorted(TYPES, key=lambda one: len(json.dumps(document_of(one))))[-8:]
    parts = {str(at): wired_part(text_of(one), LIBRARY) for at, one in enumerate(longest)}
    documents = board_documents({name: part for name, part in parts.items() if part is not None})
    assert sum(map(len, documents.values())) <= MOST_OCTETS


@pytest.mark.parametrize("number", ON_A_BOARD)
def test_its_driver_is_there(number: str, board: Any) -> None:
    document = document_of(LIBRARY.require(number))
    driver = micro.load(document["module"]).DRIVERS[document["driver"]]
    known = BOARD_DRIVERS[document["driver"]]
    assert driver.samples == bool(known.measured)
    assert driver.drives == (known.module == "driver_out")


@pytest.mark.parametrize("number", ON_A_BOARD)
@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_its_model_says_what_that_of_a_computer_says(number: str, seed: int) -> None:
    part_type = LIBRARY.require(number)
    document = document_of(part_type)
    random = Random(seed)
    fields = {port.name: port.message.leaves for port in part_type.ports if port.message is not None}
    generic = micro.load("generic") if "machine" in sys.modules else _generic()

    def fit(port: str, field: str, value: object) -> object:
        return generic.fit(_kind(fields[port][field]), value)

    theirs = PartModel(part_type, Random(1), ideal=True)
    ours = micro.load("model").Model(document, fit)
    spec = part_type.driver.board
    measured = spec.sources[: BOARD_DRIVERS[spec.driver].measured]
    now = 0
    theirs.start_at(0.0)
    first = {name: _measured(part_type, name, random) for name in measured}  # a part joins once something is measured
    theirs.feed(first, 0.0)
    ours.feed(first, 0)
    theirs.join(0.0)
    ours.begin(0)
    # Times are eighths of a second: a computer counts in floating point, a board in milliseconds, and both are exact.
    texts: dict[str, str] = {}
    for parameter in part_type.parameters:
        if parameter.unit == "s":
            seconds = _eighths(parameter.least or 0.25)
            theirs.set(parameter.name, seconds, 0.0)
            texts[parameter.name] = str(seconds)
    theirs.note_changes()
    ours.settings(texts, 0)
    for _ in range(20):
        now += random.choice([125, 125, 250, 1000])
        kind = random.choice(["measure", "message", "setting", "time"])
        if kind == "measure" and measured:
            values = {name: _measured(part_type, name, random) for name in measured}
            theirs.feed(values, now / 1000)
            ours.feed(values, now)
        elif kind == "message":
            for port in part_type.ports:
                if port.direction is Direction.SUBSCRIBE:
                    content = {name: _value(one, random) for name, one in fields[port.name].items()}
                    theirs.receive(port.name, content, now / 1000)
                    ours.receive(port.name, content, now)
        elif kind == "setting" and document.get("settings"):
            name = random.choice(document["settings"])
            parameter = next(one for one in part_type.parameters if one.name == name)
            if parameter.kind is ParameterKind.BOOL:
                value: Any = random.random() < 0.5
            else:
                least = 0.1 if parameter.least is None else parameter.least
                most = 10.0 if parameter.most is None else parameter.most
                value = random.uniform(least, most)
                value = _eighths(value) if parameter.unit == "s" else value
                value = int(value) if parameter.kind is ParameterKind.INT else value
            texts[parameter.name] = str(value).lower()
            theirs.set(parameter.name, value, now / 1000)
            theirs.note_changes()
            ours.settings(texts, now)
        theirs.advance(now / 1000)
        ours.advance(now)
        said: list[Any] = [
            (port, values) for port, values in theirs.due_messages(now / 1000) if port in document["ports"]
        ]
        assert [(port, pytest.approx(values)) for port, values in ours.say(now)] == said
        for source in spec.sources:
            assert ours.values[source] == pytest.approx(theirs.values[source], abs=1e-6), source


def _eighths(seconds: float) -> float:
    return math.ceil(seconds * 8) / 8


def _generic() -> Any:
    sys.modules["machine"] = fake_machine()
    try:
        return micro.load("generic")
    finally:
        del sys.modules["machine"]


def _kind(kind: LeafType) -> object:
    from msbot.config.library.board_document import CODES

    assert isinstance(kind, FieldKind)
    return {"s": str, "?": bool}.get(CODES[kind], CODES[kind])


def _measured(part_type: PartType, name: str, random: Random) -> Any:
    assert part_type.simulator is not None
    control = next((one for one in part_type.simulator.controls if one.name == name), None)
    if control is not None and isinstance(control.start, bool):
        return random.random() < 0.5
    if control is not None and control.choices:
        return random.choice(control.choices)
    return random.choice([0.0, 1.0, random.uniform(-200, 200)])


def _value(kind: LeafType, random: Random) -> Any:
    assert isinstance(kind, FieldKind)
    if kind is FieldKind.BOOL:
        return random.random() < 0.5
    if kind is FieldKind.TEXT:
        return random.choice(["", "a", "12"])
    if kind in (FieldKind.FLOAT32, FieldKind.FLOAT64):
        return random.choice([0.0, random.uniform(-150, 150)])
    return random.randint(0, 255)


# Sensors: the worked examples of the data sheets, and what is said when nothing answers.


def test_chips_on_i2c_give_the_values_of_their_data_sheets(board: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    board.plug(0x76, BMP280)
    bmp280 = driver_of("BMP280").sample({})
    assert (round(bmp280["air"], 2), round(bmp280["weather"], 2)) == (25.08, 1006.53)
    board.plug(0x23, [[0, "8378"]])  # ROHM 11046EDT01: 33656 counts are 28067 lx
    assert round(driver_of("BH1750").sample({})["brightness"] * 1.2) == 0x8378
    board.plug(0x40, [])
    ina219 = driver_of("INA219", options="shunt_ohm=0.002")
    registers = {1: b"\x07\xd0", 2: b"\x5d\x98"}  # SBOS448G, 8.6.3.1: 20 mV; 11.98 V; its registers are words
    with monkeypatch.context() as words:
        words.setattr(ina219._bus, "readfrom_mem", lambda _address, register, _size: registers[register])
        assert ina219.sample({}) == pytest.approx({"voltage": 11.98, "current": 10.0})
    board.plug(0x68, [[0x75, "68"], [0x3B, "0000 0000 4000 0000 0083 ff7d 0000".replace(" ", "")]])
    mpu = driver_of("MPU-6050").sample({})
    assert mpu == pytest.approx({"ahead": 0, "left": 0, "up": 9.80665, "drift_x": 1, "drift_y": -1, "turn": 0})
    board.plug(0x29, [[0xB2, "44"], [0xB3, "01"], [0xB4, "64003200190019 00".replace(" ", "")]])
    colour = driver_of("TCS34725").sample({})
    assert [colour[name] for name in ("red", "green", "blue")] == [128, 64, 64]


@pytest.mark.parametrize("number", ON_I2C)
def test_a_missing_chip_is_one_sentence(number: str, board: Any) -> None:
    part_type = LIBRARY.require(number)
    document = document_of(part_type)
    driver = micro.load("driver_i2c").DRIVERS[document["driver"]](document)
    with pytest.raises(OSError, match="19") as error:
        driver.open()
    address = part_type.driver.addresses[0]
    assert driver.words(error.value) == (
        f"no {number} answers at 0x{address:02x} (scl at pin 2, sda at pin 3): check its supply, both wires, and its "
        "address"
    )


def test_inputs_measure(board: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    ticks = [0]
    monkeypatch.setattr("time.ticks_ms", lambda: ticks[0], raising=False)
    monkeypatch.setattr("time.ticks_diff", lambda new, old: new - old, raising=False)
    eye = driver_of("HC-SR04")
    for us, metres in ((1000, 0.1715), (-1, 10.0), (36001, 6.174)):
        board.set_echo(us)
        assert eye.sample({})["obstacle"] == pytest.approx(metres, abs=1e-3)
    board.set_echo(-2)
    with pytest.raises(micro.load("driver").Fault, match=r"pins 2 \(trigger\) and 3 \(echo\) does not answer"):
        eye.sample({})
    wheel = driver_of("LM393-SPEED")
    for _ in range(10):
        board.drive(2, 1)
        board.drive(2, 0)
    ticks[0] = 500
    assert wheel.sample({"pulses_per_turn": 20, "invert": False}) == {"pulses": 10, "wheel": 60.0}
    wheel.close()
    board.drive(2, None)
    knob = driver_of("KY-040")
    for _ in range(3):  # three clicks to the right: CLK falls first
        for clk, dt in ((0, 1), (0, 0), (1, 0), (1, 1)):
            board.drive(2, clk)
            board.drive(3, dt)
    board.drive(4, 0)
    assert knob.sample({}) == {"clicks": 3, "press": True}
    for clk, dt in ((1, 0), (0, 0), (0, 1), (1, 1)):
        board.drive(2, clk)
        board.drive(3, dt)
    assert knob.sample({})["clicks"] == 2


def test_a_key_of_the_keypad_connects_its_row_with_its_column(board: Any) -> None:
    keypad = driver_of("KEYPAD-4X4")
    assert keypad.sample({}) == {"finger": "none"}
    column = board._line(8)  # C3

    class Wired(type(column)):  # type: ignore[misc]  # the fake's own class
        @property
        def driven(self) -> int | None:
            row = board._line(3)  # R2
            return 0 if row.mode == "out" and row.level == 0 else None

        @driven.setter
        def driven(self, _level: object) -> None:
            pass

    column.__class__ = Wired
    assert keypad.sample({}) == {"finger": "6"}
    assert [board._line(pin).mode for pin in range(2, 6)] == ["in"] * 4


def test_converters_measure(board: Any) -> None:
    def at(number: str, *volts: float, options: str = "") -> dict[str, Any]:
        for pin, one in enumerate(volts, 2):
            board.set_volts(pin, one)
        measured: dict[str, Any] = driver_of(number, options=options).sample({})
        return measured

    assert at("POT-10K", 0.825)["knob"] == pytest.approx(25, abs=0.01)
    assert at("SOIL", 2.0, options="dry_v=3 wet_v=1")["water"] == pytest.approx(50, abs=0.01)
    stick = at("KY-023", 3.3, 0.0)
    assert stick == {"left_right": 100.0, "back_ahead": -100.0, "press": False}
    line = at("QTR-8A", *[0.5] * 7, 3.0)
    assert line == {"line_there": True, "place": pytest.approx(1.0, abs=0.01)}
    assert at("QTR-8A", *[0.5] * 8) == {"line_there": False}
    clean = at("MQ-2", 1.0)["smoke"]
    assert at("MQ-2", 2.5)["smoke"] > clean


def test_thermometers_use_the_modules_that_micropython_brings(board: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    ticks = [0]
    monkeypatch.setattr("time.ticks_ms", lambda: ticks[0], raising=False)
    monkeypatch.setattr("time.ticks_diff", lambda new, old: new - old, raising=False)
    found = [b"12345678"]
    read = [25.0625]
    sensor = types.SimpleNamespace(scan=lambda: found, convert_temp=lambda: None, read_temp=lambda _rom: read[0])
    monkeypatch.setitem(sys.modules, "onewire", types.SimpleNamespace(OneWire=lambda pin: pin))
    monkeypatch.setitem(sys.modules, "ds18x20", types.SimpleNamespace(DS18X20=lambda _wire: sensor))
    fault = micro.load("driver").Fault
    thermometer = driver_of("DS18B20")
    assert thermometer.sample({}) is None
    ticks[0] = 800
    assert thermometer.sample({}) == {"water": 25.0625}
    ticks[0], read[0] = 1600, 85.0
    with pytest.raises(fault, match="had no power in between"):
        thermometer.sample({})
    found.clear()
    with pytest.raises(fault, match="no DS18B20 answers at pin 2"):
        driver_of("DS18B20")
    air = types.SimpleNamespace(measure=lambda: None, temperature=lambda: 26.9, humidity=lambda: 65.8)
    monkeypatch.setitem(sys.modules, "dht", types.SimpleNamespace(DHT22=lambda _pin: air))
    assert driver_of("DHT22").sample({}) == {"air": 26.9, "moisture": 65.8}
    assert board.look(2)[0] == "in"


# Outputs.


@pytest.mark.parametrize("number", OUTPUTS)
def test_outputs_are_off_at_first_and_when_closed(number: str, board: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    sent: list[list[tuple[int, ...]]] = []
    monkeypatch.setitem(sys.modules, "neopixel", types.SimpleNamespace(NeoPixel=lambda pin, count: _Strip(count, sent)))
    driver = driver_of(number)
    pins = list(driver.pins.values())
    assert [board.look(pin)[1] for pin in pins] == [0] * len(pins)
    names = driver.sources
    driver.drive(driver.outputs_for({name: {"pulses": 1}.get(name, 90.0) for name in names}))
    assert any(board.look(pin)[1] for pin in pins) or any(map(any, sent[-1]))
    driver.close()
    driver.close()
    assert [board.look(pin) for pin in pins] == [["in", 0]] * len(pins)
    assert not sent or not any(map(any, sent[-1]))


class _Strip(list[tuple[int, ...]]):
    def __init__(self, count: int, sent: list[list[tuple[int, ...]]]) -> None:
        super().__init__([(0, 0, 0)] * count)
        self._sent = sent

    def write(self) -> None:
        self._sent.append(list(self))


def test_a_lamp_that_shines_when_its_pin_is_low_is_off_when_it_is_high(board: Any) -> None:
    lamp = driver_of("LED", options="active_low=true")
    assert board.look(2) == ["out", 65535]
    lamp.drive(0.25)
    assert board.look(2) == ["out", round(65535 * 0.75)]


# What people write.


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("HC-SR04 eye", "write part number, name, colon and wires, for example HC-SR04 eye: trigger=5, echo=18"),
        (": a=1", "write part number, name, colon and wires"),
        ("HC-SR05 eye: trigger=5", 'the library has no part number "HC-SR05"; did you mean'),
        ("LCD1602 text: scl=1, sda=2", "part LCD1602 has no driver for boards"),
        ("HC-SR04 eye: trigger", "'trigger' needs a name and a pin, as in echo=18"),
        ("HC-SR04 eye: trigger=5, trigger=6", "trigger is there twice"),
        (
            "HC-SR04 eye: trigger=5",
            "part HC-SR04 has the wires trigger, echo; say which pins of the board they go to: echo=4",
        ),
        ("HC-SR04 eye: trigger=5, ecco=18", 'part HC-SR04 has no wire or option "ecco"; did you mean "echo"?'),
        ("HC-SR04 eye: trigger=5, echo=999", "pin echo of part HC-SR04: '999' is no pin; write echo=17 or echo=PB8"),
        ("HC-SR04 eye: trigger=5, echo=18, address=5", "part HC-SR04 is not on I2C and has no address; leave it out"),
        ("HC-SR04 eye: trigger=5, echo=18, sound_m_s=1", "option sound_m_s is 1.0; it must be 300 to 360 m/s"),
        ("BMP280 air: scl=1, sda=2, address=0x20", "a BMP280 cannot have the I2C address 0x20; it can have 0x76, 0x77"),
    ],
)
def test_a_mistake_is_one_sentence(text: str, words: str) -> None:
    with pytest.raises(ConfigError) as error:
        wired_part(text, LIBRARY)
    assert words in str(error.value)


@given(st.text(max_size=80))
def test_any_text_is_a_part_or_a_mistake_that_is_told(text: str) -> None:
    found: object = None
    with contextlib.suppress(ConfigError):
        found = wired_part(text, LIBRARY)
    assert found is None or text.strip()
