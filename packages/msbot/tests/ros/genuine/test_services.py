"""Services, parameters and actions of genuine nodes, and of boards and a robot here.

A program in the manner of rmw_cyclonedds asks and answers beside it: both kinds must work at once.
"""

from __future__ import annotations

import asyncio
import contextlib
import re
import sys
from collections.abc import AsyncIterator
from struct import pack, unpack_from

import pytest

from msbot.part import ServiceNames
from msbot.part.client.entities import Entity
from msbot_agent.agent import Agent
from msbot_agent.link import InprocHub
from msbot_agent.ros.graph import RosGraph
from msbot_agent.space.dds import DdsSpace
from msbot_xrce.objects.binary import EndpointQos
from tests.hearing_client import HearingClient
from tests.ros.genuine.node import Node, genuine_node
from tests.space.dds.foreign_programs import SOURCES
from tests.space.dds.peers import program, until

SWITCH = ServiceNames(
    "switch",
    "std_srvs::srv::dds_::SetBool_Request_",
    "std_srvs::srv::dds_::SetBool_Response_",
    "rq/switchRequest",
    "rr/switchReply",
)
ADD = ServiceNames(
    "add_two_ints",
    "example_interfaces::srv::dds_::AddTwoInts_Request_",
    "example_interfaces::srv::dds_::AddTwoInts_Response_",
    "rq/add_two_intsRequest",
    "rr/add_two_intsReply",
)
NAMES = {"send_goal": "SendGoal", "get_result": "GetResult"}
CYCLONE_NODE = (sys.executable, str(SOURCES / "ros_service.py"))


@contextlib.asynccontextmanager
async def board(space: DdsSpace, name: str = "/board") -> AsyncIterator[tuple[HearingClient, Entity]]:
    """A client behind an agent of ours, and its participant."""
    hub = InprocHub()
    agent = Agent(space)
    agent.add_link(hub.server)
    graph = RosGraph(space)
    client = HearingClient(hub.connect(), key=1)
    async with asyncio.TaskGroup() as tasks:
        running = [tasks.create_task(agent.run()), tasks.create_task(client.run())]
        await client.connect(30)
        yield client, client.create_participant(name)
        for task in running:
            task.cancel()
    graph.close()


def text(words: str) -> bytes:
    return pack("<I", len(words) + 1) + words.encode() + b"\0"


async def test_a_board_serves_and_asks_nodes_of_both_kinds(node: Node) -> None:
    pytest.importorskip("cyclonedds")
    replies: list[bytes] = []
    with DdsSpace() as space:
        async with board(space) as (client, participant):
            switch, add = client.create_replier(participant, SWITCH), client.create_replier(participant, ADD)

            def answer(asked: int, _request: int, identity: bytes, payload: bytes) -> None:
                if asked == switch.object_id:
                    client.reply(switch, identity, pack("<?3x", payload[0]) + text("on" if payload[0] else "off"))
                else:
                    client.reply(add, identity, pack("<q", sum(unpack_from("<qq", payload))))

            client.on_request = answer
            for replier in (switch, add):
                client.read(replier)
            await client.until_all_statuses(30)
            asked = await node.does(
                "call", type="std_srvs/srv/SetBool", name="/switch", request={"data": True}, times=20
            )
            assert asked["response"] == {"success": True, "message": "on"}
            async with program(*CYCLONE_NODE, "ask", "40", "2") as other:
                assert await other.says("sum") == "sum 42 of request 7"
            # The other way round.
            await node.does("serve", type="std_srvs/srv/SetBool", name="/lamp")
            lamp = ServiceNames("lamp", SWITCH.request_type, SWITCH.reply_type, "rq/lampRequest", "rr/lampReply")
            requester = client.create_requester(participant, lamp)
            client.on_reply = lambda _object, _request, payload: replies.append(payload)
            client.read(requester)
            await client.until_all_statuses(30)
            while not replies:  # what is asked before both sides know of each other is heard by nobody
                client.write(requester, b"\1")
                await asyncio.sleep(0.05)
            assert b'{"data": true}' in replies[0]
            assert "/switch" in await node.does("services_of", name="board", namespace="/")
            # As `ros2 param list`: a board without parameters does not keep it waiting.
            assert (await node.does("parameters", names=["/board", "/peer"]))["/board"] == []
            refused = {"successful": False, "reason": "this node has no parameters"}
            wished = {"speed": 1.5, "name": "it"}
            assert await node.does("set_parameters", name="/board", values=wished) == [refused, refused]
            assert await node.does("set_parameters_atomically", name="/board", values=wished) == refused
            assert await node.does("get_parameters", name="/board", names=["speed"]) == []


