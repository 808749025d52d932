"""What ROS 2 nodes are told of the nodes here: by a node in another process, and in the form of old distributions."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable
from ctypes import POINTER, byref, c_size_t, c_void_p, string_at
from struct import pack

import pytest

from msbot import ros2
from msbot.part import ServiceNames
from msbot.ros.parameter_server import parameter_value
from msbot_agent.agent import Agent
from msbot_agent.link import InprocHub
from msbot_agent.ros import discovery_info
from msbot_agent.ros.discovery_info import SINCE_IRON, UNTIL_HUMBLE, NodeInfo, decode, encode
from msbot_agent.ros.graph import LAST_ONE, RosGraph
from msbot_agent.ros.node_names import NodeName
from msbot_agent.space import Owner, Qos, Topic
from msbot_agent.space.dds import DdsSpace, libddsc
from msbot_agent.space.dds.ros_type_hashes import ROS_TYPE_HASHES
from tests.hearing_client import HearingClient
from tests.space.dds.foreign_programs import SOURCES
from tests.space.dds.peers import Inbox, program, until

NODE = (sys.executable, str(SOURCES / "ros_node.py"))
TOLD = Topic(discovery_info.TOPIC, discovery_info.TYPE)
FLOAT = Topic("rt/power", "std_msgs::msg::dds_::Float32_")
KNOB = Owner(7, "/garden/knob")
NOWHERE: dict[str, str] = {}
LIBRARYS_OWN = 0x7FFF0000
"""Topics from here on are the library's own, which no other program sees."""


def last_nodes(inbox: Inbox) -> dict[str, tuple[int, int]]:
    """Names of the nodes that were told last, with the numbers of their readers and writers."""
    if not inbox.samples:
        return {}
    _, nodes = decode(inbox.payloads[-1], SINCE_IRON)
    return {str(node.name): (len(node.readers), len(node.writers)) for node in nodes}


async def test_nodes_come_and_go_with_their_endpoints() -> None:
    """Each has six readers and writers more: the services that say that it has no parameters."""
    heard = Inbox()
    with DdsSpace() as here, DdsSpace() as there:
        graph = RosGraph(here, environment=NOWHERE)
        there.reader(TOLD, LAST_ONE, heard)
        here.writer(Topic("plain", "T"), Qos(), bytes(16), Owner(9, "no ROS topic"))
        here.writer(Topic("rt/unnamed", "T"), Qos(), bytes(15) + b"\1")
        writer = here.writer(FLOAT, Qos(), bytes(15) + b"\2", KNOB)
        reader = here.reader(FLOAT, Qos(), Inbox(), KNOB)
        await until(lambda: last_nodes(heard) == {"/garden/knob": (7, 7)})
        assert heard.payloads == [heard.payloads[-1]]  # all of it was told at once
        reader.close()
        await until(lambda: last_nodes(heard) == {"/garden/knob": (6, 7)})
        writer.close()
        await until(lambda: heard.samples and last_nodes(heard) == {})
        assert len(heard.samples) == 3
        graph.close()


async def test_no_end_is_without_the_words_that_nodes_read(monkeypatch: pytest.MonkeyPatch) -> None:
    """`rmw_cyclonedds` complains of each end that it finds without them, also of those with which a space tests DDS."""
    library = libddsc.load()
    monkeypatch.setattr(libddsc, "load", lambda: library)
    library.calls.dds_qget_userdata.argtypes = [c_void_p, POINTER(c_void_p), POINTER(c_size_t)]
    told: list[bytes] = []

    def spied(make: Callable[..., int]) -> Callable[..., int]:
        def create(participant: int, topic: int, qos: int | None, listener: object) -> int:
            if topic < LIBRARYS_OWN:
                words, size = c_void_p(), c_size_t()
                if qos is not None:
                    library.calls.dds_qget_userdata(qos, byref(words), byref(size))
                told.append(string_at(words, size.value) if size.value else b"")
            return make(participant, topic, qos, listener)

        return create

    for name in ("dds_create_reader", "dds_create_writer"):
        monkeypatch.setattr(library.calls, name, spied(getattr(library.calls, name)))
    with DdsSpace() as here:
        tests = [*told]
        here.writer(FLOAT, Qos(), bytes(16), KNOB)
        here.reader(Topic("own", "OwnType"), Qos(), Inbox(), KNOB)
    assert len(tests) >= 2
    assert set(tests) == {b"vendor=msbot;"}
    assert told[-2:] == [b"typehash=RIHS01_" + ROS_TYPE_HASHES[FLOAT.type_name].encode() + b";", b"vendor=msbot;"]


async def test_who_leaves_says_that_no_node_is_left() -> None:
    heard = Inbox()
    with DdsSpace() as here, DdsSpace() as there:
        graph = RosGraph(here, environment=NOWHERE)
        here.writer(FLOAT, Qos(), bytes(15) + b"\2", KNOB)
        there.reader(TOLD, LAST_ONE, heard)
        await until(lambda: "/garden/knob" in last_nodes(heard))
        graph.close()
        await until(lambda: last_nodes(heard) == {})


async def test_a_node_that_is_there_twice_is_told_once_on_both_sides(caplog: pytest.LogCaptureFixture) -> None:
    with DdsSpace() as here, DdsSpace() as there:
        graphs = [RosGraph(space, environment=NOWHERE) for space in (here, there)]
        writers = [space.writer(FLOAT, Qos(), bytes(15) + b"\2", KNOB) for space in (here, there)]
        await until(lambda: len(caplog.messages) >= 2)
        other = here.writer(Topic("rt/other", FLOAT.type_name), Qos(), bytes(15) + b"\3", Owner(7, "/garden/other"))
        heard = Inbox()
        there.reader(TOLD, LAST_ONE, heard)
        await until(lambda: "/garden/other" in last_nodes(heard))  # told again, and the twin is known
        assert (
            caplog.messages
            == [
                "another program in this network has a ROS 2 node /garden/knob, too: each hears what is meant for the "
                "other; give one of the two another name, or another domain"
            ]
            * 2
        )
        for writer in (*writers, other):
            writer.close()
        for graph in graphs:
            graph.close()


