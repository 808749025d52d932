"""The thesis' USB module on a pseudo terminal (T12): each of its commands, each bug of the original program, the part.

The bugs are those of the original's `usbgpio8.c` (thesis 3.12.3); the number behind each test is their order there.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest

from msbot.hardware import HardwareFault, make_wiring
from msbot.hardware.drivers.usb_gpio import parse_pins
from msbot.hardware.serial_stream import SerialStream
from msbot.part import NumatoGpio, PinDirection
from msbot_xrce.errors import LinkDown, LocalProtocolError, RemoteProtocolError
from tests.hardware.robot import Bench, machine_at, play
from tests.hardware.usb_module import Module, plugged_in
from tests.sim.robot import LIBRARY

OUT, IN = PinDirection.OUTPUT, PinDirection.INPUT


@pytest.fixture(params=[8, 16, 32])
def module(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Module]:
    with plugged_in(tmp_path / "ttyACM0", request.param) as module:
        yield module


@pytest.fixture
def stream(module: Module) -> Iterator[SerialStream]:
    stream = SerialStream(str(module.path), 115_200, "the USB module")
    yield stream
    stream.close()


@pytest.fixture
def gpio(module: Module, stream: SerialStream) -> NumatoGpio:
    return NumatoGpio(stream, pins=module.board.pins, timeout_s=30)  # the module is a thread: others may have its turn


def test_every_pin_is_set_read_and_cleared_and_no_other_moves(module: Module, gpio: NumatoGpio) -> None:
    pins = module.board.pins
    for pin in (0, 3, 7, pins // 2, pins - 1):
        gpio.set_direction(pin, OUT)
        gpio.set(pin)
        assert gpio.read(pin)
        assert gpio.read_all() == 1 << pin
        gpio.clear(pin)
        assert not gpio.read(pin)
        gpio.set_direction(pin, IN)
        module.board.drive(pin, level=True)
        assert gpio.read_all() == 1 << pin
        module.board.drive(pin, level=False)


def test_all_pins_at_once(module: Module, gpio: NumatoGpio) -> None:
    everything = (1 << module.board.pins) - 1
    gpio.set_directions(outputs=everything)
    for levels in (everything, 0, 0xA5 & everything, everything ^ 1):
        gpio.write_all(levels)
        assert gpio.read_all() == levels
    gpio.set_directions(outputs=0)
    assert gpio.read_all() == 0


def test_analog_inputs_version_and_id(module: Module, gpio: NumatoGpio) -> None:
    module.simulator.analog[:] = [100 * channel for channel in range(len(module.simulator.analog))]
    last = len(module.simulator.analog) - 1
    assert (gpio.adc(0), gpio.adc(last)) == (0, 100 * last)
    with pytest.raises(LocalProtocolError, match=f"no analog input {last + 1}: the module has 0 to {last}"):
        gpio.adc(last + 1)
    assert gpio.version() == "00000008"
    gpio.set_id("ROBOT007")
    assert gpio.id() == "ROBOT007"
    with pytest.raises(LocalProtocolError, match="must be 8 letters or digits"):
        gpio.set_id("robot")


# The bugs of the original.


def test_setup_of_a_module_that_is_not_there_is_an_error_and_not_a_success(tmp_path: Path) -> None:
    """1: `setup` returned true on failure and false on success."""
    with pytest.raises(HardwareFault, match="is it plugged in"):
        SerialStream(str(tmp_path / "ttyACM0"), 115_200, "the USB module")


def test_a_module_that_is_pulled_out_while_written_to_does_not_end_the_program(
    module: Module, gpio: NumatoGpio
) -> None:
    """2: a write error was `exit(1)`."""
    gpio.set_direction(0, OUT)
    module.pull_out()
    with pytest.raises(LinkDown, match="plug it in again"):
        gpio.set(0)


@pytest.mark.parametrize("piece", [1, 2, 13])
def test_an_answer_in_pieces_is_read_to_its_end(module: Module, gpio: NumatoGpio, piece: int) -> None:
    """3: a short read gave garbage: the value was the octet at offset 13 of whatever one read had brought."""
    module.piece = piece
    module.board.drive(5, level=True)
    assert [gpio.read(pin) for pin in (4, 5)] == [False, True]


def test_a_silent_module_is_told_after_a_time(module: Module, gpio: NumatoGpio) -> None:
    """4: there was no time-out."""
    module.silent = True
    gpio._timeout_s = 1.0
    with pytest.raises(LinkDown, match="check that it is plugged in"):
        gpio.read(0)


def test_what_is_no_answer_is_told_and_not_taken_for_one(module: Module, gpio: NumatoGpio) -> None:
    """5: echo and prompt were not looked at."""
    module.simulator._run = lambda line: "unknown command"  # type: ignore[method-assign]
    with pytest.raises(RemoteProtocolError, match="0 or 1 was expected"):
        gpio.read(0)
    with pytest.raises(RemoteProtocolError, match="hexadecimal digits were expected"):
        gpio.read_all()


def test_the_direction_of_one_pin_leaves_the_others_alone(module: Module, gpio: NumatoGpio) -> None:
    """6: setting one pin's direction made all others inputs."""
    for pin in range(module.board.pins):
        gpio.set_direction(pin, OUT)
    assert {module.board.direction(pin) for pin in range(module.board.pins)} == {OUT}
    gpio.set_direction(5, IN)
    assert [pin for pin in range(module.board.pins) if module.board.direction(pin) is IN] == [5]


