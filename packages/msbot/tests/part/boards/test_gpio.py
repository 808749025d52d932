from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot.part.boards.gpio import PINS, PinDirection, SimGpio
from msbot_xrce.errors import LocalProtocolError


def outputs() -> SimGpio:
    board = SimGpio()
    for pin in range(PINS):
        board.set_direction(pin, PinDirection.OUTPUT)
    return board


@pytest.mark.parametrize("pin", range(PINS))
def test_each_output_is_switched_alone(pin: int) -> None:
    board = outputs()
    board.set(pin)
    assert board.levels() == tuple(other == pin for other in range(PINS))
    assert board.read(pin)
    board.clear(pin)
    assert board.levels() == (False,) * PINS


@pytest.mark.parametrize("pin", range(PINS))
def test_the_direction_of_one_pin_touches_no_other(pin: int) -> None:
    board = SimGpio()
    board.set_direction(pin, PinDirection.OUTPUT)
    for other in range(PINS):
        assert (board.direction(other) is PinDirection.OUTPUT) == (other == pin)


def test_an_input_shows_what_drives_it_and_an_output_what_it_was_told() -> None:
    board = SimGpio()
    board.drive(3, level=True)
    assert board.read(3)
    board.set_direction(3, PinDirection.OUTPUT)
    assert not board.read(3)
    board.set(3)
    board.drive(3, level=False)
    assert board.read(3)
    board.set_direction(3, PinDirection.INPUT)
    assert not board.read(3)


def test_switching_an_input_says_what_to_do() -> None:
    board = SimGpio()
    for switch in (board.set, board.clear):
        with pytest.raises(
            LocalProtocolError, match=r"pin 2 is an input: call set_direction\(2, PinDirection.OUTPUT\)"
        ):
            switch(2)


@pytest.mark.parametrize("pin", [-1, PINS])
def test_a_pin_that_is_not_there_is_refused(pin: int) -> None:
    board = SimGpio()
    for refused in (
        lambda: board.set(pin),
        lambda: board.clear(pin),
        lambda: board.read(pin),
        lambda: board.direction(pin),
        lambda: board.set_direction(pin, PinDirection.INPUT),
        lambda: board.drive(pin, level=True),
        lambda: board.latch(pin, level=True),
    ):
        with pytest.raises(LocalProtocolError, match=f"there is no pin {pin}: the board has pins 0 to 7"):
            refused()


def test_listeners_hear_changes_only() -> None:
    board = outputs()
    heard: list[tuple[int, bool]] = []
    board.on_change(lambda pin, level: heard.append((pin, level)))
    board.set(1)
    board.set(1)
    board.clear(1)
    board.drive(2, level=True)
    board.set_direction(2, PinDirection.INPUT)
    assert heard == [(1, True), (1, False), (2, True)]


actions = st.lists(
    st.tuples(st.sampled_from(["input", "output", "latch", "drive"]), st.integers(0, 7), st.booleans()), max_size=40
)


@given(actions)
def test_what_listeners_hear_adds_up_to_the_levels(script: list[tuple[str, int, bool]]) -> None:
    board = SimGpio()
    heard = [False] * PINS

    def listen(pin: int, level: bool) -> None:
        assert heard[pin] != level
        heard[pin] = level

    board.on_change(listen)
    for verb, pin, level in script:
        match verb:
            case "latch":
                board.latch(pin, level=level)
            case "drive":
                board.drive(pin, level=level)
            case _:
                board.set_direction(pin, PinDirection(verb))
        assert tuple(heard) == board.levels()