async def test_a_micro_ros_board_with_parameters_has_all_services_that_ros2_param_waits_for(node: Node) -> None:
    """The parameter server of rclc had five services up to Humble, without the one that sets several at once."""
    five = ("ListParameters", "DescribeParameters", "GetParameters", "GetParameterTypes", "SetParameters")
    with DdsSpace() as space:
        async with board(space) as (client, participant):
            repliers: dict[int, tuple[Entity, str]] = {}
            for kind in five:
                name = re.sub("(?<=.)(?=[A-Z])", "_", kind).lower()
                type_name, topic = f"rcl_interfaces::srv::dds_::{kind}", f"/board/{name}"
                names = ServiceNames(
                    name, f"{type_name}_Request_", f"{type_name}_Response_", f"rq{topic}Request", f"rr{topic}Reply"
                )
                made = client.create_replier(participant, names)
                repliers[made.object_id] = made, kind

            def answer(asked: int, _request: int, identity: bytes, _payload: bytes) -> None:
                replier, kind = repliers[asked]
                if kind == "ListParameters":
                    client.reply(replier, identity, pack("<I", 1) + text("speed") + bytes(2) + pack("<I", 0))
                else:
                    client.reply(replier, identity, pack("<I?3x", 1, True) + text(""))

            client.on_request = answer
            for made, _ in repliers.values():
                client.read(made)
            await client.until_all_statuses(30)
            assert await node.does("parameters", names=["/board"]) == {"/board": ["speed"]}
            done = {"successful": True, "reason": ""}
            assert await node.does("set_parameters", name="/board", values={"speed": 1.5}) == [done]
            refused = {"successful": False, "reason": "this node sets its parameters one by one"}
            assert await node.does("set_parameters_atomically", name="/board", values={"speed": 1.5}) == refused


@contextlib.asynccontextmanager
async def fibonacci(client: HearingClient, participant: Entity) -> AsyncIterator[None]:
    """The board carries out an action of this name as long as the block lasts; every goal has the same result."""
    kind = "test_msgs::action::dds_::Fibonacci"

    def service(name: str, request: str) -> ServiceNames:
        path = f"fibonacci/_action/{name}"
        return ServiceNames(path, f"{request}_Request_", f"{request}_Response_", f"rq/{path}Request", f"rr/{path}Reply")

    send = client.create_replier(participant, service("send_goal", f"{kind}_SendGoal"))
    result = client.create_replier(participant, service("get_result", f"{kind}_GetResult"))
    cancel = client.create_replier(participant, service("cancel_goal", "action_msgs::srv::dds_::CancelGoal"))
    publisher = client.create_publisher(participant)
    feedback = client.create_writer(
        publisher, client.create_topic(participant, "rt/fibonacci/_action/feedback", f"{kind}_FeedbackMessage_")
    )
    status = client.create_topic(participant, "rt/fibonacci/_action/status", "action_msgs::msg::dds_::GoalStatusArray_")
    client.create_writer(publisher, status, EndpointQos(transient_local=True, depth=1))

    def answer(asked: int, _request: int, identity: bytes, payload: bytes) -> None:
        if asked == send.object_id:
            client.reply(send, identity, pack("<?3xiI", True, 1, 0))
        else:
            client.write(feedback, payload[:16] + pack("<I2i", 2, 0, 1))
            client.reply(result, identity, pack("<b3xI4i", 4, 4, 0, 1, 1, 2))

    client.on_request = answer
    for replier in (send, result, cancel):
        client.read(replier)
    await client.until_all_statuses(30)
    yield


async def test_a_board_carries_out_an_action(node: Node) -> None:
    with DdsSpace() as space:
        async with board(space) as (client, participant), fibonacci(client, participant):
            done = await node.does("send_goal", type="test_msgs/action/Fibonacci", name="/fibonacci", goal={"order": 3})
            assert done["accepted"]
            assert done["status"] == 4
            assert done["result"] == {"sequence": [0, 1, 1, 2]}


