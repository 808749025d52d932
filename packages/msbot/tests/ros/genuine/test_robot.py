"""Robots as genuine nodes of ROS 2 see them: their nodes, topics and parameters, each in its own namespace."""

from __future__ import annotations

from pathlib import Path

import pytest

from msbot_agent.space.dds.ros_type_hashes import ROS_TYPE_HASHES
from tests.ros.genuine.environment import environment
from tests.ros.genuine.node import Node, genuine_node
from tests.ros.genuine.robots import robot
from tests.space.dds.peers import until
from tools.ros_type_hashes import found

FLOAT = "std_msgs/msg/Float32"


async def test_nodes_topics_and_parameters(tmp_path: Path, node: Node) -> None:
    async with robot(tmp_path):
        ours = ["/ROVER", "/ROVER/fan", "/ROVER/knob"]
        assert set(await node.does("nodes", wanted=ours)) == {*ours, "/peer"}
        # As `ros2 param list`: every node that is there is asked, and answers.
        listed = await node.does("parameters", names=ours)
        assert listed["/ROVER/knob"] == ["change", "period_s"]
        assert listed["/ROVER"] == []
        wished = {"period_s": 0.5}
        results = await node.does("set_parameters", name="/ROVER/knob", values=wished)
        assert [one["successful"] for one in results] == [True]
        (value,) = await node.does("get_parameters", name="/ROVER/knob", names=["period_s"])
        assert value["double_value"] == 0.5
        (refused,) = await node.does("set_parameters", name="/ROVER/knob", values={"period_s": 99.0})
        assert refused == {"successful": False, "reason": "period_s: is 99.0; it must be 0.02 to 60 s"}
        # Topics, both ways.
        await node.does("listen", type=FLOAT, name="/ROVER/power")
        assert set((await node.does("came", name="/ROVER/power"))[0]) == {"data"}
        (told,) = await node.does("publishers", name="/ROVER/power")
        assert (told["node"], told["type"], told["reliable"]) == ("/ROVER/knob", FLOAT, True)
        heard, mine = sorted(
            await node.does("subscriptions", name="/ROVER/power", wanted=2), key=lambda one: str(one["node"])
        )
        assert (heard["node"], mine["node"]) == ("/ROVER/fan", "/peer")
        assert heard["hash"] == told["hash"] == mine["hash"]
        topics = await node.does("topics")
        for mine in ("clock", "diagnostics", "power"):
            assert f"/ROVER/{mine}" in topics
            assert f"/{mine}" not in topics


@pytest.mark.parametrize("reliable", [True, False], ids=["reliable", "best effort"])
async def test_what_a_node_publishes_moves_the_fan(tmp_path: Path, node: Node, *, reliable: bool) -> None:
    binding = "" if reliable else "reliable = false"
    async with robot(tmp_path, binding=binding, parts=("fan",)) as rover:
        fan = rover.parts["fan"]
        for percent in (80.0, 0.0):
            await node.does(
                "publish",
                type=FLOAT,
                name="/ROVER/power",
                messages=[{"data": percent}],
                reliable=reliable,
                period_s=0.1,
            )
            await until(lambda wanted=percent: bool(fan.source("speed")) == bool(wanted), f"{percent} %")  # type: ignore[misc]
            await node.does("forget")


async def test_a_robot_is_found_again_when_either_side_starts_again(tmp_path: Path, node: Node) -> None:
    for seconds in (0.5, 0.75):
        (tmp_path / str(seconds)).mkdir()
        async with robot(tmp_path / str(seconds)):  # the master, and its parts, again; the node is the same
            await node.does("nodes", wanted=["/ROVER/knob"])
            results = await node.does("set_parameters", name="/ROVER/knob", values={"period_s": seconds})
            assert [one["successful"] for one in results] == [True]
            await node.does("listen", type=FLOAT, name="/ROVER/power")
            await node.does("came", name="/ROVER/power")
            if seconds == 0.5:
                continue
            async with genuine_node("again", middleware=node.middleware) as another:  # a node again, at the same master
                (value,) = await another.does("get_parameters", name="/ROVER/knob", names=["period_s"])
                assert value["double_value"] == seconds
    await node.does("gone", names=["/ROVER", "/ROVER/knob", "/ROVER/fan"])


async def test_two_robots_of_one_name_are_told(tmp_path: Path, node: Node, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "other").mkdir()
    async with robot(tmp_path, "TWIN", parts=()), robot(tmp_path / "other", "TWIN", parts=()):
        await until(lambda: len(caplog.messages) >= 2, "both tell it")
        assert await node.does("nodes", wanted=["/TWIN"])
    told = [one for one in caplog.messages if "/TWIN" in one]
    assert (
        told
        == [
            "another program in this network has a ROS 2 node /TWIN, too: each hears what is meant for the other; "
            "give one of the two another name, or another domain"
        ]
        * 2
    )


async def test_two_robots_keep_to_themselves(tmp_path: Path, node: Node) -> None:
    async with robot(tmp_path, "ONE"), robot(tmp_path, "TWO", parts=()) as other:
        await node.does("listen", type=FLOAT, name="/ONE/power")
        await node.does("listen", type=FLOAT, name="/TWO/power")
        assert await node.does("came", name="/ONE/power", number=3)
        assert await node.does("came_so_far", name="/TWO/power") == []
        assert other.space.endpoints()
        await node.does("nodes", wanted=["/ONE", "/ONE/knob", "/TWO"])
        await node.does("listen", type="diagnostic_msgs/msg/DiagnosticArray", name="/TWO/diagnostics")
        told = await node.does("came", name="/TWO/diagnostics")
        assert {one["name"].partition(":")[0] for one in told[0]["status"]} == {"TWO"}


async def test_robots_share_what_their_blueprints_name(tmp_path: Path, node: Node) -> None:
    shared = {"binding": 'ros_topic = "/power"', "ros": 'global_topics = ["/diagnostics"]'}
    async with robot(tmp_path, "ONE", **shared):  # type: ignore[arg-type]
        await node.does("listen", type=FLOAT, name="/power")
        await node.does("listen", type="diagnostic_msgs/msg/DiagnosticArray", name="/diagnostics")
        assert await node.does("came", name="/power")
        assert await node.does("came", name="/diagnostics")


async def test_a_domain_is_a_network_of_its_own(tmp_path: Path, node: Node) -> None:
    async with (
        robot(tmp_path, "FAR", space="dds:7"),
        genuine_node("inside", middleware=node.middleware, ROS_DOMAIN_ID="7") as inside,
    ):
        assert "/FAR/knob" in await inside.does("nodes", wanted=["/FAR/knob"])
        assert await inside.does("parameters", names=["/FAR/knob"])
        assert "/FAR/knob" not in await node.does("nodes")


def test_hashes_of_types_are_those_of_ros() -> None:
    genuine = dict(found(environment() / "share"))
    assert {name: genuine.get(name) for name in ROS_TYPE_HASHES} == ROS_TYPE_HASHES
