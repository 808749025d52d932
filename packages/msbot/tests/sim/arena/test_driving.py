"""Whole robots in a world, in virtual time: a pupil's program drives, STOP stops, a part that is pulled out is gone."""

from __future__ import annotations

import asyncio
import math
import runpy
from collections.abc import Awaitable, Callable
from pathlib import Path
from random import Random

import pytest

from msbot.config import SAMPLES, Blueprint, load_library, parse_blueprint
from msbot.part import JoinState, Part
from msbot.process.virtual_time import run_virtual
from msbot.registry import open_registry
from msbot.sim import make_simulator
from msbot.sim.arena.arena import Arena
from msbot.sim.arena.running_arena import RunningArena
from msbot.sim.arena.world_connection import LocalWorldConnection
from msbot.sim.arena.world_reader import open_world
from msbot_agent.link import InprocHub
from msbot_school.demo import DemoRobot
from tests import ROOT

EXAMPLE = ROOT / "examples/arena/line_follower.py"


def pilot(monkeypatch: pytest.MonkeyPatch) -> Part:
    """The part of the example, which is run by the test and not by itself."""
    monkeypatch.setattr(Part, "run", lambda self: None)
    part = runpy.run_path(str(EXAMPLE))["part"]
    assert isinstance(part, Part)
    return part


def play(
    folder: Path,
    world: str,
    scene: Callable[[DemoRobot, RunningArena], Awaitable[None]],
    program: Part | None = None,
    names: tuple[str, ...] = ("pilot", "wheels", "line", "eyes", "left_wheel"),
    spares: dict[str, str] | None = None,
    beside: tuple[str, ...] = (),
) -> RunningArena:
    """Run a buggy in a world, with a program in the slot of its pilot.

    Parts `beside` the others come by a link in memory, which costs a tenth of a simulated bus.
    """

    async def main() -> RunningArena:
        library = load_library()
        blueprint = parse_blueprint(SAMPLES["buggy"], library)
        living = RunningArena(Arena(open_world(world)))
        with open_registry(folder / "robot.db") as registry:
            store = registry.runs.begin(registry.robots.apply_blueprint(blueprint, library))
            door = LocalWorldConnection(living, "robot")
            robot = DemoRobot(
                blueprint,
                store,
                library=library,
                random=Random(1),
                epoch_ns=lambda: 0,
                unplugged=["pilot"],
                door=door,
                names=names,
                spares=spares,
            )
            hub = InprocHub()
            units = {
                name: make_simulator(_number(blueprint, name), local_name=name, random=Random(number))
                for number, name in enumerate(beside, 2)  # their UIDs must differ
            }
            for name, unit in units.items():
                door.enter(name, unit)
            robot.master.add_link(hub.server)
            async with asyncio.TaskGroup() as tasks:
                running = tasks.create_task(robot.run())
                await robot.begun.wait()
                parts = [unit.part for unit in units.values()] + ([program] if program is not None else [])
                joined = [tasks.create_task(part.run_async(hub.connect(), epoch_ns=lambda: 0)) for part in parts]
                await asyncio.sleep(2.0)
                await scene(robot, living)
                for task in joined:
                    task.cancel()
                robot.finish()
                await running
        return living

    return run_virtual(main())


def _number(blueprint: Blueprint, name: str) -> str:
    slot = blueprint.slot(name)
    assert slot is not None
    return slot.part_number


