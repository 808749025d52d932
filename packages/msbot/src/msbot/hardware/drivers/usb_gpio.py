"""The USB module of Numato Lab as parts: the module itself (NUMATO-8), and the thesis' component BB (EFGH)."""

from __future__ import annotations

from msbot.config import Scalar
from msbot.hardware.driver import Driver, Values
from msbot.hardware.hardware_fault import HardwareFault
from msbot.hardware.serial_stream import SerialStream
from msbot.part import NumatoGpio
from msbot_xrce.errors import LinkDown, RemoteProtocolError

BAUDRATE = 115_200
PINS = 8


class UsbGpio8(Driver):
    """Eight pins. Option: `outputs`, the pins that are outputs, for example `4-7` or `0,2,5`; the others are inputs."""

    samples = True
    drives = True
    poll_s = 0.05

    def open(self) -> None:
        """Open the port; outputs are set to off before they become outputs."""
        self._stream: SerialStream | None = None
        self._gpio: NumatoGpio | None = None
        self._stream = SerialStream(str(self.machine.path(self.wiring.device)), BAUDRATE, "the USB module")
        self._outputs = self.output_pins()
        try:
            gpio = NumatoGpio(self._stream)
            gpio.write_all(0)
            gpio.set_directions(outputs=self._outputs)
        except (LinkDown, RemoteProtocolError) as error:
            raise HardwareFault(str(error)) from None
        self._gpio = gpio
        self._levels = 0

    def close(self) -> None:
        """Switch all outputs off, and make all pins inputs."""
        gpio, self._gpio = getattr(self, "_gpio", None), None
        stream, self._stream = getattr(self, "_stream", None), None
        try:
            if gpio is not None:
                gpio.write_all(0)
                gpio.set_directions(outputs=0)
        except (LinkDown, RemoteProtocolError):
            pass  # it was unplugged, so it has no power any more
        finally:
            if stream is not None:
                stream.close()

    def output_pins(self) -> int:
        """One bit for each pin that is an output."""
        return parse_pins(str(self.wiring.options["outputs"]))

    def sample(self, values: Values) -> Values:  # noqa: ARG002 - as its base
        """The levels of all pins."""
        levels = self._levels_now()
        return {f"pin_{pin}": bool(levels >> pin & 1) for pin in range(PINS)}

    def outputs_for(self, values: Values) -> object:
        """One bit for each output that is on."""
        return sum(bool(values[f"output_{pin}"]) << pin for pin in range(PINS))

    def drive(self, wanted: object) -> None:
        """Switch all outputs at once."""
        assert isinstance(wanted, int)
        assert self._gpio is not None
        try:
            self._gpio.write_all(wanted & self._outputs)
        except (LinkDown, RemoteProtocolError) as error:
            raise HardwareFault(str(error)) from None

    def _levels_now(self) -> int:
        assert self._gpio is not None
        try:
            return self._gpio.read_all()
        except (LinkDown, RemoteProtocolError) as error:
            raise HardwareFault(str(error)) from None


class ThesisSwitch(UsbGpio8):
    """Component BB: all pins are outputs; the last digit of a message says which one is on; the part reports pin 3."""

    def output_pins(self) -> int:
        """All of them."""
        return (1 << PINS) - 1

    def sample(self, values: Values) -> Values:  # noqa: ARG002 - as its base
        """Whether pin 3 is really on."""
        measured: dict[str, Scalar] = {"gpio_3": bool(self._levels_now() >> 3 & 1)}
        return measured

    def outputs_for(self, values: Values) -> object:
        """One bit, or none before the first message."""
        text = str(values["output"])
        return 1 << int(text) if text.isdecimal() and int(text) < PINS else 0


def parse_pins(text: str) -> int:
    """One bit for each pin in a text such as `4-7` or `0,2,5`; empty: none.

    Raises:
        HardwareFault: it is something else.
    """
    bits = 0
    for piece in filter(None, (piece.strip() for piece in text.split(","))):
        first, dash, last = piece.partition("-")
        try:
            low, high = int(first), int(last if dash else first)
        except ValueError:
            low, high = 1, 0
        if not 0 <= low <= high < PINS:
            raise HardwareFault(f"option outputs: {text!r} names no pins; write for example 4-7, or 0,2,5")
        for pin in range(low, high + 1):
            bits |= 1 << pin
    return bits
