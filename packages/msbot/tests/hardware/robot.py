"""A robot in virtual time: a part with a driver, and a desk that has the opposite of each of its ports."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

from msbot.config import Direction, PartType, Scalar
from msbot.hardware import HardwarePart, HardwareParts, Machine, PartWiring, make_wiring
from msbot.master import Master
from msbot.part import JoinState, Message, Part
from msbot.part.messages.message import fields_of
from msbot.process.virtual_time import run_virtual
from msbot.sim import message_class
from msbot_agent.link import InprocHub, Link
from tests.hardware.chips import Bus
from tests.sim.robot import LIBRARY, blueprint_for, listen, store_for


@dataclass
class Bench:
    """What a test has in its hands."""

    unit: HardwarePart
    desk: Part
    part_type: PartType
    master: Master
    running: asyncio.Task[None]
    heard: dict[str, list[Message]] = field(default_factory=dict)

    def send(self, port: str, **fields: Scalar) -> None:
        """Have the desk say something to a port of the part."""
        found = self.part_type.port(port)
        assert found is not None
        assert found.message is not None
        assert self.desk.publish(port, message_class(found.message)(**fields))

    async def until(self, condition: Callable[[], object]) -> None:
        """Wait until something is so."""
        async with asyncio.timeout(300):
            while not condition():  # noqa: ASYNC110 - in virtual time, and about things that tell nobody
                await asyncio.sleep(0.02)

    async def until_active(self) -> None:
        """Wait until the part is in the robot."""
        await self.until(lambda: self.unit.part.state is JoinState.ACTIVE)

    async def until_gone(self) -> None:
        """Wait until the part has left the robot."""
        await self.until(lambda: self.unit.part.state is not JoinState.ACTIVE)

    def last(self, port: str) -> dict[str, object]:
        """The fields of the part's latest message at a port."""
        message = self.heard[port][-1]
        return {entry.name: getattr(message, entry.name) for entry in fields_of(type(message))}


def machine_at(root: Path, bus: Bus | None = None) -> Machine:
    """A computer whose /sys and /dev are below a folder, and whose chips do not need time."""
    return Machine(root=root, open_i2c=lambda _: bus or Bus(), wait=lambda _: None, keeper=[])


def play(
    number: str,
    machine: Machine,
    scene: Callable[[Bench], Awaitable[None]],
    *,
    settings: Mapping[str, Scalar] | None = None,
    wiring: PartWiring | None = None,
    joins: bool = True,
    around: Callable[[Link], Link] = lambda link: link,
) -> Bench:
    """Run a part of that number through a scene, which begins when it is active; `around` wraps its link."""
    part_type = LIBRARY.require(number)

    async def main() -> Bench:
        workbench = HardwareParts(machine)
        unit = workbench.make(part_type, wiring or make_wiring(part_type))
        unit.part.uid = b"the unit"
        desk = Part("DESK", uid=b"the desk", random=Random(2))
        master = Master(
            blueprint_for(part_type), store_for(part_type, settings or {}), random=Random(3), epoch_ns=lambda: 0
        )
        hub = InprocHub()
        master.add_link(hub.server)
        async with asyncio.TaskGroup() as tasks:
            running = tasks.create_task(master.run())
            await master.ready.wait()
            bench = Bench(unit, desk, part_type, master, running)
            for port in part_type.ports:
                if port.direction is Direction.PUBLISH and port.message is not None:
                    listen(master, port, bench.heard.setdefault(port.name, []))
            at_desk = tasks.create_task(desk.run_async(hub.connect(), epoch_ns=lambda: 0))
            at_work = tasks.create_task(unit.run(lambda: around(hub.connect())))
            if joins:
                await bench.until_active()
            await scene(bench)
            unit.end()
            await at_work
            at_desk.cancel()
            running.cancel()
        workbench.end()
        return bench

    return run_virtual(main())


__all__ = ["Bench", "machine_at", "play"]
