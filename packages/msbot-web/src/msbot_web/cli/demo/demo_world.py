"""The world of a demo: one of its own, or one of another program."""

from __future__ import annotations

import asyncio
import contextlib
import secrets
import shlex
from collections.abc import Callable, Coroutine, Sequence
from pathlib import Path
from types import FunctionType
from typing import TYPE_CHECKING

from msbot.cli.run.world_options import OTHER, PASSWORD_VARIABLE, WorldOptions, address, remote_world
from msbot.config import write_sample
from msbot.operations.dispatch import InProcessOperations
from msbot.pnp import PartState
from msbot_agent.startup.extensions import extensions
from msbot_school.demo import DemoRobot
from msbot_school.lessons.catalog import LessonCatalog
from msbot_school.lessons.lesson import Lesson
from msbot_school.lessons.lesson_controller import LessonController

if TYPE_CHECKING:
    from msbot.sim.arena.arena_server import ArenaServer
    from msbot.sim.arena.running_arena import RunningArena
    from msbot.sim.arena.world_connection import WorldConnection


PILOT = "PILOT"
"""The part that a person's program takes the place of: it is not plugged in at the beginning."""


class DemoWorld:
    """The world of a demo, made from wishes.

    Raises:
        ConfigError: there is no such world, or it has no such place.
    """

    def __init__(self, wishes: WorldOptions, seed: int | None, say: Callable[[str], None]) -> None:
        self.living: RunningArena | None = None
        self.door: WorldConnection | None = None
        self.robot = ""
        """The place of the demo's robot in a world of its own."""
        self._server: ArenaServer | None = None
        self._shows_password = True
        """Not where it came by the environment, so that it is seen nowhere."""
        self._say = say
        if wishes.world is None:
            return
        if wishes.world.startswith(OTHER):
            self.door = remote_world(wishes.world, wishes.place, say)
            return
        from msbot.sim.arena.arena import Arena, place_for
        from msbot.sim.arena.arena_server import ArenaServer
        from msbot.sim.arena.running_arena import RunningArena
        from msbot.sim.arena.world_connection import LocalWorldConnection
        from msbot.sim.arena.world_reader import open_world

        plan = open_world(wishes.world)
        self.robot = place_for(plan, wishes.place).name
        self.living = RunningArena(Arena(plan, seed))
        self.door = LocalWorldConnection(self.living, self.robot)
        if wishes.share is not None:
            password = wishes.guests_password or secrets.token_urlsafe(9)
            self._shows_password = wishes.password is not None or wishes.guests_password is None
            at = address(wishes.share, "--share-world 7600")
            self._server = ArenaServer(self.living, *at, password=password, say=say)

    def coroutines(self, operations: InProcessOperations) -> list[Coroutine[object, object, None]]:
        """What must run beside the robot, whose operations get to know the world."""
        if self.living is not None:
            operations.worlds.attach(self.living)
        return [] if self._server is None else [self._server.run(), self._greet(self._server)]

    async def _greet(self, server: ArenaServer) -> None:
        await server.ready.wait()
        # A line of its own: it is copied.
        known = f"{server.password}@" if self._shows_password else ""
        world = shlex.quote(f"tcp:{known}{server.host}:{server.port}")
        hint = "" if known else f" (with the same ${PASSWORD_VARIABLE})"
        self._say(f"The world is shared: msbot demo --world {world}{hint}")


# The demo as the robot of a lesson: `msbot demo --lesson NAME`.


PATIENCE_S = 10.0


def blueprint_for(sample: str, lesson: Lesson | None, folder: Path) -> Path:
    """The blueprint of a sample, written to that folder; or the one that a lesson names."""
    if lesson is not None and lesson.blueprint is not None:
        return lesson.blueprint
    path = folder / "robot.toml"
    path.unlink(missing_ok=True)  # of the demo before in this place
    if lesson is None and (write := extensions().get("samples", sample, FunctionType)) is not None:
        write(path)
    else:
        write_sample(path, sample if lesson is None else lesson.robot)
    return path


def chosen_lesson(name: str | None, folders: Sequence[Path]) -> Lesson | None:
    """The lesson of that name; None: none is wanted."""
    return None if name is None else LessonCatalog(folders).get(name)


def make_lesson_controller(
    operations: InProcessOperations, folders: Sequence[Path], robot: DemoRobot, world: str
) -> LessonController:
    """The lesson desk of a demo in a world, or in none."""
    return LessonController(operations, LessonCatalog(folders), parts=robot, bus=robot.bus_driver, world=world)


async def start_lesson(
    desk: LessonController, lesson: Lesson | None, robot: DemoRobot, say: Callable[[str], None], who: str
) -> None:
    """Begin the lesson, if there is one, when all parts are in; at the latest after `PATIENCE_S`."""
    if lesson is not None:
        await robot.begun.wait()
        all_in = asyncio.Event()

        def look(_: object = None) -> None:
            if all(part.state == PartState.ACTIVE.value for part in robot.snapshot().parts if part.plugged):
                all_in.set()

        robot.on_event(look)
        look()
        with contextlib.suppress(TimeoutError):  # a lesson can begin without one of them
            await asyncio.wait_for(all_in.wait(), PATIENCE_S)
        say(await desk.begin(lesson.name, who))