@pytest.mark.parametrize("pin", [4, 5, 6, 7])
def test_masks_are_hexadecimal(module: Module, gpio: NumatoGpio, pin: int) -> None:
    """7: the mask of an input was printed in decimal, which is another pin from 4 up."""
    gpio.set_directions(outputs=0xFF)
    gpio.set_direction(pin, IN)
    assert [one for one in range(8) if module.board.direction(one) is IN] == [pin]


def test_masks_have_all_their_digits(module: Module, gpio: NumatoGpio) -> None:
    """8: masks had no leading zeros."""
    gpio.set_direction(0, OUT)
    digits = module.board.pins // 4
    said = b"".join(module.said).split(b"\r")
    masks = [line.split()[2] for line in said if line.startswith((b"gpio iomask", b"gpio iodir"))]
    assert {len(mask) for mask in masks} == {digits}


def test_pins_above_nine_are_letters(module: Module, gpio: NumatoGpio) -> None:
    """9: a pin was one digit."""
    if module.board.pins == 8:
        with pytest.raises(LocalProtocolError, match="there is no pin 10"):
            gpio.read(10)
        return
    gpio.set_direction(10, OUT)
    gpio.set(10)
    assert module.board.levels()[10]
    assert b"gpio set A\r" in b"".join(module.said)


# The module as a part.


def test_the_module_is_a_part_that_vanishes_and_comes_back(tmp_path: Path) -> None:
    """Besides, its path was fixed: here it is what `--device` says."""
    wiring = make_wiring(LIBRARY.require("NUMATO-8"), device="/dev/ttyUSB7")
    with plugged_in(tmp_path / "dev/ttyUSB7") as module:

        async def scene(bench: Bench) -> None:
            board = module.board
            assert [pin for pin in range(8) if board.direction(pin) is OUT] == [4, 5, 6, 7]
            bench.send("out_5", on=True)
            await bench.until(lambda: board.levels()[5])
            board.drive(2, level=True)
            await bench.until(lambda: bench.heard["in_2"] and bench.last("in_2") == {"on": True})
            bench.master.say_stop("a test")
            await bench.until(lambda: bench.master.stop.silent == ())
            assert not board.levels()[5], "STOP is confirmed when the pin is off, not before"
            bench.master.say_go("a test")
            module.pull_out()
            await bench.until_gone()
            assert "ttyUSB7" in bench.unit.fault
            await asyncio.sleep(3)
            module.plug_in()
            await bench.until_active()
            bench.send("out_5", on=True)
            await bench.until(lambda: board.levels()[5])

        play("NUMATO-8", machine_at(tmp_path), scene, wiring=wiring)
        assert module.board.levels()[4:] == (False,) * 4
        assert {module.board.direction(pin) for pin in range(8)} == {IN}, "at the end nothing drives"


def is_on(module: Module, pin: int) -> bool:
    return module.board.levels()[pin]


def test_component_bb_switches_the_output_that_it_is_told(tmp_path: Path) -> None:
    """T12: BB follows AA's "turn-on N", and reports what its pin 3 really is."""
    with plugged_in(tmp_path / "dev/ttyACM0") as module:

        async def scene(bench: Bench) -> None:
            for number in (3, 6, 3):
                bench.send("in", index=1, message=f"Publisher A(1) turn-on {number}")
                await bench.until(partial(is_on, module, number))
                assert sum(module.board.levels()) == 1
                await asyncio.sleep(2.5)
                assert bench.last("out")["message"] == f"Publisher B(2) gpio-3 = {int(number == 3)}"

        play("EFGH", machine_at(tmp_path), scene)
        assert sum(module.board.levels()) == 0


@pytest.mark.parametrize(("text", "bits"), [("4-7", 0xF0), ("0,2,5", 0x25), ("", 0), ("0-7", 0xFF), ("3", 8)])
def test_pins_in_words(text: str, bits: int) -> None:
    assert parse_pins(text) == bits


@pytest.mark.parametrize("text", ["8", "7-4", "a", "1-", "-"])
def test_what_names_no_pins_is_refused(text: str) -> None:
    with pytest.raises(HardwareFault, match="names no pins"):
        parse_pins(text)
