"""Topics between boards and genuine nodes: reliable or not, from the past or not, as many as the history has."""

from __future__ import annotations

from struct import pack

import pytest

from msbot_agent.space import Qos, Topic
from msbot_agent.space.dds import DdsSpace
from tests.ros.genuine.node import Node
from tests.space.dds.peers import Inbox, until

INT = "std_msgs/msg/Int32"
TOPIC = Topic("rt/count", "std_msgs::msg::dds_::Int32_")
GUIDS = [bytes([number]) * 16 for number in (1, 2)]
EVERYBODY = ("",)


def numbers(inbox: Inbox) -> list[int]:
    return [int.from_bytes(payload[:4], "little") for payload in inbox.payloads]


@pytest.mark.parametrize("reliable", [True, False], ids=["reliable", "best effort"])
async def test_both_ways(node: Node, *, reliable: bool) -> None:
    inbox, qos = Inbox(), Qos(reliable=reliable, depth=10, partitions=EVERYBODY)
    with DdsSpace() as space:
        space.reader(TOPIC, qos, inbox)
        await node.does(
            "publish",
            type=INT,
            name="/count",
            messages=[{"data": n} for n in range(5)],
            reliable=reliable,
            until=1,
            period_s=0.02,
        )
        await until(lambda: len(inbox.payloads) >= 5)
        await node.does("forget")
        inbox.samples.clear()
        await node.does("listen", type=INT, name="/back", reliable=reliable)
        writer = space.writer(Topic("rt/back", TOPIC.type_name), qos, GUIDS[0])
        await node.does("publishers", name="/back")
        heard: list[object] = []
        while not heard:  # what is written before both know of each other is heard by nobody
            writer.write(pack("<i", 7))
            heard = await node.does("came_so_far", name="/back")
        assert heard[0] == {"data": 7}


async def test_what_was_said_before_is_heard_as_much_as_the_history_has(node: Node) -> None:
    late = Qos(transient_local=True, depth=3, late_depth=3, partitions=EVERYBODY)
    inbox = Inbox()
    with DdsSpace() as space:
        writer = space.writer(Topic("rt/said", TOPIC.type_name), late, GUIDS[0])
        for number in range(6):
            writer.write(pack("<i", number))
        await node.does("listen", type=INT, name="/said", late=True)
        heard = await node.does("came", name="/said", number=3)
        assert [one["data"] for one in heard] == [3, 4, 5]
        # The other way round: the node has said it before the reader is there.
        await node.does(
            "publish", type=INT, name="/count", messages=[{"data": n} for n in range(6)], late=True, depth=3
        )
        space.reader(TOPIC, late, inbox)
        await until(lambda: len(inbox.payloads) >= 3)
        assert numbers(inbox) == [3, 4, 5]


async def test_a_reader_that_asks_for_more_than_is_offered_is_told(node: Node) -> None:
    with DdsSpace() as space:
        await node.does("publish", type=INT, name="/count", messages=[{"data": 1}], reliable=False)
        reader = space.reader(TOPIC, Qos(reliable=True, depth=10, partitions=EVERYBODY), Inbox())
        await until(lambda: any("RELIABILITY" in words for words in reader.troubles()), "it is told")
