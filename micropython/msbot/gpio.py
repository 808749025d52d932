"""A simulated GPIO board with eight pins, as on a PC (docs/reference/boards.md)."""

from .errors import LocalProtocolError
from .membership import State


class PinDirection:
    """Which side decides the level of a pin."""

    INPUT = State("input")
    OUTPUT = State("output")


class SimGpio:
    """Eight pins, all inputs at first; each has a latch, and while it is an input it is driven from outside."""

    def __init__(self):
        self._outputs = [False] * 8
        self._latches = [False] * 8
        self._outside = [False] * 8
        self._listeners = []

    def set_direction(self, pin, direction):
        """Make one pin an input or output."""
        self._change(self._outputs, pin, direction is PinDirection.OUTPUT)

    def set(self, pin):
        """Switch an output on."""
        self._switch(pin, True)

    def clear(self, pin):
        """Switch an output off."""
        self._switch(pin, False)

    def read(self, pin):
        """The level of a pin."""
        if not 0 <= pin < 8:
            raise LocalProtocolError("there is no pin {}: the board has pins 0 to 7".format(pin))
        return (self._latches if self._outputs[pin] else self._outside)[pin]

    def drive(self, pin, *, level):
        """Apply a level to a pin from outside, as a switch does."""
        self._change(self._outside, pin, level)

    def on_change(self, listener):
        """Call the listener with pin and level after every change."""
        self._listeners.append(listener)

    def _switch(self, pin, level):
        self.read(pin)
        if not self._outputs[pin]:
            words = "pin {} is an input: call set_direction({}, PinDirection.OUTPUT) first"
            raise LocalProtocolError(words.format(pin, pin))
        self._change(self._latches, pin, level)

    def _change(self, levels, pin, level):
        before = self.read(pin)
        levels[pin] = level
        after = self.read(pin)
        if after != before:
            for listener in self._listeners:
                listener(pin, after)
