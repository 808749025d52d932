"""A robot of two slots in virtual time: a simulated part, and a desk that has the opposite of each of its ports."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field, replace
from random import Random

from msbot.config import (
    Blueprint,
    Direction,
    PartType,
    Port,
    RobotProfile,
    Scalar,
    Slot,
    load_library,
    scalar_text,
)
from msbot.master import Master
from msbot.part import JoinState, Message, Part
from msbot.part.messages.message import fields_of
from msbot.pnp import Configuration, MemoryStore, SlotBinding
from msbot.process.virtual_time import run_virtual
from msbot.sim import SimulatedPart, make_simulator, message_class
from msbot.sim.model_part import message_of
from msbot_agent.link import InprocHub
from msbot_agent.space import Qos, Sample, Topic

LIBRARY = load_library()
PROFILE = RobotProfile("R", "1", "2", "3", "4")


@dataclass
class Bench:
    """What a test has in its hands."""

    unit: SimulatedPart
    desk: Part
    part_type: PartType
    heard: dict[str, list[Message]] = field(default_factory=dict)
    """Messages of the part, by port."""
    end_master: Callable[[], object] = lambda: None
    _master: Master | None = None

    @property
    def master(self) -> Master:
        """The robot's master."""
        assert self._master is not None
        return self._master

    def send(self, port: str, **fields: Scalar) -> None:
        """Have the desk say something to a port of the part."""
        found = self.part_type.port(port)
        assert found is not None
        assert found.message is not None
        assert self.desk.publish(port, message_of(found.message, fields))

    def last(self, port: str) -> dict[str, object]:
        """The fields of the part's latest message at a port."""
        message = self.heard[port][-1]
        return {entry.name: getattr(message, entry.name) for entry in fields_of(type(message))}


def blueprint_for(part_type: PartType) -> Blueprint:
    """A robot with the part and the desk."""
    return Blueprint(PROFILE, (Slot("unit", part_type.number), Slot("desk", "DESK")))


def store_for(part_type: PartType, settings: Mapping[str, Scalar]) -> MemoryStore:
    """Slots and configurations of both: each port of the part is bound to the desk's port of the same name."""
    values = {parameter.name: parameter.default for parameter in part_type.parameters} | dict(settings)
    unit = tuple(
        SlotBinding(port.name, f"topic/{port.name}", port.type_name, publishes=port.direction is Direction.PUBLISH)
        for port in part_type.ports
    )
    desk = tuple(replace(wire, publishes=not wire.publishes) for wire in unit)
    return MemoryStore(
        types=(PartType(part_type.number, part_type.name), PartType("DESK", "Desk")),
        slots=(Slot("unit", part_type.number), Slot("desk", "DESK")),
        configurations=(
            Configuration(1, "unit", unit, tuple((name, scalar_text(value)) for name, value in values.items())),
            Configuration(1, "desk", desk),
        ),
    )


def play(
    number: str | PartType,
    scene: Callable[[Bench], Awaitable[None]],
    settings: Mapping[str, Scalar] | None = None,
) -> Bench:
    """Run a part of that number through a scene, which begins when both are active."""
    part_type = number if isinstance(number, PartType) else LIBRARY.get(number)
    assert part_type is not None
    found = part_type

    async def main() -> Bench:
        unit = make_simulator(found, uid=b"the unit", random=Random(1))
        bench = Bench(unit, Part("DESK", uid=b"the desk", random=Random(2)), found)
        master = Master(blueprint_for(found), store_for(found, settings or {}), random=Random(3), epoch_ns=lambda: 0)
        bench._master = master
        for port in found.ports:
            if port.direction is Direction.PUBLISH:
                listen(master, port, bench.heard.setdefault(port.name, []))
        hub = InprocHub()
        master.add_link(hub.server)
        async with asyncio.TaskGroup() as tasks:
            running = tasks.create_task(master.run())
            await master.ready.wait()
            bench.end_master = running.cancel
            parts = [
                tasks.create_task(part.run_async(hub.connect(), epoch_ns=lambda: 0)) for part in (bench.desk, unit.part)
            ]
            await asyncio.sleep(1)
            assert unit.part.state is bench.desk.state is JoinState.ACTIVE
            await scene(bench)
            for task in (*parts, running):
                task.cancel()
        return bench

    return run_virtual(main())


def listen(master: Master, port: Port, heard: list[Message]) -> None:
    """Note what is published: in the data space, because a part that is stopped hears nothing."""
    assert port.message is not None
    message_type = message_class(port.message)

    def note(sample: Sample) -> bool:
        heard.append(message_type.decode(sample.payload))
        return True

    master.space.reader(Topic(f"topic/{port.name}", message_type.type_name), Qos(reliable=False), note)
