"""GPIO boards: what a part's functions drive, and a simulated one with eight pins.

The simulated board has the same methods as a real one, so programs and tests can use either.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from typing import Protocol

from msbot_xrce.errors import LocalProtocolError

PINS = 8
"""Pins of the thesis' USB-GPIO module (thesis 3.12.3), numbered from 0."""

PinListener = Callable[[int, bool], None]
"""`(pin, level)`, called after each change."""


class PinDirection(Enum):
    """Which side decides the level of a pin."""

    INPUT = "input"
    """The outside world does; the part reads."""
    OUTPUT = "output"
    """The part does; it drives the pin."""


class UsbGpio(Protocol):
    """A board with eight pins, all inputs at first. Every method raises LocalProtocolError for a pin it does not have.

    A real board raises LinkDown when it does not answer and RemoteProtocolError when its answer makes no sense.
    """

    def set_direction(self, pin: int, direction: PinDirection) -> None:
        """Make one pin an input or output; the others stay as they are."""

    def set(self, pin: int) -> None:
        """Switch an output on; raises LocalProtocolError if the pin is an input."""

    def clear(self, pin: int) -> None:
        """Switch an output off; raises LocalProtocolError if the pin is an input."""

    def read(self, pin: int) -> bool:
        """The level of a pin: the level applied to an input, or the last level set on an output."""


class SimGpio:
    """Simulated pins, eight unless told otherwise; satisfies `UsbGpio`.

    Each pin has a latch (the level set by the part) and an outside level that counts while the pin is an input. Both
    are low at first, and each is kept while the other one counts.
    """

    def __init__(self, pins: int = PINS) -> None:
        self.pins = pins
        self._directions = [PinDirection.INPUT] * pins
        self._latches = [False] * pins
        self._outside = [False] * pins
        self._listeners: list[PinListener] = []

    def set_direction(self, pin: int, direction: PinDirection) -> None:
        """Make one pin an input or output; the others stay as they are."""
        before = self.read(pin)
        self._directions[pin] = direction
        self._report(pin, before)

    def set(self, pin: int) -> None:
        """Switch an output on; raises LocalProtocolError if the pin is an input."""
        check_output(pin, self.direction(pin))
        self.latch(pin, level=True)

    def clear(self, pin: int) -> None:
        """Switch an output off; raises LocalProtocolError if the pin is an input."""
        check_output(pin, self.direction(pin))
        self.latch(pin, level=False)

    def read(self, pin: int) -> bool:
        """The level of a pin: the level driving an input, or the last level set on an output."""
        check_pin(pin, self.pins)
        return (self._latches if self._directions[pin] is PinDirection.OUTPUT else self._outside)[pin]

    def direction(self, pin: int) -> PinDirection:
        """Whether a pin is an input or output."""
        check_pin(pin, self.pins)
        return self._directions[pin]

    def levels(self) -> tuple[bool, ...]:
        """The levels of all pins, from pin 0."""
        return tuple(self.read(pin) for pin in range(self.pins))

    def latch(self, pin: int, *, level: bool) -> None:
        """Set the level that a pin has as an output; an input keeps it for later."""
        before = self.read(pin)
        self._latches[pin] = level
        self._report(pin, before)

    def drive(self, pin: int, *, level: bool) -> None:
        """Apply a level to a pin from outside, as a switch or sensor does; has no effect on an output."""
        before = self.read(pin)
        self._outside[pin] = level
        self._report(pin, before)

    def on_change(self, listener: PinListener) -> None:
        """Call the listener after every change of a pin's level."""
        self._listeners.append(listener)

    def _report(self, pin: int, before: bool) -> None:
        after = self.read(pin)
        if after != before:
            for listener in self._listeners:
                listener(pin, after)


def check_pin(pin: int, pins: int = PINS) -> None:
    """Refuse a pin that a board with this many pins does not have.

    Raises:
        LocalProtocolError: there is no such pin.
    """
    if not 0 <= pin < pins:
        raise LocalProtocolError(f"there is no pin {pin}: the board has pins 0 to {pins - 1}")


def check_output(pin: int, direction: PinDirection) -> None:
    """Refuse to switch an input.

    Raises:
        LocalProtocolError: the pin is an input.
    """
    if direction is not PinDirection.OUTPUT:
        raise LocalProtocolError(f"pin {pin} is an input: call set_direction({pin}, PinDirection.OUTPUT) first")
