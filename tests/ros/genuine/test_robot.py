"""Robots as genuine nodes of ROS 2 see them: their nodes, topics and parameters, each in its own namespace."""

from __future__ import annotations

from pathlib import Path

from msbot.space.dds.ros_type_hashes import ROS_TYPE_HASHES
from tests.ros.genuine.environment import environment
from tests.ros.genuine.node import genuine_node
from tests.ros.genuine.robots import robot
from tools.ros_type_hashes import found

FLOAT = "std_msgs/msg/Float32"


async def test_nodes_topics_and_parameters(tmp_path: Path) -> None:
    async with robot(tmp_path), genuine_node() as node:
        ours = ["/ROVER", "/ROVER/fan", "/ROVER/knob"]
        assert await node.does("nodes", wanted=ours) == sorted([*ours, "/peer"])
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


async def test_two_robots_keep_to_themselves(tmp_path: Path) -> None:
    async with robot(tmp_path, "ONE"), robot(tmp_path, "TWO", parts=False) as other, genuine_node() as node:
        await node.does("listen", type=FLOAT, name="/ONE/power")
        await node.does("listen", type=FLOAT, name="/TWO/power")
        assert await node.does("came", name="/ONE/power", number=3)
        assert await node.does("came_so_far", name="/TWO/power") == []
        assert other.space.endpoints()
        await node.does("nodes", wanted=["/ONE", "/ONE/knob", "/TWO"])
        await node.does("listen", type="diagnostic_msgs/msg/DiagnosticArray", name="/TWO/diagnostics")
        told = await node.does("came", name="/TWO/diagnostics")
        assert {one["name"].partition(":")[0] for one in told[0]["status"]} == {"TWO"}


async def test_robots_share_what_their_blueprints_name(tmp_path: Path) -> None:
    shared = {"binding": 'ros_topic = "/power"', "ros": 'global_topics = ["/diagnostics"]'}
    async with robot(tmp_path, "ONE", **shared), genuine_node() as node:  # type: ignore[arg-type]
        await node.does("listen", type=FLOAT, name="/power")
        await node.does("listen", type="diagnostic_msgs/msg/DiagnosticArray", name="/diagnostics")
        assert await node.does("came", name="/power")
        assert await node.does("came", name="/diagnostics")


async def test_a_domain_is_a_network_of_its_own(tmp_path: Path) -> None:
    async with robot(tmp_path, space="dds:7"), genuine_node() as outside, genuine_node(ROS_DOMAIN_ID="7") as inside:
        assert "/ROVER/knob" in await inside.does("nodes", wanted=["/ROVER/knob"])
        assert await inside.does("parameters", names=["/ROVER/knob"])
        assert await outside.does("nodes") == ["/peer"]


def test_hashes_of_types_are_those_of_ros() -> None:
    genuine = dict(found(environment() / "share"))
    assert {name: genuine.get(name) for name in ROS_TYPE_HASHES} == ROS_TYPE_HASHES
