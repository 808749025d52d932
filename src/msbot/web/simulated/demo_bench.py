"""What the page shows of the demo besides its master: the simulated bus, and the simulated parts to be played with."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from msbot.config import ControlKind
from msbot.demo import DemoRobot
from msbot.errors import ConfigError
from msbot.link.can.sim import SimBusDriver
from msbot.runtime.sentence import said
from msbot.web.api.models import ControlLine, Scalar
from msbot.web.assembly import Seen
from msbot.web.frames import FrameRing
from msbot.web.views import BusMeter


class DemoBench:
    """The demo's parts as the page's `Bench`."""

    def __init__(self, robot: DemoRobot) -> None:
        self._robot = robot

    def slots(self) -> tuple[str, ...]:
        """See `Bench.slots`."""
        return self._robot.names

    def is_plugged(self, slot: str) -> bool:
        """See `Bench.is_plugged`."""
        return self._robot.is_plugged(slot)

    def plug(self, slot: str) -> None:
        """See `Bench.plug`."""
        self._robot.plug(slot)

    def unplug(self, slot: str) -> None:
        """See `Bench.unplug`."""
        self._robot.unplug(slot)

    def controls(self, slot: str) -> tuple[ControlLine, ...]:
        """See `Bench.controls`; the thesis' three have none."""
        simulated = self._robot.simulated(slot)
        if simulated is None:
            return ()
        return tuple(
            ControlLine(
                name=control.name,
                kind=control.kind.value,
                least=control.least,
                most=control.most,
                unit=control.unit,
                choices=list(control.choices),
                words=control.words,
                value=simulated.value(control.name),
                momentary=control.momentary,
            )
            for control in simulated.controls
        )

    def operate(self, slot: str, control: str, value: Scalar) -> None:
        """See `Bench.operate`."""
        simulated = self._robot.simulated(slot)
        if simulated is None:
            raise ConfigError(said("part {slot} has nothing that could be operated, or is not plugged in", slot=slot))
        wanted = simulated.control(control)
        is_number = wanted.kind is ControlKind.NUMBER and isinstance(value, int) and not isinstance(value, bool)
        simulated.set(control, float(value) if is_number else value)

    def readings(self, slot: str) -> Mapping[str, Scalar]:
        """See `Bench.readings`; of the thesis' three, the pins of the GPIO board that are on."""
        simulated = self._robot.simulated(slot)
        if simulated is not None:
            return simulated.readings()
        return {f"pin {pin}": level for pin, level in enumerate(self._robot.board(slot).levels()) if level}


class SimMeter(BusMeter):
    """The figures of a simulated bus."""

    def __init__(self, name: str, driver: SimBusDriver, clock: Callable[[], float]) -> None:
        self.name = name
        self.bitrate = driver.bus.bitrate
        self._driver = driver
        self._clock = clock

    def load_percent(self) -> float:
        """See `BusMeter.load_percent`."""
        return 100 * self._driver.bus.load(self._clock())

    def errors(self) -> int:
        """See `BusMeter.errors`."""
        return self._driver.bus.counters.errors


def seen_of(robot: DemoRobot, clock: Callable[[], float]) -> Seen:
    """What the page shows of a demo."""
    frames, driver = FrameRing(), robot.bus_driver
    if driver is None:
        return Seen(frames, bench=DemoBench(robot))
    driver.listeners.append(frames.tap)
    return Seen(frames, SimMeter("simulated CAN bus", driver, clock), DemoBench(robot))
