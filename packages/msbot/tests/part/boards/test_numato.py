from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot.part.boards.gpio import PINS, PinDirection, SimGpio, UsbGpio
from msbot.part.boards.numato import NumatoGpio, NumatoSimulator, parse_answer
from msbot_xrce.errors import LinkDown, LocalProtocolError, RemoteProtocolError


class Trickle:
    """A stream that gives the simulator's answers octet by octet and remembers what was sent."""

    def __init__(self, simulator: NumatoSimulator) -> None:
        self.simulator = simulator
        self.waiting = b""
        self.sent: list[bytes] = []

    def write(self, data: bytes) -> None:
        self.sent.append(data)
        self.simulator.write(data)

    def read(self, timeout_s: float) -> bytes:
        self.waiting += self.simulator.read(timeout_s)
        piece, self.waiting = self.waiting[:1], self.waiting[1:]
        return piece


class Scripted:
    """A stream that answers every command the same way."""

    def __init__(self, *pieces: bytes) -> None:
        self.pieces = pieces
        self.waiting: list[bytes] = []

    def write(self, data: bytes) -> None:
        self.waiting = list(self.pieces)

    def read(self, timeout_s: float) -> bytes:
        return self.waiting.pop(0) if self.waiting else b""


@pytest.fixture
def board() -> SimGpio:
    return SimGpio()


@pytest.fixture
def gpio(board: SimGpio) -> UsbGpio:
    return NumatoGpio(Trickle(NumatoSimulator(board)))


@pytest.mark.parametrize("pin", range(PINS))
def test_each_pin_is_set_read_and_cleared(board: SimGpio, gpio: UsbGpio, pin: int) -> None:
    gpio.set_direction(pin, PinDirection.OUTPUT)
    gpio.set(pin)
    assert gpio.read(pin)
    assert board.levels() == tuple(other == pin for other in range(PINS))
    gpio.clear(pin)
    assert not gpio.read(pin)
    assert board.levels() == (False,) * PINS


@pytest.mark.parametrize("pin", range(PINS))
def test_an_input_shows_what_is_applied(board: SimGpio, gpio: UsbGpio, pin: int) -> None:
    board.drive(pin, level=True)
    assert gpio.read(pin)


@pytest.mark.parametrize("pin", range(PINS))
@pytest.mark.parametrize("direction", list(PinDirection))
def test_the_direction_of_one_pin_touches_no_other(
    board: SimGpio, gpio: UsbGpio, pin: int, direction: PinDirection
) -> None:
    for other in range(PINS):
        gpio.set_direction(other, list(PinDirection)[other % 2])
    before = [board.direction(other) for other in range(PINS)]
    gpio.set_direction(pin, direction)
    before[pin] = direction
    assert [board.direction(other) for other in range(PINS)] == before


def test_all_pins_are_inputs_at_first(board: SimGpio) -> None:
    board.set_direction(4, PinDirection.OUTPUT)
    stream = Trickle(NumatoSimulator(board))
    gpio = NumatoGpio(stream)
    assert board.direction(4) is PinDirection.INPUT
    assert stream.sent == [b"gpio iomask ff\r", b"gpio iodir ff\r"]
    for switch in (gpio.set, gpio.clear):
        with pytest.raises(LocalProtocolError, match="pin 4 is an input"):
            switch(4)


def test_a_pin_that_is_not_there_is_refused_without_asking_the_module(gpio: UsbGpio) -> None:
    for refused in (gpio.set, gpio.clear, gpio.read, lambda pin: gpio.set_direction(pin, PinDirection.OUTPUT)):
        with pytest.raises(LocalProtocolError, match="there is no pin 8"):
            refused(8)


def test_a_silent_module_is_reported_with_what_to_check() -> None:
    with pytest.raises(
        LinkDown, match=r"gave nothing within 0.5 s after `gpio iomask ff`: check that it is plugged in"
    ):
        NumatoGpio(Scripted(), timeout_s=0.5)
    with pytest.raises(LinkDown, match=r"gave only b'gpio' within 1 s"):
        NumatoGpio(Scripted(b"gpio"))


