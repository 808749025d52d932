"""A topic whose type is in the package that `msbot library ros-package` writes.

The genuine tools build the package, and a genuine node imports it, hears the part of the robot, and speaks to it.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Iterator
from pathlib import Path

import pytest

from msbot import Message, Part
from msbot.cli.ros_package import package_files, write_package
from msbot.config import Library, load_library, parse_blueprint
from msbot.master import Master, robot_space
from msbot.part.messages.ros_names import PACKAGE
from msbot.registry import open_registry
from msbot.ros2.forms import form_of
from msbot.sim.model_part import message_class
from msbot_agent.link import InprocHub, LinkInfo
from msbot_agent.space import parse_space
from tests.operations.stage import put_database
from tests.ros.genuine.environment import MIDDLEWARES, built, with_package
from tests.ros.genuine.node import Node
from tests.space.dds.peers import until
from tests.space.own_network import inside

ARM = """
number = "ARM-9"
name = "Arm"
[[port]]
name = "pose"
direction = "publish"
type = "arm-pose"
[[port]]
name = "wish"
direction = "subscribe"
type = "arm-pose"
[[type]]
name = "Mode"
enum = ["off", "slow", "fast"]
[[type]]
name = "Joint"
fields = { degrees = "float32", mode = "Mode" }
[[type]]
name = "arm-pose"
fields = { isUp = "bool", mode = "Mode", joints = "Joint[3]", marks = "uint16[<=4]", name = "text<=8", at = "float64" }
"""
ROBOT = """
[robot]
name = "ROVER"
[timing]
preset = "fast"
[[slot]]
name = "arm"
part = "ARM-9"
[[binding]]
topic = "pose"
type = "arm-pose"
from = "arm.pose"
to = []
ros = true
ros_type = "msbot_msgs/msg/ArmPose"
[[binding]]
topic = "wish"
type = "arm-pose"
from = ""
to = ["arm.wish"]
ros = true
ros_type = "msbot_msgs/ArmPose"
"""
TYPE = "msbot_msgs/msg/ArmPose"
SAID = {
    "is_up": True,
    "mode": 2,
    "joints": [{"degrees": 1.5, "mode": 0}, {"degrees": -2.5, "mode": 1}, {"degrees": 0.0, "mode": 2}],
    "marks": [1, 65535],
    "name": "left",
    "at": 0.25,
}


def of_arm(folder: Path) -> Library:
    """The library; a package of only its own types is built in a few seconds."""
    (folder / "library").mkdir()
    (folder / "library" / "ARM-9.toml").write_text(ARM)
    return load_library(folder / "library")


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("package")
    library = of_arm(folder)
    own = {name: library.messages[name] for name in ("Joint", "arm-pose")}
    write_package(package_files(Library((), own)), folder / PACKAGE)
    return built(folder / PACKAGE)


@pytest.fixture(scope="module", params=MIDDLEWARES)
def peer(request: pytest.FixtureRequest, network: int, installed: Path) -> Iterator[Node]:
    """A genuine node that has the package."""
    with inside(network):
        node = Node("peer", middleware=request.param, **with_package(installed))
    yield node
    node.end()


@contextlib.asynccontextmanager
async def arm(folder: Path, library: Library) -> AsyncIterator[tuple[Part, list[Message]]]:
    """A robot with an arm as long as the block lasts, and what the arm hears."""
    blueprint = parse_blueprint(ROBOT, library)
    put_database(folder / "rover.db")
    with open_registry(folder / "rover.db") as registry, robot_space(parse_space("dds"), blueprint, library) as space:
        number = registry.robots.apply_blueprint(blueprint, library)
        master = Master(blueprint, registry.runs.begin(number), space=space, library=library)
        hub = InprocHub()
        hub.server.info = LinkInfo("wire", 65535)
        master.add_link(hub.server)
        heard: list[Message] = []
        part = Part("ARM-9")
        part.on("wish", message_class(library.messages["arm-pose"]))(heard.append)
        async with asyncio.TaskGroup() as tasks:
            running = [tasks.create_task(master.run())]
            await master.ready.wait()
            running.append(tasks.create_task(part.run_async(hub.connect())))
            await until(lambda: part.bound("pose"))
            yield part, heard
            for task in running:
                task.cancel()


async def test_a_genuine_node_and_a_part_exchange_a_type_of_the_library(node: Node, tmp_path: Path) -> None:
    library = of_arm(tmp_path)
    pose = message_class(library.messages["arm-pose"])
    joint = message_class(library.messages["Joint"])
    async with arm(tmp_path, library) as (part, heard):
        await node.does("listen", type=TYPE, name="/ROVER/pose")
        (told,) = await node.does("publishers", name="/ROVER/pose")
        assert told["type"] == TYPE
        assert told["hash"] == f"RIHS01_{form_of(pose, TYPE).type_hash}"
        mode = type(joint().mode)  # type: ignore[attr-defined]  # the library's enum
        joints = [joint(degrees=angle, mode=mode(place)) for place, angle in enumerate((1.5, -2.5, 0.0))]
        said = pose(isUp=True, mode=mode(2), joints=joints, marks=[1, 65535], name="left", at=0.25)
        while not await node.does("came_so_far", name="/ROVER/pose"):
            part.publish("pose", said)
            await asyncio.sleep(0.05)
        assert (await node.does("came", name="/ROVER/pose"))[0] == SAID
        await node.does("publish", type=TYPE, name="/ROVER/wish", messages=[SAID], period_s=0.05, until=1)
        (theirs,) = await node.does("publishers", name="/ROVER/wish")
        assert theirs["hash"] == told["hash"], "genuine ROS 2 gives the type the same hash"
        await until(lambda: bool(heard))
        assert heard[0] == said
        await node.does("forget")
        wrong = {**SAID, "mode": 7}
        before = len(heard)
        await node.does("publish", type=TYPE, name="/ROVER/wish", messages=[wrong, {**SAID, "name": "next"}], until=1)
        await until(lambda: heard[-1].name == "next")  # type: ignore[attr-defined]
        assert [one for one in heard[before:] if one.mode == 7] == [], "no number of the enum"  # type: ignore[attr-defined]
