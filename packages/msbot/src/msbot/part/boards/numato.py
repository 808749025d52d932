"""The USB-GPIO modules of Numato Lab with 8, 16 or 32 channels, and a simulator that answers as they do.

Source: thesis 3.12.3, and the user guides of the three modules. A module speaks lines of text over a USB serial port
(115200 baud, 8N1; any rate works): `gpio set 3` and a carriage return. It echoes the command, then gives LF CR, an
answer and LF CR where there is one, and the prompt `>`. Pins above 9 are letters, `A` to `V`; masks have a hexadecimal
digit for four pins. In `iodir` a 1 makes a pin an input; `iomask` names the pins that `iodir` and `writeall` may touch.
"""

from __future__ import annotations

from typing import Protocol

from msbot.part.boards.gpio import PINS, PinDirection, SimGpio, check_output, check_pin
from msbot_xrce.errors import LinkDown, LocalProtocolError, RemoteProtocolError

LINE_END = b"\n\r"
"""As the module sends it, in this order."""

PROMPT = b">"
LONGEST_ANSWER = 255
"""Octets of echo, answer and prompt together, far more than the module ever sends."""

CHANNELS = {8: 6, 16: 7, 32: 7}
"""Analog inputs by number of pins (user guides, "ADC")."""
ADC_MOST = 1023
ID_CHARACTERS = 8
"""Length of the identifier that a module stores."""


class ByteStream(Protocol):
    """Any connection to the module: a serial port, a simulator."""

    def write(self, data: bytes) -> None:
        """Send all of the octets."""

    def read(self, timeout_s: float) -> bytes:
        """What has arrived, at least one octet; empty when nothing arrives within the time-out."""


