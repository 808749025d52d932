"""A robot in virtual time with its fault lab, and with what its page shows."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from random import Random

from msbot.config import load_blueprint, load_library, write_sample
from msbot.operations.dispatch import InProcessOperations
from msbot.part import Part
from msbot.process.virtual_time import run_virtual
from msbot.registry import Registry, open_registry
from msbot.sim import message_class
from msbot_school.demo import DemoLinkKind, DemoRobot
from msbot_school.faults.fault_lab import FaultLab
from msbot_web.demo_controls import seen_of
from msbot_web.live_values import LiveValues
from msbot_web.model_builder import ModelBuilder
from msbot_web.models.robot_models import SlotCard
from msbot_web.timeline import Timeline
from msbot_xrce.errors import MsbotError
from tests.operations.stage import put_database

PAIR = ("knob", "fan")
KEY = bytes(range(16))
BITRATE = 125_000
"""A slow bus: filling it costs fewer frames."""


@dataclass
class FaultStage:
    """What a scene has."""

    robot: DemoRobot
    operations: InProcessOperations
    lab: FaultLab
    registry: Registry
    page: ModelBuilder
    changes: list[Mapping[str, object]] = field(default_factory=list)
    turned: int = 0

    async def plant(self, kind: str, at: str = "", **options: object) -> str:
        """What the teacher is told."""
        return (await self.operations.do("plant_fault", who="Ada", kind=kind, at=at, **options)).words

    async def refused(self, kind: str, at: str = "", **options: object) -> str:
        """Why it cannot be planted."""
        try:
            words = await self.plant(kind, at, **options)
        except MsbotError as error:
            return str(error)
        raise AssertionError(f"it was planted: {words}")

    async def listed(self) -> list[Mapping[str, object]]:
        """What the teacher's list shows."""
        found = (await self.operations.do("faults", who="Ada")).answer["faults"]
        assert isinstance(found, list)
        return found

    async def turn(self, seconds: float) -> None:
        """Turn the knob to and fro, so that there is something to say."""
        for _ in range(round(seconds / 0.1)):
            self.turned = (self.turned + 7) % 50
            self.page.bench.operate("knob", "knob", 20.0 + self.turned)
            await asyncio.sleep(0.1)

    async def quiet(self) -> None:
        """End what is planted, and wait until all is well."""
        await self.operations.do("clear_fault", who="Ada")
        for _ in range(200):
            if all(self.card(name).state == "active" for name in PAIR):
                return
            await asyncio.sleep(0.1)
        raise AssertionError("the robot does not get well again")

    def card(self, slot: str) -> SlotCard:
        return self.page.slot(slot)

    def why(self, slot: str) -> str:
        return "\n".join(self.page.why(slot))

    def value(self, slot: str, port: str) -> float:
        """The first field of what a card shows at a port."""
        fields = next(one.fields for one in self.card(slot).ports if one.port == port)
        value = next(iter(fields.values()))
        assert isinstance(value, float)
        return value


Scene = Callable[[FaultStage], Awaitable[None]]


def fault_scene(
    folder: Path,
    scene: Scene,
    *,
    names: tuple[str, ...] = PAIR,
    wire: DemoLinkKind = DemoLinkKind.CAN,
    keyed: bool = False,
) -> FaultStage:
    """Run two parts of the rover, or others, for a while; `keyed`: the robot asks every part for its key."""

    async def main() -> FaultStage:
        path = folder / "robot.toml"
        write_sample(path, "rover")
        if keyed:
            path.write_text(path.read_text().replace("[options]", '[options]\nauthentication = "key"'))
        library = load_library()
        blueprint = load_blueprint(path, library)
        put_database(folder / "robot.db")
        with open_registry(folder / "robot.db") as registry:
            record = registry.robots.apply_blueprint(blueprint, library)
            store = registry.runs.begin(record)
            robot = DemoRobot(
                blueprint, store, names=names, wire=wire, bitrate=BITRATE, random=Random(1), library=library
            )
            if keyed:
                give_keys(robot, registry)
            operations = InProcessOperations(robot.master, registry, record, library=library)
            lab = FaultLab(operations, parts=robot, bus=robot.bus_driver)
            clock = asyncio.get_running_loop().time
            seen = seen_of(robot, clock)
            assert seen.bench is not None
            timeline = Timeline()
            live = LiveValues(robot.master.space, lambda name: message_class(library.messages[name]), clock)
            page = ModelBuilder(
                robot.master,
                blueprint=lambda: blueprint,
                library=library,
                live=live,
                frames=seen.frames,
                timeline=timeline,
                bench=seen.bench,
                clock=clock,
                ignored=lambda _: False,
                bus=seen.bus,
                planted=operations.faults.visible_faults,
            )
            stage = FaultStage(robot, operations, lab, registry, page)
            operations.faults.on_change(stage.changes.append)
            async with asyncio.TaskGroup() as tasks:
                running = [tasks.create_task(work) for work in (robot.run(), lab.run())]
                await robot.master.ready.wait()
                await asyncio.sleep(3)
                page.poll()
                assert {page.slot(name).state for name in names} == {"active"}
                await scene(stage)
                running[1].cancel()
                robot.finish()
                await running[0]
        return stage

    return run_virtual(main())


def give_keys(robot: DemoRobot, registry: Registry) -> None:
    """All parts of the demo have the key that the robot knows."""
    for plug in robot._plugs.values():
        registry.keys.store(plug.uid, KEY, "Ada")
        plug.make = partial(_with_key, plug.make)  # type: ignore[method-assign]


def _with_key(make: Callable[[Random], Part], random: Random) -> Part:
    part = make(random)
    part.key = KEY
    return part
