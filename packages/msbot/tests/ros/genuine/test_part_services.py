"""Services of parts as genuine nodes see and call them, and services of genuine nodes as parts call them."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from pathlib import Path

from msbot import CallError, Part, Switch, Text
from msbot.config import Library, load_library, parse_blueprint
from msbot.master import Master, robot_space
from msbot.operations.dispatch import InProcessOperations
from msbot.registry import open_registry
from msbot.ros.robot_in_ros import RobotInRos
from msbot.sim.model_part import message_class
from msbot_agent.link import InprocHub, LinkInfo
from msbot_agent.space import SharedSpace, parse_space
from tests.operations.stage import put_database
from tests.ros.genuine.node import Node
from tests.space.dds.peers import until

LAMP = """
number = "LAMP-1"
name = "Lamp"
[[port]]
name = "light"
direction = "serve"
request = "Switch"
reply = "Text"
[[port]]
name = "mix"
direction = "serve"
request = "Basics"
reply = "Basics"
[[port]]
name = "ask"
direction = "call"
request = "Switch"
reply = "Text"
[[type]]
name = "Basics"
[type.fields]
bool_value = "bool"
byte_value = "uint8"
char_value = "uint8"
float32_value = "float32"
float64_value = "float64"
int8_value = "int8"
uint8_value = "uint8"
int16_value = "int16"
uint16_value = "uint16"
int32_value = "int32"
uint32_value = "uint32"
int64_value = "int64"
uint64_value = "uint64"
string_value = "text"
"""
ROBOT = """
[robot]
name = "ROVER"
[timing]
preset = "fast"
[[slot]]
name = "lamp"
part = "LAMP-1"
[[binding]]
topic = "light"
type = "Switch -> Text"
from = "lamp.light"
to = []
ros = true
[[binding]]
topic = "mix"
type = "Basics -> Basics"
from = "lamp.mix"
to = []
ros = true
ros_type = "test_msgs/srv/BasicTypes"
[[binding]]
topic = "door"
type = "Switch -> Text"
from = ""
to = ["lamp.ask"]
ros = true
ros_topic = "/door"
"""
SET_BOOL = "std_srvs/srv/SetBool"


def lamp_part(library: Library) -> Part:
    basics = message_class(library.messages["Basics"])
    part = Part("LAMP-1")
    part.calls("ask", Switch, Text)

    @part.serves("light", Switch, Text)
    def light(request: Switch) -> Text:
        if not request.on:
            raise CallError("it stays on tonight")
        return Text(text="it is on")

    part.serves("mix", basics, basics)(lambda request: request)
    return part


@contextlib.asynccontextmanager
async def lamp(folder: Path) -> AsyncIterator[tuple[Master, Part, asyncio.Task[None]]]:
    """A robot with a lamp as long as the block lasts."""
    (folder / "library").mkdir()
    (folder / "library" / "LAMP-1.toml").write_text(LAMP)
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
        part = lamp_part(library)
        async with asyncio.TaskGroup() as tasks:
            running = [tasks.create_task(master.run()), tasks.create_task(shown.run())]
            await master.ready.wait()
            running.append(tasks.create_task(part.run_async(hub.connect())))
            await until(lambda: part.state.value == "active", "the lamp is active")
            yield master, part, running[-1]
            for task in running:
                task.cancel()


async def test_a_node_lists_and_calls_the_service_of_a_part(tmp_path: Path, node: Node) -> None:
    async with lamp(tmp_path) as (master, _, running):
        assert (await node.does("services_of", name="lamp", namespace="/ROVER"))["/ROVER/light"] == [SET_BOOL]
        await node.does("listen", type="rcl_interfaces/msg/Log", name="/rosout")

        async def switched(*, on: bool) -> object:
            told = await node.does("call", type=SET_BOOL, name="/ROVER/light", request={"data": on})
            return told["response"]

        assert await switched(on=True) == {"success": True, "message": "it is on"}
        refused = "call of lamp.light: refused: it stays on tonight"
        assert await switched(on=False) == {"success": False, "message": refused}
        (line,) = [one for one in await node.does("came", name="/rosout") if one["name"] == "ROVER.lamp"]
        assert (line["level"], line["msg"]) == (40, f"request of ROS 2 to /ROVER/light: {refused}")
        master.say_stop("ann")
        stopped = {"success": False, "message": "call of lamp.light: STOP is in force: call again after GO"}
        await until(lambda: master.stop.stopped, "STOP")
        assert await switched(on=True) == stopped
        master.say_go("ann")
        running.cancel()
        await node.does("service_gone", name="/ROVER/light")


async def test_a_type_that_msbot_does_not_know_has_the_fields_of_ours(tmp_path: Path, node: Node) -> None:
    wished = {
        "bool_value": True,
        "int8_value": -8,
        "uint16_value": 65535,
        "int64_value": -(2**62),
        "float64_value": 0.1,
        "string_value": "grün",
    }
    async with lamp(tmp_path):
        told = await node.does("call", type="test_msgs/srv/BasicTypes", name="/ROVER/mix", request=wished)
        assert {name: told["response"][name] for name in wished} == wished


async def test_a_part_calls_the_service_of_a_node(tmp_path: Path, node: Node) -> None:
    await node.does("serve", type=SET_BOOL, name="/door")
    heard: list[object] = []
    async with lamp(tmp_path) as (master, part, _):

        async def ask() -> object:
            before = len(heard)
            part.call("ask", Switch(on=True), timeout=0.5, on_reply=lambda reply, error: heard.append(reply or error))
            await until(lambda: len(heard) > before, "the end of the call")
            return heard[-1]

        while await ask() != Text(text='{"data": true}'):
            pass  # until both sides know of each other: a call that nobody serves ends after at most its timeout
        master.say_stop("ann")
        await until(lambda: master.stop.stopped, "STOP")
        assert await ask() == "call of ask: STOP is in force: call again after GO"
