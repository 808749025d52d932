"""From a part on a simulated CAN bus to DDS peers in another process and back, octet by octet; and a whole robot."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import replace
from random import Random

from msbot import HelloWorld
from msbot_agent.agent import Agent
from msbot_agent.link.can import CanMasterLink, CanPartLink
from msbot_agent.link.can.sim import SimBus, SimBusDriver
from msbot_agent.space import Qos, Space, Topic
from msbot_agent.space.dds import DdsSpace
from msbot_xrce.messages import Format, ObjectKind, ObjectVariant
from tests.hearing_client import HearingClient
from tests.space.dds.foreign_programs import TYPE, command_of, message
from tests.space.dds.peers import Inbox, program, until


@asynccontextmanager
async def client_on_can(space: Space) -> AsyncIterator[HearingClient]:
    """An agent on a simulated bus, and a client that has logged in over it."""
    driver = SimBusDriver(SimBus(500_000))
    driver.attach("monitor")
    agent = Agent(space)
    agent.add_link(CanMasterLink(driver.attach("master"), profile_hash=7, random=Random(1)))
    client = HearingClient(CanPartLink(driver.attach("part"), uid=b"part 1..", random=Random(2)), key=0x0A0B0C0D)
    async with asyncio.TaskGroup() as tasks:
        running = [tasks.create_task(agent.run()), tasks.create_task(client.run())]
        await client.connect(30)
        yield client
        for task in running:
            task.cancel()


async def test_a_client_on_can_publishes_and_a_dds_peer_in_another_process_receives_it() -> None:
    peer = command_of("cyclone")
    with DdsSpace() as space:
        async with (
            client_on_can(space) as client,
            program(*peer, "read", "from_can", "3", "reliable", "volatile") as reader,
        ):
            participant = client.create_participant()
            topic = client.create_topic(participant, "from_can", TYPE)
            writer = client.create_writer(client.create_publisher(participant), topic)
            await client.until_all_statuses(30)
            await until(lambda: client.has_room() and (client.write(writer, message(1)), reader.heard)[1])
            for number in (2, 3):
                await until(client.has_room)
                client.write(writer, message(number))
            await until(lambda: len(reader.heard) == 3)
        assert set(reader.heard) <= {f"got {number} hello {number}" for number in (1, 2, 3)}


async def test_a_dds_peer_writes_and_a_client_on_can_receives_it() -> None:
    peer = command_of("cyclone")
    seen: list[bytes] = []
    with DdsSpace() as space:
        async with client_on_can(space) as client:
            participant = client.create_participant()
            topic = client.create_topic(participant, "to_can", TYPE)
            reader = client.create_reader(client.create_subscriber(participant), topic)
            client.on_topic = lambda _object, _request, payload: seen.append(payload)
            client.read(reader)
            await client.until_all_statuses(30)
            async with program(*peer, "write", "to_can", "10", "reliable", "volatile"):
                await until(lambda: len(seen) == 10)
        assert seen == [message(number) for number in range(10)]


async def test_a_robot_in_its_partition_is_heard_by_who_joins_it_and_by_nobody_else() -> None:
    topic = Topic("HelloWorldTopic_1_to_2", HelloWorld.type_name)
    inside, outside = Inbox(), Inbox()
    with DdsSpace(partition="msbot/MSBOT_MASTER") as member, DdsSpace() as stranger:
        member.reader(topic, Qos(), inside)
        stranger.reader(topic, Qos(), outside)
        what = ("demo", "--robot", "thesis", "--space", "dds", "--seconds", "100", "--no-page")
        async with program(sys.executable, "-m", "msbot", *what) as robot:
            await until(lambda: len(inside.samples) >= 2)
            await robot.says("AA active")
    assert HelloWorld.decode(inside.payloads[0]).message.startswith("Publisher")
    assert outside.samples == []


WRITER_XML = (
    "<dds><data_writer><topic><name>quality</name><dataType>T</dataType>"
    "<historyQos><kind>KEEP_LAST</kind><depth>3</depth></historyQos></topic><qos>"
    "<reliability><kind>RELIABLE</kind></reliability><durability><kind>TRANSIENT_LOCAL</kind></durability>"
    "<deadline><period><sec>2</sec></period></deadline><ownership><kind>EXCLUSIVE</kind></ownership>"
    "<ownershipStrength><value>7</value></ownershipStrength>"
    "<lifespan><duration><sec>60</sec></duration></lifespan>"
    "<partition><names><name>room1</name></names></partition></qos></data_writer></dds>"
)
TOPIC_XML = "<dds><topic><name>quality</name><dataType>T</dataType></topic></dds>"


async def test_the_quality_that_a_client_asks_for_in_xml_is_that_of_its_writer_in_dds() -> None:
    offered = Qos(transient_local=True, depth=3, partitions=("room1",), exclusive=True, deadline_s=2.0)
    heard, kept = Inbox(), Inbox()
    with DdsSpace() as space, DdsSpace() as elsewhere:
        async with client_on_can(space) as client:
            participant = client.create_participant()
            publisher = client.create_publisher(participant)
            topic = ObjectVariant(ObjectKind.TOPIC, Format.XML, text=TOPIC_XML, parent_id=participant.object_id)
            client.create(topic)
            xml = ObjectVariant(ObjectKind.DATAWRITER, Format.XML, text=WRITER_XML, parent_id=publisher.object_id)
            writer = client.create(xml)
            await client.until_all_statuses(30)
            where = Topic("quality", "T")
            elsewhere.reader(where, offered, heard)
            impatient = elsewhere.reader(where, replace(offered, deadline_s=1.0), Inbox())
            stranger = elsewhere.reader(where, replace(offered, partitions=()), Inbox())
            sharing = elsewhere.reader(where, replace(offered, exclusive=False), Inbox())
            for number in range(6):
                await until(client.has_room)
                client.write(writer, bytes([number] * 4))
            await until(lambda: heard.payloads[-1:] == [bytes([5] * 4)])
            elsewhere.reader(where, offered, kept)
            await until(lambda: len(kept.samples) == 3)
            assert kept.payloads == [bytes([number] * 4) for number in (3, 4, 5)]
            others = (impatient, stranger, sharing)
            await until(lambda: all(reader.troubles() for reader in others))  # each finds the writer when it does
            found = [reader.troubles() for reader in others]
            assert [[trouble.split(": ")[1] for trouble in troubles] for troubles in found] == [
                ["DEADLINE"],
                ["PARTITION"],
                ["OWNERSHIP"],
            ]
