"""Scans, poses, strips and pictures of parts as genuine nodes have them, both ways."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from functools import partial
from math import pi
from pathlib import Path

import pytest

from msbot import Part
from msbot.config import load_library, parse_blueprint
from msbot.master import Master, robot_space
from msbot.operations.dispatch import InProcessOperations
from msbot.part.messages.message import Message, fields_of
from msbot.part.messages.standard import Colour, Picture, PixelFormat, Pose, Scan, Strip
from msbot.registry import open_registry
from msbot.ros.robot_in_ros import RobotInRos
from msbot_agent.link import InprocHub, LinkInfo
from msbot_agent.space import SharedSpace, parse_space
from tests.operations.stage import put_database
from tests.ros.genuine.node import Node
from tests.space.dds.peers import until

RED, DARK = Colour(red=255, green=1, blue=2), Colour(red=0, green=0, blue=0)
IMAGE = "sensor_msgs/msg/Image"
CASES: dict[str, tuple[Message, str, dict[str, object]]] = {
    "scan": (
        Scan(angle_min=-90.0, angle_step=45.0, reach=4.0, metres=[0.5, 1.0, 9.0]),
        "sensor_msgs/msg/LaserScan",
        {"angle_min": -pi / 2, "angle_increment": pi / 4, "range_max": 4.0, "ranges": [0.5, 1.0, 9.0]},
    ),
    "pose": (
        Pose(x=1.0, y=-2.5, degrees=90.0),
        "geometry_msgs/msg/Pose2D",
        {"x": 1.0, "y": -2.5, "theta": pi / 2},
    ),
    "strip": (
        Strip(colours=[RED, DARK]),
        IMAGE,
        {"width": 2, "height": 1, "encoding": "rgb8", "step": 6, "data": [255, 1, 2, 0, 0, 0]},
    ),
    "picture": (
        Picture(width=2, height=2, format=PixelFormat.MONO8, pixels=b"abcd"),
        IMAGE,
        {"width": 2, "height": 2, "encoding": "mono8", "step": 2, "data": [97, 98, 99, 100]},
    ),
}
"""By topic: our message, the type in ROS 2, and what it says there."""


def library_file(number: str, direction: str) -> str:
    ports = (
        f'[[port]]\nname = "{name}"\ndirection = "{direction}"\ntype = "{type(ours).type_name}"\n'
        for name, (ours, *_) in CASES.items()
    )
    return f'number = "{number}"\nname = "{number}"\n{"".join(ports)}'


ROBOT = """
[robot]
name = "ROVER"
[timing]
preset = "fast"
[[slot]]
name = "eye"
part = "EYE-1"
[[slot]]
name = "wall"
part = "WALL-1"
""" + "".join(
    f'[[binding]]\ntopic = "{name}"\ntype = "{type(ours).type_name}"\nfrom = "eye.{name}"\nto = ["wall.{name}"]\n'
    "ros = true\n"
    for name, (ours, *_) in CASES.items()
)


@contextlib.asynccontextmanager
async def robot_with(part: Part, folder: Path) -> AsyncIterator[None]:
    """A robot with one part as long as the block lasts."""
    (folder / "library").mkdir()
    (folder / "library" / "eye.toml").write_text(library_file("EYE-1", "publish"))
    (folder / "library" / "wall.toml").write_text(library_file("WALL-1", "subscribe"))
    library = load_library(folder / "library")
    blueprint = parse_blueprint(ROBOT, library)
    put_database(folder / "rover.db")
    with open_registry(folder / "rover.db") as registry, robot_space(parse_space("dds"), blueprint, library) as space:
        assert isinstance(space, SharedSpace)
        number = registry.robots.apply_blueprint(blueprint, library)
        master = Master(blueprint, registry.runs.begin(number), space=space, library=library)
        operations = InProcessOperations(master, registry, number, library=library)
        hub = InprocHub()
        hub.server.info = LinkInfo("wire", 65535)
        master.add_link(hub.server)
        shown = RobotInRos(master, operations, space)
        async with asyncio.TaskGroup() as tasks:
            running = [tasks.create_task(master.run()), tasks.create_task(shown.run())]
            await master.ready.wait()
            running.append(tasks.create_task(part.run_async(hub.connect())))
            await until(lambda: part.state.value == "active", "the part is active")
            yield
            for task in running:
                task.cancel()


async def test_a_node_hears_what_a_part_publishes(tmp_path: Path, node: Node) -> None:
    eye = Part("EYE-1")
    for name, (ours, *_) in CASES.items():
        eye.publishes(name, type(ours))
    async with robot_with(eye, tmp_path):
        for name, (ours, kind, theirs) in CASES.items():
            await node.does("listen", type=kind, name=f"/ROVER/{name}")
            heard: list[dict[str, object]] = []
            while not heard:  # what is published before both know of each other is heard by nobody
                eye.publish(name, ours)
                await asyncio.sleep(0.05)
                heard = await node.does("came_so_far", name=f"/ROVER/{name}")
            for field, value in theirs.items():
                assert heard[0][field] == (pytest.approx(value, abs=1e-6) if isinstance(value, float) else value)


async def test_a_part_hears_what_a_node_publishes(tmp_path: Path, node: Node) -> None:
    wall, heard = Part("WALL-1"), dict[str, Message]()
    for name, (ours, *_) in CASES.items():
        wall.on(name, type(ours))(partial(heard.__setitem__, name))
    async with robot_with(wall, tmp_path):
        for name, (ours, kind, theirs) in CASES.items():
            await node.does("publish", type=kind, name=f"/ROVER/{name}", messages=[theirs], period_s=0.1)
            await until(lambda name=name: name in heard, name)  # type: ignore[misc]
            for field in fields_of(type(ours)):
                told, said = getattr(heard[name], field.name), getattr(ours, field.name)
                assert told == (pytest.approx(said) if isinstance(said, float) else said)
