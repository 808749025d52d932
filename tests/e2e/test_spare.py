"""A hot spare in the sample robot, in virtual time and through the command: it holds the slot within one tick."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable
from pathlib import Path
from random import Random

import pytest

from msbot.config import load_blueprint, load_library, write_sample
from msbot.operations.dispatch import InProcessOperations
from msbot.process.virtual_time import run_virtual
from msbot.registry import open_registry
from msbot_school.demo import DemoLinkKind, DemoRobot, DemoSnapshot, DemoStateChange
from tests.e2e.processes import run, running

Scene = Callable[[DemoRobot, InProcessOperations], Awaitable[None]]


def play(
    folder: Path, scene: Scene, *, preset: str = "thesis", wire: DemoLinkKind = DemoLinkKind.CAN
) -> tuple[DemoRobot, DemoSnapshot]:
    """Run the sample robot with a spare, DD, for BB."""

    async def main() -> tuple[DemoRobot, DemoSnapshot]:
        path = folder / "robot.toml"
        write_sample(path)
        text = path.read_text()
        assert 'preset = "thesis"' in text
        path.write_text(text.replace('preset = "thesis"', f'preset = "{preset}"'))
        library = load_library()
        blueprint = load_blueprint(path, library)
        with open_registry(folder / "robot.db") as registry:
            record = registry.robots.apply_blueprint(blueprint, library)
            robot = DemoRobot(
                blueprint,
                registry.runs.begin(record),
                wire=wire,
                spares={"DD": "BB"},
                random=Random(1),
                epoch_ns=lambda: 0,
            )
            operations = InProcessOperations(robot.master, registry, record, library=library)
            async with asyncio.TaskGroup() as tasks:
                running = tasks.create_task(robot.run())
                await robot.master.ready.wait()
                await asyncio.sleep(2.3)
                await scene(robot, operations)
                robot.finish()
                await running
            return robot, robot.snapshot()

    return run_virtual(main())


def changes(robot: DemoRobot, name: str) -> list[tuple[str, str, str]]:
    return [(event.from_state, event.to_state, event.slot) for event in robot.events if event.part == name]


def when(robot: DemoRobot, name: str, state: str) -> float:
    return [event.at_s for event in robot.events if (event.part, event.to_state) == (name, state)][-1]


@pytest.mark.parametrize(("preset", "tick_s", "lost_within_s"), [("thesis", 2.0, 6.0), ("fast", 0.5, 1.5)])
def test_the_spare_holds_the_slot_within_one_tick_and_the_ring_goes_on(
    preset: str, tick_s: float, lost_within_s: float, tmp_path: Path
) -> None:
    """R62: nobody touches anything."""
    heard: dict[str, int] = {}

    async def scene(robot: DemoRobot, _operations: InProcessOperations) -> None:
        assert [part.state for part in robot.snapshot().parts] == ["active"] * 3 + ["standby"]
        robot.unplug("BB")
        heard["unplugged"] = robot.snapshot().parts[2].messages_in
        await asyncio.sleep(lost_within_s + tick_s)
        heard["taken over"] = robot.snapshot().parts[2].messages_in
        await asyncio.sleep(5.0)
        heard["later"] = robot.snapshot().parts[2].messages_in

    robot, snapshot = play(tmp_path, scene, preset=preset)
    assert when(robot, "DD", "active") - when(robot, "BB", "lost") <= tick_s
    assert changes(robot, "DD") == [("checking", "standby", ""), ("standby", "active", "BB")]
    spare = snapshot.parts[3]
    assert (spare.name, spare.slot, spare.state) == ("DD", "BB", "active")
    assert sum(spare.outputs) == 1  # it does what AA says
    assert heard["later"] - heard["taken over"] >= 4  # CC hears it as it heard BB


def test_undo_brings_the_first_part_back(tmp_path: Path) -> None:
    async def scene(robot: DemoRobot, operations: InProcessOperations) -> None:
        robot.unplug("BB")
        await asyncio.sleep(7.0)
        robot.plug("BB")
        await asyncio.sleep(1.0)
        assert changes(robot, "BB")[-1] == ("checking", "standby", "")
        await operations.do("undo", who="ann")
        await asyncio.sleep(3.0)

    robot, snapshot = play(tmp_path, scene)
    assert [(part.name, part.slot, part.state) for part in snapshot.parts] == [
        ("AA", "AA", "active"),
        ("BB", "BB", "active"),
        ("CC", "CC", "active"),
        ("DD", "", "standby"),
    ]
    assert changes(robot, "DD")[-1] == ("active", "standby", "")


def test_swap_on_a_can_bus_gives_settings_and_topics_to_the_spare_and_silences_the_other(tmp_path: Path) -> None:
    async def scene(robot: DemoRobot, operations: InProcessOperations) -> None:
        await operations.do("swap", slot="BB", to="DD", who="ann")
        await asyncio.sleep(5.0)

    _, snapshot = play(tmp_path, scene, wire=DemoLinkKind.FD)
    assert [(part.slot, part.state) for part in snapshot.parts[1:]] == [
        ("", "standby"),
        ("CC", "active"),
        ("BB", "active"),
    ]
    assert snapshot.parts[1].outputs == (False,) * 8  # it went to its safe state


def test_a_spare_that_was_lost_itself_takes_nothing_over(tmp_path: Path) -> None:
    async def scene(robot: DemoRobot, _operations: InProcessOperations) -> None:
        robot.unplug("DD")
        await asyncio.sleep(8.0)
        robot.unplug("BB")
        await asyncio.sleep(8.0)

    robot, _ = play(tmp_path, scene)
    assert [state for _, state, _ in changes(robot, "DD")] == ["standby", "lost"]


def test_two_spares_take_over_one_after_the_other(tmp_path: Path) -> None:
    async def scene(robot: DemoRobot, _operations: InProcessOperations) -> None:
        for _ in range(2):
            for name in ("BB", "DD"):
                robot.unplug(name)
                await asyncio.sleep(7.0)
                robot.plug(name)
                await asyncio.sleep(1.0)

    robot, snapshot = play(tmp_path, scene)
    taken: list[DemoStateChange] = [event for event in robot.events if event.reason.startswith("takes over slot BB")]
    assert [event.part for event in taken] == ["DD", "BB", "DD", "BB"]
    assert [part.slot for part in snapshot.parts] == ["AA", "BB", "CC", ""]


def test_the_commands_work_on_a_demo_that_runs_in_another_process(tmp_path: Path) -> None:
    place = {"XDG_RUNTIME_DIR": str(tmp_path)}
    own = ("--db", str(tmp_path / "demo.db"))  # STOP without it is for every robot of this computer
    options = ("--robot", "thesis", "--spare", "--link", "udp", "--no-page", *own)
    with running("demo", *options, cwd=tmp_path, env=place) as demo:
        demo.wait_for("DD", "standby")

        def command(*words: str) -> str:
            done = run(*words, cwd=tmp_path, env=place)
            assert done.returncode == 0, done.stderr
            return done.stdout

        assert command("swap", "BB", "--to", "DD").startswith(
            "DD takes slot BB in place of EFGH-local, which stands by"
        )
        assert "now: DD (EFGH) is active since" in command("why", "DD")
        assert command("undo").startswith("change 1 undone")
        assert {part["name"] for part in json.loads(command("parts", "--json"))} >= {"ABCD-local", "EFGH-local"}
        assert "have confirmed it within" in command("stop", "--reason", "bell", *own)
        assert "STOP is over" in command("go", *own)
        assert "STOP by" in command("undo", "--list")
        assert demo.end() == 0