async def test_a_board_asks_for_an_action_of_a_node(node: Node) -> None:
    kind, path = "test_msgs::action::dds_::Fibonacci", "spiral/_action"

    def service(name: str) -> ServiceNames:
        return ServiceNames(
            f"{path}/{name}",
            f"{kind}_{NAMES[name]}_Request_",
            f"{kind}_{NAMES[name]}_Response_",
            f"rq/{path}/{name}Request",
            f"rr/{path}/{name}Reply",
        )

    replies: dict[int, list[bytes]] = {}
    feedback: list[bytes] = []
    await node.does("serve_action", type="test_msgs/action/Fibonacci", name="/spiral")
    with DdsSpace() as space:
        async with board(space) as (client, participant):
            send, result = (client.create_requester(participant, service(name)) for name in NAMES)
            topic = client.create_topic(participant, f"rt/{path}/feedback", f"{kind}_FeedbackMessage_")
            reader = client.create_reader(client.create_subscriber(participant), topic)
            client.on_reply = lambda asked, _request, payload: replies.setdefault(asked, []).append(payload)
            client.on_topic = lambda _object, _request, payload: feedback.append(payload)
            for one in (send, result, reader):
                client.read(one)
            await client.until_all_statuses(30)
            goal = bytes(range(16))
            while send.object_id not in replies:  # what is asked before both know of each other is heard by nobody
                client.write(send, goal + pack("<i", 3))
                await asyncio.sleep(0.05)
            assert replies[send.object_id][0][0] == 1, "it is accepted"
            while result.object_id not in replies:
                client.write(result, goal)
                await asyncio.sleep(0.05)
            status, size = unpack_from("<b3xI", replies[result.object_id][0])
            assert (status, unpack_from(f"<{size}i", replies[result.object_id][0], 8)) == (4, (0, 1, 1, 2))
            await until(lambda: feedback, "feedback")


async def test_a_service_is_found_again_after_a_restart_of_its_agent(node: Node) -> None:
    for words in ("once", "again"):
        with DdsSpace() as space:
            async with board(space) as (client, participant):
                serve_switch(client, participant, words)
                await client.until_all_statuses(30)
                told = await node.does("call", type="std_srvs/srv/SetBool", name="/switch", request={})
                assert told["response"]["message"] == words
        await node.does("service_gone", name="/switch")


async def test_a_board_finds_a_service_again_after_a_restart_of_its_node(node: Node) -> None:
    lamp = ServiceNames("lamp", SWITCH.request_type, SWITCH.reply_type, "rq/lampRequest", "rr/lampReply")
    replies: list[bytes] = []
    with DdsSpace() as space:
        async with board(space) as (client, participant):
            requester = client.create_requester(participant, lamp)
            client.on_reply = lambda _object, _request, payload: replies.append(payload)
            client.read(requester)
            await client.until_all_statuses(30)
            for _ in range(2):
                async with genuine_node("server", middleware=node.middleware) as server:
                    await server.does("serve", type="std_srvs/srv/SetBool", name="/lamp")
                    replies.clear()
                    while not replies:
                        client.write(requester, b"\1")
                        await asyncio.sleep(0.05)


def serve_switch(client: HearingClient, participant: Entity, words: str) -> None:
    """The board answers with these words."""
    switch = client.create_replier(participant, SWITCH)

    def answer(_asked: int, _request: int, identity: bytes, _payload: bytes) -> None:
        client.reply(switch, identity, pack("<?3x", True) + text(words))

    client.on_request = answer
    client.read(switch)


async def test_a_long_request_and_a_long_reply_come_in_fragments(node: Node) -> None:
    with DdsSpace() as space:
        async with board(space) as (client, participant):
            names = ServiceNames(
                "long",
                "rcl_interfaces::srv::dds_::GetParameters_Request_",
                "rcl_interfaces::srv::dds_::GetParameters_Response_",
                "rq/longRequest",
                "rr/longReply",
            )
            replier = client.create_replier(participant, names)
            came: list[int] = []

            def answer(_asked: int, _request: int, identity: bytes, payload: bytes) -> None:
                came.append(len(payload))
                client.reply(replier, identity, pack("<I", 0) + bytes(50_000))

            client.on_request = answer
            client.read(replier)
            await client.until_all_statuses(30)
            told = await node.does(
                "call", type="rcl_interfaces/srv/GetParameters", name="/long", request={"names": ["n" * 50_000]}
            )
            assert told["response"] == {"values": []}
            await until(lambda: came and came[0] > 50_000)
