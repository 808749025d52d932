"""Whole robots on a bus of the kernel: both steps, the ring, loss, STOP (T10, T11, T14, R42)."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import replace
from pathlib import Path
from random import Random

import pytest

from msbot.config import load_blueprint, load_library, write_sample
from msbot.master import Master
from msbot.part import Part
from msbot.part.sample_parts import make_sample
from msbot.pnp import PartState
from msbot.registry import open_registry
from msbot_agent.link import Link, open_link
from tests.socketcan.bus import SETTINGS, cansend, listening, until

RING = ("AA", "BB", "CC")


class Robot:
    """The sample robot: its master, its parts, and what runs."""

    def __init__(self, master: Master, link: Link) -> None:
        self.master = master
        self.link = link
        self.links: dict[str, Link] = {}
        self.parts: dict[str, Part] = {}
        self._tasks: dict[str, asyncio.Task[None]] = {"master": asyncio.create_task(master.run())}

    def plug(self, name: str, address: str) -> None:
        """Switch a part on."""
        uid = name.encode().rjust(8, b"u")
        link = self.links[name] = open_link(address, can=replace(SETTINGS, uid=uid))
        part = self.parts[name] = make_sample(name, uid=uid, random=Random(name))
        self._tasks[name] = asyncio.create_task(part.run_async(link))

    async def pull(self, name: str) -> None:
        """Switch a part off without a word: its link is closed first."""
        task = self._tasks.pop(name)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)

    async def close(self) -> None:
        for name in list(self._tasks):
            await self.pull(name)

    def state(self, name: str) -> PartState | None:
        """How the part of that slot stands."""
        now = asyncio.get_running_loop().time()
        states = [info.state for info in self.master.inventory.view(now) if info.slot == name]
        return states[-1] if states else None

    async def until_active(self) -> None:
        """Wait for all parts."""
        await until(lambda: all(self.state(name) is PartState.ACTIVE for name in self.parts))

    async def until_turning(self) -> None:
        """Wait until each part has had messages of its predecessor, beyond those it had."""
        before = {name: part.counters.messages_in for name, part in self.parts.items()}
        await until(lambda: all(part.counters.messages_in > before[name] for name, part in self.parts.items()))


@asynccontextmanager
async def robot_on(address: str, folder: Path, *names: str) -> AsyncIterator[Robot]:
    """The sample robot with these parts plugged in; its master is up."""
    write_sample(folder / "robot.toml")
    library = load_library()
    blueprint = load_blueprint(folder / "robot.toml", library)
    with open_registry(folder / "robot.db") as registry:
        master = Master(blueprint, registry.runs.begin(registry.robots.apply_blueprint(blueprint, library)))
        can = replace(SETTINGS, profile_hash=master.profile.profile_hash())
        link = open_link(address, serve=True, can=can)
        master.add_link(link)
        robot = Robot(master, link)
        try:
            async with asyncio.timeout(60):
                await master.ready.wait()
            for name in names:
                robot.plug(name, address)
            yield robot
        finally:
            await robot.close()


ADDRESSES = ["can:vcan0", "can:vcan0?compression=0", "can:vcan0?fd=1", "can:vcan0?fd=1&compression=0"]


@pytest.mark.parametrize("address", ADDRESSES)
async def test_three_parts_join_by_themselves_and_the_ring_turns(address: str, tmp_path: Path) -> None:
    async with listening("can:vcan0?fd=1") as ear, robot_on(address, tmp_path, *RING) as robot:
        await robot.until_active()
        await robot.until_turning()
        for link in (robot.link, *robot.links.values()):
            assert link.counters.dropped == {}
        for part in robot.parts.values():
            assert (part.counters.dropped, part.counters.not_sent, part.counters.handler_errors) == (0, 0, 0)
        assert {frame.fd for frame in ear.frames if 0x100 < frame.can_id < 0x200} == {"fd=1" in address}


async def test_a_robot_turns_beside_other_traffic_and_counts_none_of_it_as_damage(tmp_path: Path) -> None:
    """Somebody floods the bus with everything but our identifiers, as fast as it takes them."""
    async with robot_on("can:vcan0", tmp_path, *RING) as robot, listening("can:vcan1"):
        flood = await asyncio.create_subprocess_exec("cangen", "vcan0", "-g", "1", "-I", "0x7f0", "-L", "8")
        try:
            await robot.until_active()
            await cansend("vcan0", "00000101#C0", "181#R3", "101#R3")
            await robot.until_turning()
        finally:
            flood.terminate()
            await flood.wait()
        for link in (robot.link, *robot.links.values()):
            assert link.counters.dropped == {}


async def test_a_pulled_part_is_lost_and_comes_back_as_the_same(tmp_path: Path) -> None:
    async with robot_on("can:vcan0", tmp_path, *RING) as robot:
        await robot.until_active()
        await robot.pull("BB")
        await until(lambda: robot.state("BB") is not PartState.ACTIVE)
        robot.plug("BB", "can:vcan0")
        await robot.until_active()
        await robot.until_turning()


@pytest.mark.usefixtures("vcan0")
@pytest.mark.parametrize("address", ["can:vcan0", "can:vcan0?fd=1"])
async def test_a_bus_that_loses_frames_delays_the_robot_and_nothing_worse(address: str, tmp_path: Path) -> None:
    """netem takes 3 % of all frames away, of every kind."""
    tool = await asyncio.create_subprocess_shell("tc qdisc replace dev vcan0 root netem loss 3%")
    assert await tool.wait() == 0
    async with robot_on(address, tmp_path, *RING) as robot:
        await robot.until_active()
        for _ in range(3):
            await robot.until_turning()
        assert [part.counters.handler_errors for part in robot.parts.values()] == [0, 0, 0]
