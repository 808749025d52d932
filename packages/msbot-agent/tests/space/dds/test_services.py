"""Services of boards with nodes in the manner of rmw_cyclonedds (`tests.ros.genuine`: with rmw_fastrtps)."""

from __future__ import annotations

import asyncio
import sys
from struct import pack, unpack

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot.part import ServiceNames
from msbot_agent.agent import Agent
from msbot_agent.link import InprocHub
from msbot_agent.space import Qos, Topic
from msbot_agent.space.dds import DdsSpace, dds_services
from tests.hearing_client import HearingClient
from tests.space.dds.foreign_programs import SOURCES, TYPE, command_of
from tests.space.dds.peers import Inbox, program, until

ADD = ServiceNames(
    "add_two_ints",
    "example_interfaces::srv::dds_::AddTwoInts_Request_",
    "example_interfaces::srv::dds_::AddTwoInts_Response_",
    "rq/add_two_intsRequest",
    "rr/add_two_intsReply",
)
NODE = (sys.executable, str(SOURCES / "ros_service.py"))


@given(st.binary(min_size=8, max_size=8), st.integers(-(1 << 63), (1 << 63) - 1), st.binary(max_size=40))
def test_the_header_is_put_in_front_and_taken_off(requester: bytes, number: int, body: bytes) -> None:
    assert dds_services.split(dds_services.with_header(requester, number, body)) == (requester, number, body)


def test_what_is_too_short_has_no_header() -> None:
    assert dds_services.split(bytes(15)) is None
    assert dds_services.split(bytes(16)) == (bytes(8), 0, b"")


async def connected(hub: InprocHub, tasks: asyncio.TaskGroup, key: int) -> tuple[HearingClient, asyncio.Task[None]]:
    """A board that has logged in."""
    client = HearingClient(hub.connect(), key=key)
    running = tasks.create_task(client.run())
    await client.connect(30)
    return client, running


async def test_a_board_asks_a_ros_node() -> None:
    pytest.importorskip("cyclonedds")
    hub, replies = InprocHub(), list[tuple[int, int]]()
    with DdsSpace() as space:
        agent = Agent(space)
        agent.add_link(hub.server)
        async with asyncio.TaskGroup() as tasks, program(*NODE, "serve") as node:
            serving = tasks.create_task(agent.run())
            client, running = await connected(hub, tasks, 1)
            client.on_reply = lambda _object, request, payload: replies.append((request, unpack("<q", payload)[0]))
            requester = client.create_requester(client.create_participant(), ADD)
            client.read(requester)
            await client.until_all_statuses(30)
            await node.says("ready")
            await until(lambda: space.neighbours >= 2)
            asked: list[int] = []
            while not replies:  # what is asked before both sides know of each other is heard by nobody
                asked.append(client.write(requester, pack("<qq", 40, 2)))
                await asyncio.sleep(0.05)
            request, total = replies[0]
            assert request in asked
            assert total == 42
            last = client.write(requester, pack("<qq", -5, 3))
            await until(lambda: (last, -2) in replies)
            running.cancel()
            serving.cancel()


async def test_a_ros_node_asks_a_board() -> None:
    pytest.importorskip("cyclonedds")
    hub = InprocHub()
    with DdsSpace() as space:
        agent = Agent(space)
        agent.add_link(hub.server)
        async with asyncio.TaskGroup() as tasks:
            serving = tasks.create_task(agent.run())
            client, running = await connected(hub, tasks, 1)
            replier = client.create_replier(client.create_participant(), ADD)

            def answer(_object: int, _request: int, identity: bytes, payload: bytes) -> None:
                client.reply(replier, identity, pack("<q", sum(unpack("<qq", payload))))

            client.on_request = answer
            client.read(replier)
            await client.until_all_statuses(30)
            async with program(*NODE, "ask", "1000", "-1") as one, program(*NODE, "ask", "20", "22") as other:
                assert await one.says("sum") == "sum 999 of request 7"
                assert await other.says("sum") == "sum 42 of request 7"
            running.cancel()
            serving.cancel()


async def test_two_boards_at_one_agent_ask_and_answer_in_memory() -> None:
    hub = InprocHub()
    answers: list[bytes] = []
    with DdsSpace() as space, DdsSpace() as elsewhere:
        overheard = Inbox()
        elsewhere.reader(Topic(ADD.reply_topic or "", ADD.reply_type), Qos(), overheard)
        agent = Agent(space)
        agent.add_link(hub.server)
        async with asyncio.TaskGroup() as tasks:
            serving = tasks.create_task(agent.run())
            asker, running = await connected(hub, tasks, 1)
            server, running2 = await connected(hub, tasks, 2)
            asker.on_reply = lambda _object, _request, payload: answers.append(payload)
            replier = server.create_replier(server.create_participant(), ADD)

            def answer(_object: int, _request: int, identity: bytes, _payload: bytes) -> None:
                server.reply(replier, identity, b"done")

            server.on_request = answer
            requester = asker.create_requester(asker.create_participant(), ADD)
            asker.read(requester)
            server.read(replier)
            await server.until_all_statuses(30)
            await asker.until_all_statuses(30)
            asker.write(requester, b"do it")
            await until(lambda: answers)
            for task in (running, running2, serving):
                task.cancel()
        assert answers == [b"done"]
        assert overheard.samples == []  # the answer was for somebody in this process


async def test_a_request_that_is_too_short_is_counted_and_told() -> None:
    with DdsSpace() as here, DdsSpace() as there:
        inbox = Inbox()
        reader = here.reader(Topic("rq/xRequest", "X"), Qos(service=True), inbox)
        writer = there.writer(Topic("rq/xRequest", "X"), Qos(), bytes(16))
        await until(lambda: (writer.write(b"short"), reader.troubles())[1])
        assert "samples of DDS peers made no sense" in reader.troubles()[0]
        assert inbox.samples == []


async def test_a_request_of_fast_dds_is_taken_whole() -> None:
    """It has nothing in front of the body; its identity is its writer and its number in RTPS."""
    peer = command_of("fast")
    inbox = Inbox()
    with DdsSpace() as here:
        here.reader(Topic("rq/xRequest", TYPE), Qos(service=True), inbox)
        # Many: its first ones are for nobody if it has found the reader before it is found itself.
        async with program(*peer, "write", "rq/xRequest", "1000000", "reliable", "volatile"):
            await until(lambda: len(inbox.samples) >= 10)
    numbers = [sample.sequence_nr for sample in inbox.samples]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    assert all(len(sample.writer) == 16 for sample in inbox.samples)
    assert all(b"hello " in payload for payload in inbox.payloads)


async def test_services_with_other_names_stay_in_this_process() -> None:
    with DdsSpace() as here, DdsSpace() as there:
        seen = Inbox()
        there.reader(Topic("msbot_inventory_Request", "T"), Qos(), seen)
        near = Inbox()
        here.reader(Topic("msbot_inventory_Request", "T"), Qos(service=True), near)
        writer = here.writer(Topic("msbot_inventory_Request", "T"), Qos(service=True), bytes(16))
        writer.write(b"private")
        marker = here.writer(Topic("marker", "T"), Qos(transient_local=True), bytes(15) + b"\1")
        marker.write(b"")
        told = Inbox()
        there.reader(Topic("marker", "T"), Qos(transient_local=True), told)
        await until(lambda: told.samples)
        assert near.payloads == [b"private"]
        assert seen.samples == []
