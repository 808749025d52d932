"""How the parts of one robot come into a world: one that lives in this process, or one of another program."""

from __future__ import annotations

from collections.abc import Collection
from typing import Protocol

from msbot.sim.arena.default_mounts import is_placed_by_itself
from msbot.sim.arena.running_arena import RunningArena, SimulatedWorldPart, quantities_of
from msbot.sim.simulated_part import SimulatedPart


class WorldConnection(Protocol):
    """The way into a world for the parts of one robot."""

    def enter(self, slot: str, simulated: SimulatedPart) -> None:
        """Bring a part in, if its type has a place in a world."""

    def leave(self, slot: str) -> None:
        """Take it out; nothing happens if it is not in."""

    async def run(self) -> None:
        """Keep the door open until cancelled."""


def fits(quantities: Collection[str], slot: str, named: Collection[str]) -> bool:
    """Whether a part belongs into a world: by its type, or because the world file names its slot."""
    return bool(quantities) and (slot in named or is_placed_by_itself(quantities))


class LocalWorldConnection:
    """The door of the program that has the world.

    Args:
        living: the world.
        robot: the robot in it whose parts come in.
    """

    def __init__(self, living: RunningArena, robot: str) -> None:
        self.living = living
        self.robot = robot

    def enter(self, slot: str, simulated: SimulatedPart) -> None:
        """See `WorldConnection.enter`."""
        quantities = quantities_of(simulated.part_type)
        named = [part.slot for part in self.living.arena.robot(self.robot).plan.mounts]
        if fits(quantities, slot, named):
            self.living.seat(self.robot, slot, quantities, SimulatedWorldPart(simulated))

    def leave(self, slot: str) -> None:
        """See `WorldConnection.leave`."""
        self.living.unseat(self.robot, slot)

    async def run(self) -> None:
        """The world lives."""
        await self.living.run()
