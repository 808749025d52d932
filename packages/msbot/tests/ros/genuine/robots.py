"""A robot with a knob at a master of its own, in this process, for genuine nodes to look at."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Mapping, Sequence
from pathlib import Path
from random import Random

from msbot.config import load_library, parse_blueprint
from msbot.master import Master, robot_space
from msbot.operations.dispatch import InProcessOperations
from msbot.recording.recorder.recorder import Recorder
from msbot.registry import open_registry
from msbot.ros.robot_in_ros import RobotInRos
from msbot.sim import SimulatedPart, make_simulator
from msbot_agent.link import InprocHub, LinkInfo
from msbot_agent.space import SharedSpace, Space, parse_space
from tests.operations.stage import put_database

LIBRARY = load_library()
ROBOT = """
[robot]
name = "{name}"
[timing]
preset = "fast"
[ros]
clock = true
{ros}
[[slot]]
name = "knob"
part = "POT-10K"
[[slot]]
name = "fan"
part = "FAN-5V"
[[binding]]
topic = "power"
type = "Level"
from = "knob.level"
to = ["fan.power"]
ros = true
{binding}
"""


class Robot:
    """A running robot."""

    def __init__(self, master: Master, space: SharedSpace, parts: Mapping[str, SimulatedPart]) -> None:
        self.master = master
        self.space = space
        self.parts = parts


@contextlib.asynccontextmanager
async def robot(
    folder: Path,
    name: str = "ROVER",
    *,
    space: str = "dds",
    binding: str = "",
    ros: str = "",
    parts: Sequence[str] = ("knob", "fan"),
    recorder: Recorder | None = None,
) -> AsyncIterator[Robot]:
    """A robot as long as the block lasts, with a knob and a fan."""
    blueprint = parse_blueprint(ROBOT.format(name=name, binding=binding, ros=ros), LIBRARY)
    place = folder / f"{name}.db"
    put_database(place)
    with open_registry(place) as registry, robot_space(parse_space(space), blueprint, LIBRARY) as shared:
        assert isinstance(shared, SharedSpace)
        used: Space = shared if recorder is None else recorder.space(shared)
        number = registry.robots.apply_blueprint(blueprint, LIBRARY)
        master = Master(blueprint, registry.runs.begin(number), space=used)
        operations = InProcessOperations(master, registry, number, library=LIBRARY)
        if recorder is not None:
            recorder.watch(master, operations)
        hub = InprocHub()
        hub.server.info = LinkInfo("wire", 65535)
        master.add_link(hub.server)
        shown = RobotInRos(master, operations, shared)
        async with asyncio.TaskGroup() as tasks:
            running = [tasks.create_task(master.run()), tasks.create_task(shown.run())]
            await master.ready.wait()
            made = {}
            for kind, slot in (("POT-10K", "knob"), ("FAN-5V", "fan")):
                if slot in parts:
                    uid = f"{slot:.<8}".encode()
                    made[slot] = make_simulator(kind, uid=uid, local_name=slot, random=Random(1), library=LIBRARY)
                    running.append(tasks.create_task(made[slot].part.run_async(hub.connect())))
            yield Robot(master, shared, made)
            for task in running:
                task.cancel()
