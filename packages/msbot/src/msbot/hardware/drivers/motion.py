"""Things that move: servos, grippers, motors, the small stepper motor."""

from __future__ import annotations

import threading
import time

from msbot.hardware.driver import Values
from msbot.hardware.drivers.outputs import share
from msbot.hardware.pins import PinDriver

FRAME_S = 0.02
"""Servos want a pulse every 20 ms (SG90 data sheet: 50 Hz)."""


class Servo(PinDriver):
    """A hobby servo: the width of a pulse sets the position. Options: `min_pulse_ms` (0 degrees), `max_pulse_ms` (180).

    It gets no pulse before the first value, and none when the driver is closed: then it is limp.
    """

    drives = True

    def open(self) -> None:
        """Take the pin; there are no pulses yet."""
        self._output = self.device("PWMOutputDevice", self.wiring.pins["pwm"], initial_value=0, frequency=1 / FRAME_S)

    def outputs_for(self, values: Values) -> object:
        """The width of the pulse in ms."""
        return self.pulse_ms(float(values["arm"]) / 180)

    def drive(self, wanted: object) -> None:
        """Set the width of the pulse."""
        assert isinstance(wanted, float)
        self._output.value = wanted / 1000 / FRAME_S

    def pulse_ms(self, part: float) -> float:
        """The width of the pulse for a share of the full travel, 0 to 1."""
        least, most = self.wiring.number("min_pulse_ms"), self.wiring.number("max_pulse_ms")
        return round(least + min(1.0, max(0.0, part)) * (most - least), 4)


class Gripper(Servo):
    """A gripper moved by a servo. It has no sensor that feels whether it holds something."""

    unknown_ports = ("holding",)

    def outputs_for(self, values: Values) -> object:
        """The width of the pulse in ms: the shortest closes."""
        return self.pulse_ms(float(values["opening"]) / (float(values["width"]) or 1.0))


class TwoMotors(PinDriver):
    """An H-bridge for two motors (L298N, TB6612FNG): two pins set the direction, PWM the power, a third one enables it.

    According to both data sheets, one input high and the other low turns the motor; both low, or enable low, stops it.
    """

    drives = True

    def open(self) -> None:
        """Take the pins; both motors are at rest."""
        pins = self.wiring.pins
        self._motors = [
            self.device("Motor", pins["ain1"], pins["ain2"], enable=pins["pwma"], pwm=True),
            self.device("Motor", pins["bin1"], pins["bin2"], enable=pins["pwmb"], pwm=True),
        ]

    def close(self) -> None:
        """Disable both motors, then release the pins: a pin that keeps its level when released must not enable one."""
        for device in self._devices:
            if (enable := getattr(device, "enable_device", None)) is not None:
                enable.off()
        super().close()

    def outputs_for(self, values: Values) -> object:
        """Power of both, -1 to 1."""
        return tuple(_signed_share(float(values[name])) for name in ("left_motor", "right_motor"))

    def drive(self, wanted: object) -> None:
        """Set direction and power."""
        assert isinstance(wanted, tuple)
        for motor, power in zip(self._motors, wanted, strict=True):
            motor.value = power


def _signed_share(percent: float) -> float:
    return round(share(percent) - share(-percent), 4)


HALF_STEPS = (0b0001, 0b0011, 0b0010, 0b0110, 0b0100, 0b1100, 0b1000, 0b1001)
"""Which coils are on in the eight half steps (28BYJ-48 data sheet, table of the lead wires); bit 0 is IN1."""
STEPS_PER_TURN = 4096
"""Half steps of a full turn: 64 of the motor times the 1:64 gear (data sheet: 5.625 degrees / 64)."""
IDLE_S = 0.05
"""Longest sleep of the stepping thread."""


class Stepper(PinDriver):
    """28BYJ-48 with ULN2003: a thread of its own steps, because the time between two steps is about a millisecond.

    The coils are off at rest: the motor does not hold its position, and does not get hot.
    """

    samples = True
    drives = True

    def open(self) -> None:
        """Take the pins; all coils are off."""
        self._coils = [self.device("DigitalOutputDevice", self.wiring.pins[f"in{coil}"]) for coil in range(1, 5)]
        self._rpm = 0.0
        self._half_steps = 0
        self._news = threading.Event()
        self._closing = False
        self._thread = threading.Thread(target=self._run, name="msbot-stepper", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread; all coils are off."""
        if getattr(self, "_thread", None) is not None:
            self._closing = True
            self._rpm = 0.0
            self._news.set()
            self._thread.join(1.0)
        super().close()

    def outputs_for(self, values: Values) -> object:
        """Turns per minute."""
        return round(float(values["turning"]), 3)

    def drive(self, wanted: object) -> None:
        """Turn at that speed from now on."""
        assert isinstance(wanted, float)
        self._rpm = wanted
        self._news.set()

    def sample(self, values: Values) -> Values:
        """The steps made, in the unit in which the part counts."""
        return {"steps": round(self._half_steps * float(values["steps_per_turn"]) / STEPS_PER_TURN)}

    def step(self, direction: int) -> None:
        """One half step."""
        self._half_steps += direction
        pattern = HALF_STEPS[self._half_steps % len(HALF_STEPS)]
        for bit, coil in enumerate(self._coils):
            coil.value = pattern >> bit & 1

    def _run(self) -> None:
        due_at = time.monotonic()
        while not self._closing:
            rpm = self._rpm
            if rpm == 0.0:
                for coil in self._coils:
                    coil.off()
                self._news.wait()
                self._news.clear()
                due_at = time.monotonic()
                continue
            due_at = max(due_at + 60 / abs(rpm) / STEPS_PER_TURN, time.monotonic() - IDLE_S)
            while (left_s := due_at - time.monotonic()) > 0 and not self._closing and self._rpm == rpm:
                time.sleep(min(left_s, IDLE_S))
            if self._rpm == rpm:
                self.step(1 if rpm > 0 else -1)
