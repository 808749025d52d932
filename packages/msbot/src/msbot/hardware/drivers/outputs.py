"""Things that are switched or dimmed: lamps, relays, fans, buzzers, the button of a camera."""

from __future__ import annotations

from msbot.config import Scalar
from msbot.hardware.driver import Values
from msbot.hardware.pins import PinDriver


class DimmedOutput(PinDriver):
    """One output with PWM. Options: `active_low`, `frequency_hz`. A source gives its power in percent."""

    drives = True
    source = "brightness_now"

    def open(self) -> None:
        """Take the pin; it is off."""
        options = self.wiring
        self._output = self.device(
            "PWMOutputDevice",
            options.pins["s"],
            active_high=not options.flag("active_low"),
            initial_value=0,
            frequency=options.number("frequency_hz"),
        )

    def outputs_for(self, values: Values) -> object:
        """Share of full power, 0 to 1."""
        return share(values[self.source])

    def drive(self, wanted: object) -> None:
        """Set the duty cycle."""
        self._output.value = wanted


class Fan(DimmedOutput):
    """A fan; below `start_at` it does not turn."""

    source = "wanted"


class Relay(PinDriver):
    """One output without PWM. Option: `active_low`, which most relay boards with an optocoupler need."""

    drives = True
    source = "coil"

    def open(self) -> None:
        """Take the pin; it is off."""
        active_high = not self.wiring.flag("active_low")
        self._output = self.device(
            "DigitalOutputDevice", self.wiring.pins["s"], active_high=active_high, initial_value=False
        )

    def outputs_for(self, values: Values) -> object:
        """Whether it is on."""
        return bool(values[self.source])

    def drive(self, wanted: object) -> None:
        """Switch."""
        self._output.value = wanted


class CameraTrigger(Relay):
    """Presses the button of a camera through a transistor or optocoupler; counts the presses."""

    source = "shutter"
    samples = True
    poll_s = 0.05

    def open(self) -> None:
        """Take the pin; nothing is pressed."""
        super().open()
        self._taken = 0

    def drive(self, wanted: object) -> None:
        """Press or release."""
        if wanted and not self._output.value:
            self._taken += 1
        super().drive(wanted)

    def sample(self, values: Values) -> Values:  # noqa: ARG002 - as its base
        """How often the button was pressed."""
        return {"pictures": self._taken}


class ColourLamp(PinDriver):
    """A lamp with three pins for red, green and blue. Options: `common_anode`, `frequency_hz`."""

    drives = True

    def open(self) -> None:
        """Take the pins; it is dark."""
        pins = self.wiring.pins
        self._lamp = self.device(
            "RGBLED",
            pins["red"],
            pins["green"],
            pins["blue"],
            active_high=not self.wiring.flag("common_anode"),
            initial_value=(0, 0, 0),
        )

    def outputs_for(self, values: Values) -> object:
        """Three shares, 0 to 1."""
        return tuple(round(share(values[name], 255), 4) for name in ("red", "green", "blue"))

    def drive(self, wanted: object) -> None:
        """Set the three duty cycles."""
        self._lamp.value = wanted


class Buzzer(PinDriver):
    """A loudspeaker or a passive buzzer: driven by a square wave, whose duty cycle sets the loudness."""

    drives = True

    def open(self) -> None:
        """Take the pin; it is silent."""
        self._output = self.device("PWMOutputDevice", self.wiring.pins["s"], initial_value=0, frequency=440)

    def outputs_for(self, values: Values) -> object:
        """Frequency and duty cycle; 50 % is loudest."""
        hertz = float(values["hertz"])
        if hertz < LOWEST_HZ:
            return 0.0, 0.0
        return min(hertz, self.wiring.number("highest_hz")), share(values["loudness"]) / 2

    def drive(self, wanted: object) -> None:
        """Play, or be silent."""
        assert isinstance(wanted, tuple)
        hertz, duty = wanted
        if duty:
            self._output.frequency = hertz
        self._output.value = duty


LOWEST_HZ = 1.0
"""Nobody can hear a lower frequency, and PWM cannot make one."""


def share(value: Scalar, most: float = 100.0) -> float:
    """A value as a share of the maximum, 0 to 1."""
    return min(1.0, max(0.0, float(value) / most))
