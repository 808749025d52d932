"""Ultrasonic distance and wheel pulses: edges on a pin, with the time at which the kernel saw them."""

from __future__ import annotations

import threading

from msbot.hardware.driver import Values
from msbot.hardware.hardware_fault import HardwareFault
from msbot.hardware.pins import PinDriver, gpiozero

TRIGGER_S = 10e-6
"""HC-SR04 data sheet: a high level of at least 10 us starts a measurement."""
ECHO_STARTS_S = 0.06
"""How long to wait for the echo pin to rise: the bursts take 0.2 ms, a busy computer takes longer."""
ECHO_ENDS_S = 0.06
"""The echo pin falls after 38 ms at the latest when nothing was heard (data sheet), plus time for the computer."""
FAR_M = 10.0
"""What the model treats as too far away."""
NO_ECHO_S = 0.036
"""A longer pulse is no echo: the sensor has given up."""


class HcSr04(PinDriver):
    """Measures how long the echo pin is high. Option: `sound_m_s`, the speed of sound in m/s."""

    samples = True
    blocking = True

    def open(self) -> None:
        """Take the pins."""
        self._trigger = self.raw_pin(self.wiring.pins["trigger"])
        self._echo = self.raw_pin(self.wiring.pins["echo"])
        self._factory = gpiozero().Device.pin_factory
        self._trigger.output_with_state(0)
        self._echo.input_with_pull("floating")
        self._echo.bounce = None
        self._rose = threading.Event()
        self._fell = threading.Event()
        self._rose_at = self._fell_at = 0
        self._echo.edges = "both"
        self._echo.when_changed = self._edge

    def sample(self, values: Values) -> Values:  # noqa: ARG002 - as its base
        """The distance; FAR_M when nothing reflects.

        Raises:
            HardwareFault: the echo pin does not move.
        """
        self._rose.clear()
        self._fell.clear()
        self._trigger.state = 1
        self.machine.wait(TRIGGER_S)
        self._trigger.state = 0
        where = f"GPIO {self.wiring.pins['trigger']} (trigger) and GPIO {self.wiring.pins['echo']} (echo)"
        if not self._rose.wait(ECHO_STARTS_S):
            raise HardwareFault(f"the HC-SR04 at {where} does not answer: check its 5 V, ground, and both wires")
        if not self._fell.wait(ECHO_ENDS_S):
            raise HardwareFault(f"the echo pin of the HC-SR04 at {where} stays high: check its 5 V and the divider")
        echo_s = float(self._factory.ticks_diff(self._fell_at, self._rose_at))
        if echo_s >= NO_ECHO_S:
            return {"obstacle": FAR_M}
        return {"obstacle": echo_s * self.wiring.number("sound_m_s") / 2}

    def _edge(self, ticks: int, state: int) -> None:
        if state:
            self._rose_at = ticks
            self._rose.set()
        else:
            self._fell_at = ticks
            self._fell.set()


class WheelEncoder(PinDriver):
    """LM393-SPEED: a light barrier at a slotted disc. One sensor cannot tell the direction: the count only goes up."""

    samples = True

    def open(self) -> None:
        """Take the pin."""
        self._input = self.device("DigitalInputDevice", self.wiring.pins["s"], pull_up=None, active_state=True)
        self._pulses = 0
        self._seen = 0
        self._seen_at = self.machine.clock()
        self._input.when_activated = self._count

    def sample(self, values: Values) -> Values:
        """Pulses since it was opened, and turns per minute since the last call."""
        pulses, now = self._pulses, self.machine.clock()
        passed_s = now - self._seen_at
        turns = (pulses - self._seen) / float(values["pulses_per_turn"])
        self._seen, self._seen_at = pulses, now
        measured: dict[str, float | int] = {"pulses": -pulses if values["invert"] else pulses}
        if passed_s > 0:
            measured["wheel"] = turns * 60 / passed_s
        return measured

    def _count(self) -> None:
        self._pulses += 1