@pytest.mark.parametrize(
    ("pieces", "words"),
    [
        ([b"gpio iomask ff\n\rwhat?\n\r>"], "answered 'what\\?' to `gpio iomask ff`: no answer was expected"),
        ([b"AT\n\rOK\n\r>"], "its echo was expected"),
        ([b"\xff\xfe>"], "no text"),
        ([b"x" * 200, b"x" * 200], "has no end: b'x"),
    ],
)
def test_an_answer_of_something_else_is_reported(pieces: list[bytes], words: str) -> None:
    with pytest.raises(RemoteProtocolError, match=words):
        NumatoGpio(Scripted(*pieces))


def test_a_level_is_0_or_1(board: SimGpio, gpio: UsbGpio, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(board, "read", lambda pin: 7)
    with pytest.raises(RemoteProtocolError, match="answered '7' to `gpio read 0`: 0 or 1 was expected"):
        gpio.read(0)


def test_late_answers_are_forgotten_before_the_next_command(board: SimGpio) -> None:
    stream = Trickle(NumatoSimulator(board))
    gpio = NumatoGpio(stream)
    stream.waiting = b"gpio read 1\n\r1\n\r>"
    assert gpio.read(2) is False


def test_a_device_that_never_stops_is_reported() -> None:
    class Noise:
        def write(self, data: bytes) -> None:
            raise AssertionError("nothing may be sent into the noise")

        def read(self, timeout_s: float) -> bytes:
            return b"."

    with pytest.raises(RemoteProtocolError, match="does not stop sending"):
        NumatoGpio(Noise())


@pytest.mark.parametrize(
    ("command", "octets", "answer"),
    [
        ("gpio read 3", b"gpio read 3\n\r1\n\r>", "1"),
        ("gpio set 3", b"gpio set 3\n\r>", ""),
        ("ver", b"ver\r\n00000008\r\n>", "00000008"),
    ],
)
def test_answers_stand_between_echo_and_prompt(command: str, octets: bytes, answer: str) -> None:
    assert parse_answer(command, octets) == answer


def test_the_value_stands_where_the_original_program_looks_for_it(board: SimGpio) -> None:
    simulator = NumatoSimulator(board)
    board.drive(3, level=True)
    simulator.write(b"gpio read 3\r")
    assert simulator.read(0.0)[13:14] == b"1"


def test_the_simulator_knows_the_commands_of_the_module(board: SimGpio) -> None:
    simulator = NumatoSimulator(board)

    def ask(command: str) -> str:
        simulator.write(f"{command}\r".encode())
        return parse_answer(command, simulator.read(0.0))

    assert ask("") == ""
    assert ask("ver") == "00000008"
    assert ask("gpio iodir 0F") == ""
    assert ask("gpio iomask c0") == ""
    assert ask("gpio writeall ff") == ""
    assert ask("gpio readall") == "c0"
    assert ask("gpio clear 7") == ""
    assert ask("gpio readall") == "40"
    for wrong in ("gpio", "gpio set 8", "gpio set 10", "gpio iodir f", "gpio iomask xx", "gpio read x"):
        assert ask(wrong) == f"unknown command: {wrong}"


@given(st.lists(st.binary(max_size=400), max_size=5))
def test_the_simulator_survives_any_octets(pieces: list[bytes]) -> None:
    board = SimGpio()
    simulator = NumatoSimulator(board)
    for piece in pieces:
        simulator.write(piece)
    simulator.write(b"\r")
    simulator.read(0.0)
    assert NumatoGpio(simulator).read(0) == board.read(0)


@given(st.lists(st.tuples(st.integers(0, 7), st.sampled_from(["set", "clear", "in", "out"])), max_size=30))
def test_a_module_and_a_simulated_board_do_the_same(script: list[tuple[int, str]]) -> None:
    plain, behind = SimGpio(), SimGpio()
    boards: list[UsbGpio] = [plain, NumatoGpio(NumatoSimulator(behind))]
    for pin, verb in script:
        refused = []
        for board in boards:
            try:
                match verb:
                    case "set":
                        board.set(pin)
                    case "clear":
                        board.clear(pin)
                    case _:
                        board.set_direction(pin, PinDirection.INPUT if verb == "in" else PinDirection.OUTPUT)
            except LocalProtocolError as error:
                refused.append(str(error))
        assert len(refused) != 1
        assert plain.levels() == behind.levels()