async def test_a_requester_reads_the_replies_that_its_agent_reads_for_all() -> None:
    heard = Inbox()
    with DdsSpace() as here, DdsSpace() as there:
        RosGraph(here, environment=NOWHERE)
        there.reader(TOLD, LAST_ONE, heard)
        here.reader(Topic("rr/addReply", "R"), Qos(service=True), Inbox())
        here.writer(Topic("rq/addRequest", "Q"), Qos(service=True), bytes(16), KNOB)
        await until(lambda: last_nodes(heard) == {"/garden/knob": (7, 7)})


async def test_nodes_up_to_humble_are_told_in_their_own_form() -> None:
    heard = Inbox()
    old = encode(bytes(range(16)), [NodeInfo(NodeName("/", "talker"))], UNTIL_HUMBLE)
    with DdsSpace() as here, DdsSpace() as there:
        graph = RosGraph(here, environment=NOWHERE)
        here.writer(FLOAT, Qos(), bytes(15) + b"\2", KNOB)
        there.reader(TOLD, LAST_ONE, heard)
        await until(lambda: heard.samples)
        assert graph.gid_length == SINCE_IRON
        there.writer(TOLD, LAST_ONE, bytes(16)).write(old)
        await until(lambda: graph.gid_length == UNTIL_HUMBLE)
        await until(lambda: len(heard.samples) > 2)  # the first form, the stranger's, the second form
        _, nodes = decode(heard.payloads[-1], UNTIL_HUMBLE)
        assert [str(node.name) for node in nodes] == ["/garden/knob"]


async def test_a_form_that_the_user_chose_stays_and_the_other_is_told_once(caplog: pytest.LogCaptureFixture) -> None:
    nodes = [NodeInfo(NodeName("/", "talker"), (bytes(range(16)),))]
    with DdsSpace() as here, DdsSpace() as there:
        graph = RosGraph(here, environment={"ROS_DISTRO": "humble"})
        here.writer(FLOAT, Qos(), bytes(15) + b"\2", KNOB)
        stranger = there.writer(TOLD, LAST_ONE, bytes(16))
        stranger.write(encode(bytes(range(16)), nodes, SINCE_IRON))
        stranger.write(encode(bytes(range(1, 17)), nodes, SINCE_IRON))
        await until(lambda: caplog.messages)
        assert graph.gid_length == UNTIL_HUMBLE
        assert [message[:41] for message in caplog.messages] == ["a ROS 2 node tells of its nodes with GIDs"]


async def test_a_micro_ros_client_is_a_node_for_a_ros_node_and_talks_to_it() -> None:
    """As rclc has it: a participant by the node's name, mangled names and types, a parameter service of its own."""
    pytest.importorskip("cyclonedds")
    services = ServiceNames(
        "get_parameters",
        "rcl_interfaces::srv::dds_::GetParameters_Request_",
        "rcl_interfaces::srv::dds_::GetParameters_Response_",
        "rq/garden/blinker/get_parametersRequest",
        "rr/garden/blinker/get_parametersReply",
    )
    hub = InprocHub()
    with DdsSpace() as space:
        agent = Agent(space)
        agent.add_link(hub.server)
        RosGraph(space, environment=NOWHERE)
        async with asyncio.TaskGroup() as tasks:
            serving = tasks.create_task(agent.run())
            client = HearingClient(hub.connect(), key=1)
            running = tasks.create_task(client.run())
            await client.connect(30)
            participant = client.create_participant("/garden/blinker")
            topic = client.create_topic(participant, FLOAT.name, FLOAT.type_name)
            writer = client.create_writer(client.create_publisher(participant), topic)
            replier = client.create_replier(participant, services)

            def answer(_object: int, _request: int, identity: bytes, _payload: bytes) -> None:
                values = [parameter_value(2.5)]
                client.reply(replier, identity, ros2.GetParameters_Response(values=values).encode())

            client.on_request = answer
            client.read(replier)
            await client.until_all_statuses(30)
            request = '{"names": ["speed"]}'
            async with program(
                *NODE,
                "nodes",
                "/garden/blinker",
                "rt/power",
                "call",
                "/garden/blinker",
                "get_parameters",
                request,
                "hear",
                "power",
                "Float32",
                "1",
                "gone",
                "/garden/blinker",
            ) as node:
                await node.says("node /garden/blinker is complete")
                mine = {
                    line.removeprefix("/garden/blinker ") for line in node.lines if line.startswith("/garden/blinker ")
                }
                assert "writes rt/power std_msgs::msg::dds_::Float32_" in mine
                kinds = {"list": "List", "get": "Get", "set": "Set", "describe": "Describe"}
                for verb, kind in kinds.items():  # the one that it has, and those that it gets
                    at, of = f"/garden/blinker/{verb}_parameters", f"rcl_interfaces::srv::dds_::{kind}Parameters"
                    assert {f"reads rq{at}Request {of}_Request_", f"writes rr{at}Reply {of}_Response_"} <= mine
                assert len(mine) == 2 * 6 + 1
                assert '"double_value": 2.5' in await node.says("get_parameters: ")
                await until(lambda: (client.write(writer, pack("<f", 0.25)), "power: " in "".join(node.lines))[1])
                await node.says('power: {"data": 0.25}')
                running.cancel()
                agent.disconnect(1, reason="its board has lost its power")
                await node.says("node /garden/blinker is gone")
            serving.cancel()