class NumatoGpio:
    """The module over a byte stream; satisfies `UsbGpio`.

    Args:
        stream: the connection to the module.
        timeout_s: how long the module may be silent in the middle of an answer.
        pins: 8, 16 or 32.

    Every method that talks to the module raises LinkDown when it is silent and RemoteProtocolError when its answer
    makes no sense.
    """

    def __init__(self, stream: ByteStream, *, timeout_s: float = 1.0, pins: int = PINS) -> None:
        """Make all pins inputs: the module cannot be asked which ones are inputs, and inputs do no harm."""
        if pins not in CHANNELS:
            raise LocalProtocolError(f"there is no module with {pins} pins: it has {' or '.join(map(str, CHANNELS))}")
        self.pins = pins
        self._stream = stream
        self._timeout_s = timeout_s
        self._all = (1 << pins) - 1
        self._outputs = 0
        self.set_directions(outputs=0)

    def set_direction(self, pin: int, direction: PinDirection) -> None:
        """Make one pin an input or output; the mask keeps the module from touching the others."""
        check_pin(pin, self.pins)
        self._order(f"gpio iomask {self._hex(1 << pin)}")
        self._order(f"gpio iodir {self._hex(self._all if direction is PinDirection.INPUT else 0)}")
        if direction is PinDirection.OUTPUT:
            self._outputs |= 1 << pin
        else:
            self._outputs &= ~(1 << pin)

    def set_directions(self, *, outputs: int) -> None:
        """Make the pins whose bit is 1 outputs, and the others inputs."""
        self._order(f"gpio iomask {self._hex(self._all)}")
        self._order(f"gpio iodir {self._hex(self._all & ~outputs)}")
        self._outputs = outputs & self._all

    def set(self, pin: int) -> None:
        """Switch an output on; raises LocalProtocolError if the pin is an input."""
        self._check_output(pin)
        self._order(f"gpio set {pin_letter(pin)}")

    def clear(self, pin: int) -> None:
        """Switch an output off; raises LocalProtocolError if the pin is an input."""
        self._check_output(pin)
        self._order(f"gpio clear {pin_letter(pin)}")

    def read(self, pin: int) -> bool:
        """The level of a pin."""
        check_pin(pin, self.pins)
        command = f"gpio read {pin_letter(pin)}"
        answer = self._ask(command)
        if answer not in ("0", "1"):
            raise RemoteProtocolError(f"the GPIO module answered {answer!r} to `{command}`: 0 or 1 was expected")
        return answer == "1"

    def write_all(self, levels: int) -> None:
        """Set all outputs at once, one bit for each pin; a pin that later becomes an output takes its level, too."""
        self._order(f"gpio iomask {self._hex(self._all)}")
        self._order(f"gpio writeall {self._hex(levels & self._all)}")

    def read_all(self) -> int:
        """The levels of all pins, one bit for each."""
        answer = self._ask("gpio readall")
        if len(answer) != self.pins // 4 or not is_hexadecimal(answer):
            raise RemoteProtocolError(
                f"the GPIO module answered {answer!r} to `gpio readall`: {self.pins // 4} hexadecimal digits were "
                f"expected; has it {self.pins} channels?"
            )
        return int(answer, 16)

    def adc(self, channel: int) -> int:
        """What an analog input measures, 0 to 1023 for 0 V to the supply; its pin must be an input."""
        if not 0 <= channel < CHANNELS[self.pins]:
            raise LocalProtocolError(
                f"there is no analog input {channel}: the module has 0 to {CHANNELS[self.pins] - 1}"
            )
        command = f"adc read {channel}"
        answer = self._ask(command)
        if not answer.isdecimal() or int(answer) > ADC_MOST:
            raise RemoteProtocolError(f"the GPIO module answered {answer!r} to `{command}`: 0 to 1023 was expected")
        return int(answer)

    def version(self) -> str:
        """The version of the module's firmware."""
        return self._ask("ver")

    def id(self) -> str:
        """The eight characters that identify the module."""
        return self._ask("id get")

    def set_id(self, text: str) -> None:
        """Have the module store eight letters or digits for good; raises LocalProtocolError for anything else."""
        if len(text) != ID_CHARACTERS or not (text.isascii() and text.isalnum()):
            raise LocalProtocolError(f"the id {text!r} must be {ID_CHARACTERS} letters or digits")
        self._order(f"id set {text}")

    def _hex(self, bits: int) -> str:
        return f"{bits:0{self.pins // 4}x}"

    def _check_output(self, pin: int) -> None:
        check_pin(pin, self.pins)
        is_output = self._outputs >> pin & 1
        check_output(pin, PinDirection.OUTPUT if is_output else PinDirection.INPUT)

    def _order(self, command: str) -> None:
        if answer := self._ask(command):
            raise RemoteProtocolError(f"the GPIO module answered {answer!r} to `{command}`: no answer was expected")

    def _ask(self, command: str) -> str:
        self._forget_late_answers()
        self._stream.write(f"{command}\r".encode())
        received = b""
        while not received.endswith(PROMPT):
            piece = self._stream.read(self._timeout_s)
            if not piece:
                raise LinkDown(_silence(command, received, self._timeout_s))
            received += piece
            if len(received) > LONGEST_ANSWER:
                raise RemoteProtocolError(f"the GPIO module's answer to `{command}` has no end: {received[:40]!r}...")
        return parse_answer(command, received)

    def _forget_late_answers(self) -> None:
        for _ in range(LONGEST_ANSWER):
            if not self._stream.read(0.0):
                return
        raise RemoteProtocolError("the GPIO module does not stop sending: is it another device?")


def parse_answer(command: str, received: bytes) -> str:
    """The text between the echo of a command and the prompt, empty if there is none.

    Raises:
        RemoteProtocolError: the octets are not an answer to that command.
    """
    try:
        text = received.decode("ascii")
    except UnicodeDecodeError:
        raise RemoteProtocolError(f"the GPIO module answered {received!r} to `{command}`: no text") from None
    echo, *lines = text.removesuffix(">").replace("\r", "\n").split("\n")
    if echo.strip() != command or not text.endswith(">"):
        raise RemoteProtocolError(f"the GPIO module answered {text!r} to `{command}`: its echo was expected")
    return " ".join(line.strip() for line in lines if line.strip())


