"""The whole sample robot in virtual time: both steps, the ring, silence, return, on every bus (T8, T10, T11)."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path
from random import Random

import pytest

from msbot.config import Blueprint, Library, load_blueprint, load_library, write_sample
from msbot.part import Client
from msbot.process.virtual_time import run_virtual
from msbot.registry import open_registry
from msbot_agent.agent import Agent
from msbot_agent.link.can import CanMasterLink, CanPartLink
from msbot_agent.link.can.sim import SimBus, SimBusDriver
from msbot_agent.space import MemorySpace
from msbot_school.demo import DemoLinkKind, DemoRobot, DemoSnapshot

BUSES = [
    (DemoLinkKind.CAN, 125_000),
    (DemoLinkKind.CAN, 250_000),
    (DemoLinkKind.CAN, 500_000),
    (DemoLinkKind.CAN, 1_000_000),
    (DemoLinkKind.FD, 500_000),
]
THESIS_KEY = 0xBA5EBA11


def sample(folder: Path, **changes: str) -> tuple[Blueprint, Library]:
    write_sample(folder / "robot.toml")
    text = (folder / "robot.toml").read_text()
    for before, after in changes.items():
        assert before in text
        text = text.replace(before, after)
    (folder / "robot.toml").write_text(text)
    library = load_library()
    return load_blueprint(folder / "robot.toml", library), library


def play(
    folder: Path,
    scene: Callable[[DemoRobot], Awaitable[None]],
    *,
    wire: DemoLinkKind = DemoLinkKind.CAN,
    bitrate: int = 500_000,
    seed: int = 1,
) -> tuple[DemoRobot, DemoSnapshot]:
    """Run the sample robot through a scene; returns it with its last state."""

    async def main() -> tuple[DemoRobot, DemoSnapshot]:
        blueprint, library = sample(folder)
        with open_registry(folder / "robot.db") as registry:
            record = registry.robots.apply_blueprint(blueprint, library)
            robot = DemoRobot(
                blueprint,
                registry.runs.begin(record),
                wire=wire,
                bitrate=bitrate,
                node_ids=registry.runs.node_ids(record, "test"),
                random=Random(seed),
                epoch_ns=lambda: 0,
            )
            async with asyncio.TaskGroup() as tasks:
                running = tasks.create_task(robot.run())
                await robot.master.ready.wait()
                await scene(robot)
                robot.finish()
                await running
            return robot, robot.snapshot()

    return run_virtual(main())


@pytest.mark.parametrize(("wire", "bitrate"), BUSES)
def test_three_parts_join_by_themselves_and_the_ring_turns(wire: DemoLinkKind, bitrate: int, tmp_path: Path) -> None:
    async def scene(robot: DemoRobot) -> None:
        await asyncio.sleep(60)

    robot, snapshot = play(tmp_path, scene, wire=wire, bitrate=bitrate)
    for part in snapshot.parts:
        assert part.state == "active"
        assert part.slot == part.name
        assert part.beats in (59, 60)
        assert part.plug_in_to_active_ms is not None
        assert part.plug_in_to_active_ms < 1000
    for topic in snapshot.topics:
        assert topic.published in (59, 60)
        assert topic.delivered == topic.published
    assert [event for event in robot.events if event.to_state in ("late", "lost", "refused")] == []
    assert sum(snapshot.parts[1].outputs) == 1  # BB shows AA's last "turn-on N"


def test_a_pulled_part_is_late_then_lost_and_comes_back_through_both_steps(tmp_path: Path) -> None:
    async def scene(robot: DemoRobot) -> None:
        await asyncio.sleep(2.3)
        robot.unplug("BB")
        await asyncio.sleep(7)
        robot.plug("BB")
        await asyncio.sleep(2)

    robot, snapshot = play(tmp_path, scene)
    steps = [(event.from_state, event.to_state) for event in robot.events if event.part == "BB"]
    assert steps == [("checking", "active"), ("active", "late"), ("late", "lost"), ("checking", "active")]
    lost = next(event.at_s for event in robot.events if event.to_state == "lost")
    last_beat = 2.1  # BB beats once a second from about 0.1 s on
    assert 4.0 <= lost - last_beat <= 6.0
    assert "same UID" in next(event.reason for event in reversed(robot.events) if event.part == "BB")
    assert snapshot.parts[1].state == "active"


def test_all_parts_pulled_at_once_and_plugged_in_at_once_come_back(tmp_path: Path) -> None:
    async def scene(robot: DemoRobot) -> None:
        await asyncio.sleep(1)
        for name in robot.names:
            robot.unplug(name)
        await asyncio.sleep(10)
        assert {part.state for part in robot.snapshot().parts} == {"lost"}
        for name in robot.names:
            robot.plug(name)
        await asyncio.sleep(1)

    _, snapshot = play(tmp_path, scene)
    assert [part.state for part in snapshot.parts] == ["active"] * 3


def test_a_seeded_run_in_virtual_time_is_the_same_every_time(tmp_path: Path) -> None:
    async def scene(robot: DemoRobot) -> None:
        await asyncio.sleep(5)

    results = []
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        robot, snapshot = play(tmp_path / name, scene, seed=7)
        results.append((robot.events, snapshot))
    assert results[0] == results[1]


@pytest.mark.parametrize("bitrate", [125_000, 500_000])
def test_the_whole_set_up_of_a_client_over_can_is_ok_at_the_first_try_within_a_second(bitrate: int) -> None:
    """T8, where the thesis failed: CREATE_CLIENT, then participant to data writer, all statuses OK."""

    async def main() -> tuple[float, int]:
        loop = asyncio.get_running_loop()
        driver = SimBusDriver(SimBus(bitrate))
        agent = Agent(MemorySpace(), epoch_ns=lambda: 0, agent_id=bytes(8))
        agent.add_link(CanMasterLink(driver.attach("master"), profile_hash=0, random=Random(1)))
        client = Client(CanPartLink(driver.attach("part"), uid=b"thesis 1", random=Random(2)), key=THESIS_KEY)
        participant = client.create_participant("default_xrce_participant")
        topic = client.create_topic(participant, "HelloWorldTopic", "HelloWorld")
        client.create_reader(client.create_subscriber(participant), topic)
        client.create_writer(client.create_publisher(participant), topic)
        async with asyncio.TaskGroup() as tasks:
            running = [tasks.create_task(agent.run()), tasks.create_task(client.run())]
            started = loop.time()
            await client.connect(timeout_s=1.0)
            await client.until_all_statuses(timeout_s=1.0)
            took = loop.time() - started
            (view,) = agent.clients()
            for task in running:
                task.cancel()
        assert len(view.objects) == 6
        return took, client.counters.logins

    took_s, logins = run_virtual(main())
    assert took_s < 1.0
    assert logins == 1


def test_two_robots_with_the_same_parts_on_two_buses_stay_apart(tmp_path: Path) -> None:
    """R10, R11: a new robot is a copy of the files; what one part says is heard in its own robot only."""

    async def main() -> list[DemoSnapshot]:
        robots = []
        for name in ("one", "two"):
            (tmp_path / name).mkdir()
            blueprint, library = sample(tmp_path / name, X100Y100Z100=f"SERIAL-{name}")
            registry = open_registry(tmp_path / name / "robot.db")
            store = registry.runs.begin(registry.robots.apply_blueprint(blueprint, library))
            robots.append((DemoRobot(blueprint, store, random=Random(3), epoch_ns=lambda: 0), registry))
        async with asyncio.TaskGroup() as tasks:
            for robot, _ in robots:
                tasks.create_task(robot.run())
            await asyncio.sleep(10)
            robots[0][0].unplug("AA")
            await asyncio.sleep(10)
            for robot, _ in robots:
                robot.finish()
        for _, registry in robots:
            registry.close()
        return [robot.snapshot() for robot, _ in robots]

    one, two = run_virtual(main())
    assert [part.state for part in one.parts] == ["lost", "active", "active"]
    assert [part.state for part in two.parts] == ["active"] * 3
    assert one.topics[0].published < two.topics[0].published
