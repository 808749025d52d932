"""A demo robot in virtual time with its lesson desk."""

from __future__ import annotations

import asyncio
import re
import sys
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from types import ModuleType
from unittest import mock

from msbot.config import load_blueprint, load_library, write_sample
from msbot.operations.dispatch import InProcessOperations
from msbot.operations.stand_ins import StandIns
from msbot.part import Part
from msbot.process.virtual_time import run_virtual
from msbot.registry import Registry, open_registry
from msbot.sim.arena.arena import Arena
from msbot.sim.arena.running_arena import RunningArena
from msbot.sim.arena.world_connection import LocalWorldConnection
from msbot.sim.arena.world_reader import open_world
from msbot_agent.link import InprocHub, LinkInfo
from msbot_school.demo import DemoRobot
from msbot_school.faults.fault_lab import FaultLab
from msbot_school.lessons.catalog import LessonCatalog
from msbot_school.lessons.lesson_controller import LessonController
from msbot_xrce.errors import MsbotError
from tests import ROOT
from tests.operations.stage import put_database

PROGRAM = re.compile(r"```python\n(.*?)```", re.DOTALL)
HANDBOOK = ROOT / "docs/howto/blocks.md"


def blocks_of_the_handbook() -> str:
    """The program that the page about blocks makes of them: a line follower."""
    found = PROGRAM.search(HANDBOOK.read_text())
    assert found is not None
    return found[1]


@dataclass
class LessonStage:
    """What a scene has."""

    robot: DemoRobot
    operations: InProcessOperations
    desk: LessonController
    registry: Registry
    hub: InprocHub
    tasks: asyncio.TaskGroup
    living: RunningArena | None = None
    """The world that the robot is in."""
    programs: list[asyncio.Task[None]] = field(default_factory=list)
    parts: DemoRobot | StandIns = field(init=False)
    """The simulated parts, as the cards have them."""

    async def do(self, operation: str, who: str = "Ada", **arguments: object) -> str:
        """What the person is told."""
        return (await self.operations.do(operation, who=who, **arguments)).words

    async def refused(self, operation: str, who: str = "Ada", **arguments: object) -> str:
        """Why it is not done."""
        try:
            words = await self.do(operation, who, **arguments)
        except MsbotError as error:
            return str(error)
        raise AssertionError(f"it was done: {words}")

    async def seen(self) -> Mapping[str, object]:
        """What page and command show."""
        return (await self.operations.do("lesson", who="Ada")).answer

    async def ticked(self) -> Sequence[str]:
        """The checks that have ticked."""
        checks = (await self.seen())["checks"]
        assert isinstance(checks, list)
        return [one["check"] for one in checks if one["ticked"]]

    def turn(self, slot: str, control: str, value: float | bool) -> None:
        """Do something to a simulated part."""
        unit = self.parts.simulated(slot)
        assert unit is not None
        unit.set(control, value)

    async def sweep(self) -> None:
        """Turn the knob to and fro."""
        for value in (5.0, 95.0, 20.0):
            self.turn("knob", "knob", value)
            await asyncio.sleep(0.6)

    def run_program(self, lesson: str, old: str = "", new: str = "") -> None:
        """Run the program that a lesson prints, with one line in place of another."""
        path = self.desk.shelf.get(lesson).file
        assert path is not None
        found = PROGRAM.search(path.read_text())
        assert found is not None
        self.run_text(found[1].replace(old, new), str(path))

    def run_text(self, text: str, where: str) -> None:
        """Run the text of a program."""
        parts: list[Part] = []
        module = ModuleType("lesson_program")
        with (
            mock.patch.dict(sys.modules, {module.__name__: module}),
            mock.patch.object(Part, "run", autospec=True, side_effect=parts.append),
        ):
            exec(compile(text, where, "exec"), vars(module))
        self.programs.append(self.tasks.create_task(parts[0].run_async(self.hub.connect(), epoch_ns=lambda: 0)))


Scene = Callable[[LessonStage], Awaitable[None]]


def lesson_scene(
    folder: Path,
    scene: Scene,
    *,
    sample: str = "rover",
    folders: Sequence[Path] = (),
    world: str = "",
    has_parts: bool = True,
) -> None:
    """Run a sample robot, with all its parts or without hardware, in a world or in none, and its lesson desk."""

    async def main() -> None:
        path = folder / "robot.toml"
        write_sample(path, sample)
        library = load_library()
        blueprint = load_blueprint(path, library)
        put_database(folder / "robot.db")
        with open_registry(folder / "robot.db") as registry:
            record = registry.robots.apply_blueprint(blueprint, library)
            store = registry.runs.begin(record)
            living = RunningArena(Arena(open_world(world))) if world else None
            door = None if living is None else LocalWorldConnection(living, "robot")
            missing = () if has_parts else [slot.name for slot in blueprint.slots]
            robot = DemoRobot(blueprint, store, random=Random(1), library=library, door=door, unplugged=missing)
            operations = InProcessOperations(robot.master, registry, record, library=library)
            lab = FaultLab(operations, parts=robot, bus=robot.bus_driver)
            parts = robot if has_parts else None
            bus = robot.bus_driver if has_parts else None  # a robot without hardware is not on a simulated bus
            desk = LessonController(operations, LessonCatalog(folders), parts=parts, bus=bus, world=world)
            hub = InprocHub()
            hub.server.info = LinkInfo("students", hub.server.info.mtu)
            robot.master.add_link(hub.server)
            async with asyncio.TaskGroup() as tasks:
                running = [tasks.create_task(work) for work in (robot.run(), lab.run(), desk.run())]
                await robot.master.ready.wait()
                await asyncio.sleep(3)
                stage = LessonStage(robot, operations, desk, registry, hub, tasks, living)
                stage.parts = robot if has_parts else operations.stand_ins
                await scene(stage)
                for task in (*running[1:], *stage.programs):
                    task.cancel()
                robot.finish()

    run_virtual(main())
