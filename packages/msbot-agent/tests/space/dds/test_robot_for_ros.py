"""A robot with a part, as a ROS 2 node in another process sees it over DDS."""

from __future__ import annotations

import asyncio
import json
import sys
from pathlib import Path
from random import Random

import pytest

from msbot.config import Library, load_blueprint, load_library
from msbot.master import Master, robot_space
from msbot.operations.dispatch import InProcessOperations
from msbot.registry import open_registry
from msbot.ros.robot_in_ros import RobotInRos, read_description
from msbot.sim import make_simulator
from msbot_agent.link import InprocHub, LinkInfo
from msbot_agent.space import SharedSpace, parse_space
from tests import ROOT
from tests.operations.stage import put_database
from tests.space.dds.foreign_programs import SOURCES
from tests.space.dds.peers import program, until

NODE = (sys.executable, str(SOURCES / "ros_node.py"))
KNOB = "/ROVER/knob"
EXAMPLE = ROOT / "examples/ros2/robot.toml"


@pytest.fixture(scope="module")
def library() -> Library:
    return load_library()


async def test_a_ros_node_finds_the_part_and_reads_and_sets_its_parameters(tmp_path: Path, library: Library) -> None:
    pytest.importorskip("cyclonedds")
    blueprint = load_blueprint(EXAMPLE, library)
    put_database(tmp_path / "robot.db")
    with (
        open_registry(tmp_path / "robot.db") as registry,
        robot_space(parse_space("dds"), blueprint, library) as space,
    ):
        assert isinstance(space, SharedSpace)
        robot = registry.robots.apply_blueprint(blueprint, library)
        master = Master(blueprint, registry.runs.begin(robot), space=space)
        operations = InProcessOperations(master, registry, robot, library=library)
        hub = InprocHub()
        hub.server.info = LinkInfo("wire", 65535)
        master.add_link(hub.server)
        part = make_simulator("POT-10K", uid=b"A KNOB..", local_name="knob", random=Random(1), library=library).part
        ros = RobotInRos(master, operations, space, description=read_description(blueprint))
        async with asyncio.TaskGroup() as tasks:
            running = [tasks.create_task(master.run()), tasks.create_task(ros.run())]
            await master.ready.wait()
            plugged = tasks.create_task(part.run_async(hub.connect()))
            wishes = json.dumps(
                {
                    "parameters": [
                        ["period_s", {"type": 3, "double_value": 0.5}],
                        ["period_s", {"type": 3, "double_value": 99.0}],
                    ]
                }
            )
            async with program(
                *NODE,
                "nodes",
                KNOB,
                "rt/ROVER/power",
                "nodes",
                "/ROVER",
                "rt/ROVER/robot_description",
                "hear",
                "ROVER/power",
                "Float32",
                "1",
                "hear",
                "ROVER/diagnostics",
                "DiagnosticArray",
                "1",
                "hear",
                "ROVER/clock",
                "Clock",
                "1",
                "hear",
                "ROVER/robot_description",
                "String",
                "1",
                "call",
                KNOB,
                "list_parameters",
                '{"prefixes": [], "depth": 0}',
                "call",
                KNOB,
                "set_parameters",
                wishes,
                "call",
                KNOB,
                "get_parameters",
                '{"names": ["period_s"]}',
                "gone",
                KNOB,
            ) as node:
                await node.says("get_parameters: ")
                assert f"{KNOB} writes rt/ROVER/power std_msgs::msg::dds_::Float32_" in node.lines
                assert (
                    f"{KNOB} reads rq{KNOB}/set_parametersRequest rcl_interfaces::srv::dds_::SetParameters_Request_"
                ) in node.lines
                assert "/ROVER writes rt/ROVER/diagnostics diagnostic_msgs::msg::dds_::DiagnosticArray_" in node.lines
                assert "/ROVER writes rt/ROVER/robot_description std_msgs::msg::dds_::String_" in node.lines
                told = json.loads((await node.says("ROVER/diagnostics: ")).partition(" ")[2])
                assert [(one["name"], one["level"]) for one in told["status"]] == [("ROVER", 0), ("ROVER: knob", 0)]
                told = json.loads((await node.says("ROVER/robot_description: ")).partition(" ")[2])
                assert told["data"] == EXAMPLE.with_name("rover.urdf").read_text()
                assert '"period_s", "change"' in await node.says("list_parameters: ")
                results = json.loads((await node.says("set_parameters: ")).partition(" ")[2])["results"]
                assert [one["successful"] for one in results] == [True, False]
                assert results[1]["reason"] == "period_s: is 99.0; it must be 0.02 to 60 s"
                assert '"double_value": 0.5' in await node.says("get_parameters: ")
                await until(lambda: part.settings["period_s"] == "0.5")
                plugged.cancel()
                await node.says(f"node {KNOB} is gone")
            for task in running:
                task.cancel()
