"""What the checks of a lesson see of a running robot."""

from __future__ import annotations

from msbot.operations.running_robot import RunningRobot
from msbot.pnp.model import Configuration
from msbot_agent.link.can.sim import SimBusDriver
from msbot_school.faults.fault_kinds import LOAD
from msbot_school.faults.port_values import LatestPortValues
from msbot_xrce.errors import ConfigError


class RunningRobotState:
    """The robot at this moment; satisfies `RobotState`.

    Args:
        running: the robot.
        bus: its simulated bus.
    """

    def __init__(self, running: RunningRobot, bus: SimBusDriver | None) -> None:
        self._running = running
        self._bus = bus
        self._numbers = LatestPortValues(running)

    @property
    def has_bus(self) -> bool:
        """Whether the load of its bus is known."""
        return self._bus is not None

    def state(self, slot: str) -> str:
        """See `RobotState`."""
        return self._running.state_of(slot)

    def is_in_state(self, slot: str, state: str) -> bool:
        """See `RobotState`."""
        return self._running.is_in_state(slot, state)

    def number(self, source: str) -> float | None:
        """See `RobotState`."""
        if source == LOAD:
            return None if self._bus is None else 100 * self._bus.load()
        return self._numbers.newest(source) if self._watches(source) else None

    def numbers_since(self, source: str, heard: int | None) -> tuple[list[float], int]:
        """See `RobotState`."""
        if source == LOAD:
            value = self.number(source)
            return [] if value is None else [value], 0
        return self._numbers.since(source, heard) if self._watches(source) else ([], 0)

    def part_in(self, slot: str) -> str:
        """See `RobotState`."""
        holder = self._running.holder(slot)
        return "" if holder is None or holder.state.is_over else holder.part

    def identity_in(self, slot: str) -> str:
        """See `RobotState`."""
        holder = self._running.holder(slot)
        return "" if holder is None or not holder.state.is_registered else f"{holder.uid.hex()} {holder.client_key}"

    def has_slot(self, slot: str) -> bool:
        """See `RobotState`."""
        return slot in self._running.slot_names()

    def knows(self, number: str) -> bool:
        """See `RobotState`."""
        return self._running.library is not None and self._running.library.find(number) is not None

    def setting(self, slot: str, name: str) -> str | None:
        """See `RobotState`; what the part in the slot has been given."""
        held = self._held(slot)
        return None if held is None else dict(held.settings).get(name)

    def is_wired(self, source: str, target: str) -> bool:
        """See `RobotState`; what the parts in the slots have been given."""
        topics = []
        for port, publishes in ((source, True), (target, False)):
            slot, _, name = port.partition(".")
            held = self._held(slot)
            bindings = () if held is None else held.bindings
            topics.append({one.topic for one in bindings if one.port == name and one.publishes is publishes})
        return bool(topics[0] & topics[1])

    @property
    def is_stopped(self) -> bool:
        """See `RobotState`."""
        return self._running.master.stop.stopped

    def _watches(self, source: str) -> bool:
        try:
            self._numbers.watch(source)  # another part may be there now, or another topic
        except ConfigError:
            return False
        return True

    def _held(self, slot: str) -> Configuration | None:
        holder = self._running.holder(slot)
        return None if holder is None else self._running.inventory.configuration_of(holder.client_key)
