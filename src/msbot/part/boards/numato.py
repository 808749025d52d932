"""The 8-channel USB-GPIO module of Numato Lab, and a simulator that answers as it does (thesis 3.12.3).

The module speaks lines of text over a USB serial port (115200 baud, 8N1; any rate works): `gpio set 3` and a
carriage return. It echoes the command, then gives LF CR, an answer and LF CR where there is one, and the prompt `>`.
In `iodir` a 1 makes a pin an input; `iomask` names the pins that `iodir` and `writeall` may touch.
"""

from __future__ import annotations

from typing import Protocol

from msbot.errors import LinkDown, RemoteProtocolError
from msbot.part.boards.gpio import PINS, PinDirection, SimGpio, check_output, check_pin

LINE_END = b"\n\r"
"""As the module sends it, in this order."""

PROMPT = b">"
LONGEST_ANSWER = 255
"""Octets of echo, answer and prompt together, far more than the module ever sends."""

ALL_PINS = (1 << PINS) - 1


class ByteStream(Protocol):
    """Any way to and from the module: a serial port, a simulator."""

    def write(self, data: bytes) -> None:
        """Send all of the octets."""

    def read(self, timeout_s: float) -> bytes:
        """What has arrived, at least one octet; empty when nothing comes within the time-out."""


class NumatoGpio:
    """The module over a byte stream; satisfies `UsbGpio`.

    Args:
        stream: the way to the module.
        timeout_s: how long the module may be silent in the middle of an answer.

    Every verb that talks to the module raises LinkDown when it is silent and RemoteProtocolError when its answer
    makes no sense.
    """

    def __init__(self, stream: ByteStream, *, timeout_s: float = 1.0) -> None:
        """Make all pins inputs: the module cannot be asked which ones are, and inputs harm nothing."""
        self._stream = stream
        self._timeout_s = timeout_s
        self._directions = [PinDirection.INPUT] * PINS
        self._order(f"gpio iomask {ALL_PINS:02x}")
        self._order(f"gpio iodir {ALL_PINS:02x}")

    def set_direction(self, pin: int, direction: PinDirection) -> None:
        """Make one pin an input or output; the mask keeps the module from touching the others."""
        check_pin(pin)
        self._order(f"gpio iomask {1 << pin:02x}")
        self._order(f"gpio iodir {ALL_PINS if direction is PinDirection.INPUT else 0:02x}")
        self._directions[pin] = direction

    def set(self, pin: int) -> None:
        """Switch an output on; raises LocalProtocolError if the pin is an input."""
        self._check_output(pin)
        self._order(f"gpio set {pin}")

    def clear(self, pin: int) -> None:
        """Switch an output off; raises LocalProtocolError if the pin is an input."""
        self._check_output(pin)
        self._order(f"gpio clear {pin}")

    def read(self, pin: int) -> bool:
        """The level of a pin."""
        check_pin(pin)
        command = f"gpio read {pin}"
        answer = self._ask(command)
        if answer not in ("0", "1"):
            raise RemoteProtocolError(f"the GPIO module answered {answer!r} to `{command}`: 0 or 1 was expected")
        return answer == "1"

    def _check_output(self, pin: int) -> None:
        check_pin(pin)
        check_output(pin, self._directions[pin])

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
        self._mask = ALL_PINS
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
        """What the module has sent and nobody has read."""
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
            case ["gpio", ("set" | "clear") as verb, pin] if is_pin(pin):
                self._board.latch(int(pin), level=verb == "set")
                return ""
            case ["gpio", "read", pin] if is_pin(pin):
                return str(int(self._board.read(int(pin))))
            case ["gpio", "readall"]:
                return f"{sum(level << pin for pin, level in enumerate(self._board.levels())):02x}"
            case ["gpio", "iomask", octet] if is_octet(octet):
                self._mask = int(octet, 16)
                return ""
            case ["gpio", ("iodir" | "writeall") as verb, octet] if is_octet(octet):
                self._for_unmasked(verb, int(octet, 16))
                return ""
        return f"unknown command: {line}"

    def _for_unmasked(self, verb: str, bits: int) -> None:
        for pin in range(PINS):
            bit = bool(bits >> pin & 1)
            if not self._mask >> pin & 1:
                continue
            if verb == "writeall":
                self._board.latch(pin, level=bit)
            else:
                self._board.set_direction(pin, PinDirection.INPUT if bit else PinDirection.OUTPUT)


def is_pin(text: str) -> bool:
    """Whether a word of a command names a pin."""
    return len(text) == 1 and text in "01234567"


def is_octet(text: str) -> bool:
    """Whether a word of a command is two hexadecimal digits."""
    return len(text) == 2 and all(digit in "0123456789abcdefABCDEF" for digit in text)
