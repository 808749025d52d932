"""What the page shows of the demo besides its master: the simulated bus, and the simulated parts to be played with."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from msbot.sim.arena.running_arena import RunningArena
from msbot_agent.link.can.sim import SimBusDriver
from msbot_school.demo import DemoRobot
from msbot_web.assembly import PageSources
from msbot_web.frame_ring import FrameRing
from msbot_web.model_builder import BusMeter
from msbot_web.models.robot_models import Scalar
from msbot_web.simulated.simulated_part_controls import SimulatedPartControls


class DemoControls(SimulatedPartControls):
    """The demo's parts."""

    def __init__(self, robot: DemoRobot) -> None:
        super().__init__(robot)
        self._demo = robot

    def readings(self, slot: str) -> Mapping[str, Scalar]:
        """See `SimulatedControls.readings`; of the thesis' three, the pins of the GPIO board that are on."""
        if self._demo.simulated(slot) is not None:
            return super().readings(slot)
        return {f"pin {pin}": level for pin, level in enumerate(self._demo.board(slot).levels()) if level}


class SimMeter(BusMeter):
    """The figures of a simulated bus."""

    def __init__(self, name: str, driver: SimBusDriver, clock: Callable[[], float]) -> None:
        self.name = name
        self.bitrate = driver.bus.bitrate
        self.data_bitrate = driver.bus.data_bitrate or 0
        self._driver = driver
        self._clock = clock

    def load_percent(self) -> float:
        """See `BusMeter.load_percent`."""
        return 100 * self._driver.bus.load(self._clock())

    def errors(self) -> int:
        """See `BusMeter.errors`."""
        return self._driver.bus.counters.errors


def seen_of(robot: DemoRobot, clock: Callable[[], float], arena: RunningArena | None = None) -> PageSources:
    """What the page shows of a demo, and of the world that it has."""
    frames, driver = FrameRing(), robot.bus_driver
    if driver is None:
        return PageSources(frames, bench=DemoControls(robot), arena=arena)
    driver.listeners.append(frames.tap)
    return PageSources(frames, SimMeter("simulated CAN bus", driver, clock), DemoControls(robot), arena)