def _silence(command: str, received: bytes, timeout_s: float) -> str:
    got = f"only {received!r}" if received else "nothing"
    return (
        f"the GPIO module gave {got} within {timeout_s:g} s after `{command}`: check that it is plugged in, that the "
        "port is the right one and that no other program uses it"
    )


class NumatoSimulator:
    """Answers like the module, on a simulated board; satisfies `ByteStream`. Reading from it never waits."""

    def __init__(self, board: SimGpio) -> None:
        self._board = board
        self._pins = board.pins
        self._mask = (1 << board.pins) - 1
        self.analog = [0] * CHANNELS[board.pins]
        """What the analog inputs measure, 0 to 1023."""
        self._id = "00000000"
        self._line = bytearray()
        self._output = bytearray()

    def write(self, data: bytes) -> None:
        """Take octets from the computer; each carriage return runs a command."""
        for octet in data:
            if octet == ord("\r"):
                line, self._line = self._line.decode("ascii", "replace"), bytearray()
                self._answer(self._run(line))
            elif len(self._line) < LONGEST_ANSWER:
                self._line.append(octet)
                self._output.append(octet)

    def read(self, timeout_s: float) -> bytes:  # noqa: ARG002 - the answer is there at once or never
        """What the module has sent and nobody has read yet."""
        output, self._output = bytes(self._output), bytearray()
        return output

    def _answer(self, text: str) -> None:
        self._output += LINE_END
        if text:
            self._output += text.encode() + LINE_END
        self._output += PROMPT

    def _run(self, line: str) -> str:
        match line.split():
            case []:
                return ""
            case ["ver"]:
                return "00000008"
            case ["id", "get"]:
                return self._id
            case ["id", "set", text] if len(text) == ID_CHARACTERS:
                self._id = text
                return ""
            case ["adc", "read", channel] if channel.isdecimal() and int(channel) < len(self.analog):
                return str(self.analog[int(channel)])
            case ["gpio", ("set" | "clear") as verb, letter] if (pin := pin_of(letter)) < self._pins:
                self._board.latch(pin, level=verb == "set")
                return ""
            case ["gpio", "read", letter] if (pin := pin_of(letter)) < self._pins:
                return str(int(self._board.read(pin)))
            case ["gpio", "readall"]:
                return f"{sum(level << pin for pin, level in enumerate(self._board.levels())):0{self._pins // 4}x}"
            case ["gpio", "iomask", mask] if self._is_mask(mask):
                self._mask = int(mask, 16)
                return ""
            case ["gpio", ("iodir" | "writeall") as verb, mask] if self._is_mask(mask):
                self._for_unmasked(verb, int(mask, 16))
                return ""
        return f"unknown command: {line}"

    def _is_mask(self, text: str) -> bool:
        return len(text) == self._pins // 4 and is_hexadecimal(text)

    def _for_unmasked(self, verb: str, bits: int) -> None:
        for pin in range(self._pins):
            bit = bool(bits >> pin & 1)
            if not self._mask >> pin & 1:
                continue
            if verb == "writeall":
                self._board.latch(pin, level=bit)
            else:
                self._board.set_direction(pin, PinDirection.INPUT if bit else PinDirection.OUTPUT)


def pin_letter(pin: int) -> str:
    """How the module names a pin: a digit, or a letter from 10 on."""
    return str(pin) if pin < 10 else chr(ord("A") + pin - 10)


def pin_of(letter: str) -> int:
    """The pin that a word of a command names; one that no module has when it names none."""
    if len(letter) == 1 and letter in "0123456789":
        return int(letter)
    return ord(letter) - ord("A") + 10 if len(letter) == 1 and "A" <= letter <= "V" else max(CHANNELS)


def is_hexadecimal(text: str) -> bool:
    """Whether a word has hexadecimal digits only."""
    return bool(text) and all(digit in "0123456789abcdefABCDEF" for digit in text)
