"""Things that are on or off: buttons, switches, contacts, and sensors with a digital output."""

from __future__ import annotations

from typing import Any

from msbot.config import Scalar
from msbot.hardware.driver import Values
from msbot.hardware.pins import PinDriver


class SwitchInput(PinDriver):
    """One input pin. Options: `pull` (up, down or none), `active_low` (on when the pin is low)."""

    samples = True

    def open(self) -> None:
        """Take the pin, and be told of each change."""
        simulator = self.place.part_type.simulator
        assert simulator is not None
        self._control = simulator.controls[0].name
        self._input = open_input(self, self.wiring.pins["s"], str(self.wiring.options["pull"]))
        self._active_low = self.wiring.flag("active_low")
        self._input.when_activated = lambda: self.place.changed(self._measured(level=True))
        self._input.when_deactivated = lambda: self.place.changed(self._measured(level=False))

    def sample(self, values: Values) -> Values:  # noqa: ARG002 - as its base
        """Whether it is on."""
        return self._measured(level=bool(self._input.value))

    def _measured(self, *, level: bool) -> dict[str, Scalar]:
        return {self._control: level != self._active_low}


def open_input(driver: PinDriver, gpio: int, pull: str) -> Any:  # noqa: ANN401 - the library has no types
    """An input whose value is the level of the pin, whichever way a resistor pulls it."""
    if pull == "up":
        # gpiozero treats a pulled-up pin as active when it is low; ours is the plain level.
        device = driver.device("DigitalInputDevice", gpio, pull_up=True)
        return _Inverted(device)
    return driver.device(
        "DigitalInputDevice",
        gpio,
        pull_up=False if pull == "down" else None,
        active_state=None if pull == "down" else True,
    )


class _Inverted:
    """A gpiozero input with its value inverted."""

    _device: Any

    def __init__(self, device: Any) -> None:  # noqa: ANN401 - the library has no types
        object.__setattr__(self, "_device", device)

    @property
    def value(self) -> bool:
        """The level of the pin."""
        return not self._device.value

    def __setattr__(self, name: str, value: object) -> None:
        other = {"when_activated": "when_deactivated", "when_deactivated": "when_activated"}
        setattr(self._device, other[name], value)


class Knob(PinDriver):
    """KY-040: a rotary encoder with clicks; both contacts and the button close to ground."""

    samples = True

    def open(self) -> None:
        """Take the pins."""
        pins = self.wiring.pins
        self._encoder = self.device("RotaryEncoder", pins["clk"], pins["dt"], max_steps=0)
        self._button = open_input(self, pins["sw"], "up")
        self._encoder.when_rotated = self._tell
        self._button.when_activated = self._button.when_deactivated = self._tell

    def sample(self, values: Values) -> Values:  # noqa: ARG002 - as its base
        """How far it was turned since it was opened, and whether it is pressed."""
        return {"clicks": int(self._encoder.steps), "press": not self._button.value}

    def _tell(self) -> None:
        self.place.changed(self.sample({}))


KEYS = ("123A", "456B", "789C", "*0#D")
"""What is printed on the 4 x 4 keypad, by row."""


class Keypad(PinDriver):
    """A keypad of 16 keys. One row at a time is driven low; the others float, so that two pressed keys do no harm."""

    samples = True
    poll_s = 0.02

    def open(self) -> None:
        """Take the pins: all are inputs, pulled up."""
        pins = self.wiring.pins
        self._rows = [self.raw_pin(pins[f"r{row}"]) for row in range(1, 5)]
        self._columns = [self.raw_pin(pins[f"c{column}"]) for column in range(1, 5)]
        for pin in (*self._rows, *self._columns):
            pin.input_with_pull("up")

    def sample(self, values: Values) -> Values:  # noqa: ARG002 - as its base
        """The pressed key; the first of several."""
        pressed = "none"
        for row, keys in zip(self._rows, KEYS, strict=True):
            row.output_with_state(0)
            try:
                low = [key for key, column in zip(keys, self._columns, strict=True) if not column.state]
            finally:
                row.input_with_pull("up")
            if low and pressed == "none":
                pressed = low[0]
        return {"finger": pressed}
