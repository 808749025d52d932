"""Topics and services whose types are in the package that `msbot library ros-package` writes.

The genuine tools build the package, and a genuine node imports it, hears the part of the robot, speaks to it, calls it
and is called by it.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from typing import Any

import pytest

from msbot import CallError, Message, Part
from msbot.cli.ros_package import package_files, write_package
from msbot.config import Library, load_library, parse_blueprint
from msbot.master import Master, robot_space
from msbot.operations.dispatch import InProcessOperations
from msbot.part.messages.ros_names import PACKAGE
from msbot.registry import open_registry
from msbot.ros.robot_in_ros import RobotInRos
from msbot.ros2.forms import form_of
from msbot.ros2.service_forms import service_form
from msbot.sim.model_part import message_class
from msbot_agent.link import InprocHub, LinkInfo
from msbot_agent.space import SharedSpace, parse_space
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
[[port]]
name = "reach"
direction = "serve"
request = "arm-pose"
reply = "Answer"
[[port]]
name = "ask"
direction = "call"
request = "arm-pose"
reply = "arm-pose"
[[type]]
name = "Mode"
enum = ["off", "slow", "fast"]
[[type]]
name = "Joint"
fields = { degrees = "float32", mode = "Mode" }
[[type]]
name = "Answer"
fields = { success = "bool", message = "text", joints = "Joint[<=3]" }
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
[[binding]]
topic = "reach"
type = "arm-pose -> Answer"
from = "arm.reach"
to = []
ros = true
ros_type = "msbot_msgs/srv/ArmPoseToAnswer"
[[binding]]
topic = "door"
type = "arm-pose -> arm-pose"
from = ""
to = ["arm.ask"]
ros = true
ros_type = "msbot_msgs/srv/ArmPoseToArmPose"
ros_topic = "/door"
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
    own = {name: library.messages[name] for name in ("Joint", "arm-pose", "Answer")}
    write_package(package_files(Library([library.require("ARM-9")], own)), folder / PACKAGE)
    return built(folder / PACKAGE)


@pytest.fixture(scope="module", params=MIDDLEWARES)
def peer(request: pytest.FixtureRequest, network: int, installed: Path) -> Iterator[Node]:
    """A genuine node that has the package."""
    with inside(network):
        node = Node("peer", middleware=request.param, **with_package(installed))
    yield node
    node.end()


def serve_and_call(part: Part, library: Library) -> None:
    """The arm answers with the joints that it was asked for; one that shall not be up refuses."""
    pose, answer = (message_class(library.messages[name]) for name in ("arm-pose", "Answer"))
    part.calls("ask", pose, pose)

    @part.serves("reach", pose, answer)
    def reach(request: Any) -> Message:
        if not request.isUp:
            raise CallError("it stays up")
        return answer(success=True, message=request.name, joints=request.joints[:2])


@contextlib.asynccontextmanager
async def arm(folder: Path, library: Library) -> AsyncIterator[tuple[Master, Part, list[Message]]]:
    """A robot with an arm as long as the block lasts, and what the arm hears."""
    blueprint = parse_blueprint(ROBOT, library)
    put_database(folder / "rover.db")
    with open_registry(folder / "rover.db") as registry, robot_space(parse_space("dds"), blueprint, library) as space:
        assert isinstance(space, SharedSpace)
        number = registry.robots.apply_blueprint(blueprint, library)
        master = Master(blueprint, registry.runs.begin(number), space=space, library=library)
        shown = RobotInRos(master, InProcessOperations(master, registry, number, library=library), space)
        hub = InprocHub()
        hub.server.info = LinkInfo("wire", 65535)
        master.add_link(hub.server)
        heard: list[Message] = []
        part = Part("ARM-9")
        part.on("wish", message_class(library.messages["arm-pose"]))(heard.append)
        serve_and_call(part, library)
        async with asyncio.TaskGroup() as tasks:
            running = [tasks.create_task(master.run()), tasks.create_task(shown.run())]
            await master.ready.wait()
            running.append(tasks.create_task(part.run_async(hub.connect())))
            await until(lambda: part.bound("pose"))
            yield master, part, heard
            for task in running:
                task.cancel()


async def test_a_genuine_node_and_a_part_exchange_a_type_of_the_library(node: Node, tmp_path: Path) -> None:
    library = of_arm(tmp_path)
    pose = message_class(library.messages["arm-pose"])
    joint = message_class(library.messages["Joint"])
    async with arm(tmp_path, library) as (_, part, heard):
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
        both = [wrong, {**SAID, "name": "next"}]
        # Again and again: that the node knows of the robot does not say that the robot knows of its new publisher.
        await node.does("publish", type=TYPE, name="/ROVER/wish", messages=both, period_s=0.05, until=1)
        await until(lambda: [one for one in heard if one.name == "next"][2:])  # type: ignore[attr-defined]
        assert [one for one in heard[before:] if one.mode == 7] == [], "no number of the enum"  # type: ignore[attr-defined]


async def test_a_genuine_node_calls_a_service_of_the_library(node: Node, tmp_path: Path) -> None:
    kind = "msbot_msgs/srv/ArmPoseToAnswer"
    library = of_arm(tmp_path)
    async with arm(tmp_path, library) as (master, _, _heard):
        assert (await node.does("services_of", name="arm", namespace="/ROVER"))["/ROVER/reach"] == [kind]
        told = await node.does("call", type=kind, name="/ROVER/reach", request=SAID)
        assert told["response"] == {"success": True, "message": "left", "joints": SAID["joints"][:2]}  # type: ignore[index]
        ours = await node.does("service_ends", name="/ROVER/reach")
        await node.does("serve", type=kind, name="/theirs/reach")
        theirs = await node.does("service_ends", name="/theirs/reach")
        assert len(ours) == len(theirs) == 2
        assert ours == theirs, "genuine ROS 2 gives both messages the same hashes"
        pose, answer = (message_class(library.messages[one]) for one in ("arm-pose", "Answer"))
        form = service_form(pose, answer, kind)
        assert [one["hash"] for one in ours] == [f"RIHS01_{one.type_hash}" for one in (form.request, form.reply)]
        refused = await node.does("call", type=kind, name="/ROVER/reach", request={**SAID, "is_up": False})
        why = "call of arm.reach: refused: it stays up"
        assert refused["response"] == {"success": False, "message": why, "joints": []}
        master.say_stop("ann")
        await until(lambda: master.stop.stopped, "STOP")
        stopped = await node.does("call", type=kind, name="/ROVER/reach", request=SAID)
        assert stopped["response"]["message"] == "call of arm.reach: STOP is in force: call again after GO"


async def test_a_part_calls_a_service_of_the_library_at_a_genuine_node(node: Node, tmp_path: Path) -> None:
    kind, library = "msbot_msgs/srv/ArmPoseToArmPose", of_arm(tmp_path)
    pose = message_class(library.messages["arm-pose"])
    await node.does("serve", type=kind, name="/door", reply=SAID)
    async with arm(tmp_path, library) as (_, part, _heard):
        answers: list[object] = []
        while not [one for one in answers if isinstance(one, pose)]:  # until both sides know of each other
            before = len(answers)
            part.call("ask", pose(name="me"), timeout=0.5, on_reply=lambda *both: answers.append(both[0] or both[1]))
            await until(lambda before=before: len(answers) > before, "the end of the call")  # type: ignore[misc]
        assert (answers[-1].name, answers[-1].marks) == ("left", [1, 65535])  # type: ignore[attr-defined]
