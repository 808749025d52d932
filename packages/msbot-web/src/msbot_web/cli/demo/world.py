"""The world of a demo: one of its own, or one of another program."""

from __future__ import annotations

import secrets
from collections.abc import Callable, Coroutine
from typing import TYPE_CHECKING

from msbot.cli.run.world import OTHER, WorldWishes, address, guest_door

if TYPE_CHECKING:
    from msbot.operations.dispatch import RunningOperations
    from msbot.sim.arena.door import Door
    from msbot.sim.arena.living_arena import LivingArena
    from msbot.sim.arena.server import ArenaServer

PILOT = "PILOT"
"""The part that a person's program takes the place of: it is not plugged in at the beginning."""


class DemoWorld:
    """The world of a demo, made from wishes.

    Raises:
        ConfigError: there is no such world, or it has no such place.
    """

    def __init__(self, wishes: WorldWishes, seed: int | None, say: Callable[[str], None]) -> None:
        self.living: LivingArena | None = None
        self.door: Door | None = None
        self.robot = ""
        """The place of the demo's robot in a world of its own."""
        self._server: ArenaServer | None = None
        self._say = say
        if wishes.world is None:
            return
        if wishes.world.startswith(OTHER):
            self.door = guest_door(wishes.world, wishes.place, say)
            return
        from msbot.sim.arena.arena import Arena, place_for
        from msbot.sim.arena.door import OwnDoor
        from msbot.sim.arena.living_arena import LivingArena
        from msbot.sim.arena.server import ArenaServer
        from msbot.sim.arena.world_reader import open_world

        plan = open_world(wishes.world)
        self.robot = place_for(plan, wishes.place).name
        self.living = LivingArena(Arena(plan, seed))
        self.door = OwnDoor(self.living, self.robot)
        if wishes.share is not None:
            password = wishes.password or secrets.token_urlsafe(9)
            at = address(wishes.share, "--share-world 7600")
            self._server = ArenaServer(self.living, *at, password=password, say=say)

    def beside(self, operations: RunningOperations) -> list[Coroutine[object, object, None]]:
        """What must run beside the robot, whose operations get to know the world."""
        if self.living is not None:
            operations.worlds.use(self.living)
        return [] if self._server is None else [self._server.run(), self._greet(self._server)]

    async def _greet(self, server: ArenaServer) -> None:
        await server.ready.wait()
        # A line of its own: it is copied.
        self._say(f"The world is shared: msbot demo --world tcp:{server.password}@{server.host}:{server.port}")