def test_the_line_follower_drives_the_whole_track_and_stop_stops_it_by_the_parts_themselves(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = pilot(monkeypatch)
    farthest = 0.0

    async def scene(robot: DemoRobot, living: RunningArena) -> None:
        nonlocal farthest
        assert program.state is JoinState.ACTIVE
        body = living.arena.robot("robot")
        start = body.plan.start
        turned = 0.0
        for _ in range(74):
            await asyncio.sleep(0.5)
            at = body.pose
            near = min(math.dist((at.x, at.y), point) for point in living.arena.plan.lines[0].points)
            assert near < 0.12, f"it has left the line at {at}"
            farthest = max(farthest, math.dist((at.x, at.y), start))
            turned = at.angle
        assert farthest > 1.0
        assert turned > math.tau - 0.5  # once round
        robot.master.say_stop("a test", "a look")
        await asyncio.sleep(1.0)
        stood = living.arena.digest()
        assert body.body.velocity.length < 1e-3
        assert {seat.does.get("motor.left", 0.0) for seat in body.seats.values()} == {0.0}
        robot.master.say_go("a test")
        await asyncio.sleep(1.0)
        assert living.arena.digest() != stood
        assert body.body.velocity.length > 0.1

    play(tmp_path, "line", scene, program, names=("pilot",), beside=("wheels", "line"))


def test_parts_see_the_world_and_a_driver_that_is_pulled_out_leaves_the_wheels_without_power(tmp_path: Path) -> None:
    async def scene(robot: DemoRobot, living: RunningArena) -> None:
        eyes = robot.simulated("eyes")
        assert eyes is not None
        assert eyes.readings()["metres"] == pytest.approx(1.1, abs=0.05)
        assert robot.plug("pilot")
        await asyncio.sleep(2.0)
        hand = robot.simulated("pilot")
        assert hand is not None
        hand.set("left_power", 60.0)
        hand.set("right_power", 60.0)
        await asyncio.sleep(1.5)
        assert float(eyes.readings()["metres"]) < 0.8  # it has driven towards the wall
        wheel = robot.simulated("left_wheel")
        assert wheel is not None
        assert float(wheel.readings()["rpm"]) > 30
        robot.unplug("wheels")
        await asyncio.sleep(1.0)
        assert living.arena.robot("robot").body.velocity.length < 1e-3

    play(tmp_path, "line", scene)


def test_a_spare_that_takes_over_drives_on(tmp_path: Path) -> None:
    async def scene(robot: DemoRobot, living: RunningArena) -> None:
        assert robot.plug("pilot")
        await asyncio.sleep(2.0)
        hand = robot.simulated("pilot")
        assert hand is not None
        for control in ("left_power", "right_power"):
            hand.set(control, 30.0)
        await asyncio.sleep(1.0)
        robot.unplug("wheels")
        await asyncio.sleep(6.0)
        assert living.arena.robot("robot").body.velocity.length > 0.02

    names = ("pilot", "wheels", "rear_wheels")
    play(tmp_path, "warehouse", scene, names=names, spares={"spare wheels": "wheels"})


def test_a_paused_world_stands_still_and_goes_on_by_steps_and_at_other_speeds(tmp_path: Path) -> None:
    async def scene(_: DemoRobot, living: RunningArena) -> None:
        living.paused = True
        before = living.arena.now
        await asyncio.sleep(1.0)
        assert living.arena.now == before
        living.step()
        assert living.arena.now == pytest.approx(before + 0.02)
        living.paused, living.speed = False, 0.25
        await asyncio.sleep(1.0)
        assert living.arena.now == pytest.approx(before + 0.27, abs=0.03)

    play(tmp_path, "maze", scene)


def test_a_buggy_with_four_motors_slides_sideways(tmp_path: Path) -> None:
    async def scene(robot: DemoRobot, living: RunningArena) -> None:
        assert robot.plug("pilot")
        await asyncio.sleep(2.0)
        hand = robot.simulated("pilot")
        assert hand is not None
        begin = living.arena.robot("robot").pose
        for control, power in (("left", -50.0), ("right", 50.0), ("rear_left", 50.0), ("rear_right", -50.0)):
            hand.set(f"{control}_power", power)
        await asyncio.sleep(1.5)
        end = living.arena.robot("robot").pose
        assert end.y - begin.y > 0.15
        assert abs(end.x - begin.x) < 0.08

    play(tmp_path, "parking", scene, names=("pilot", "wheels", "rear_wheels"))
