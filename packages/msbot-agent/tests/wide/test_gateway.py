"""The gateway between two spaces in memory: only what is listed crosses, in its direction, and never in a circle."""

from __future__ import annotations

import asyncio
import contextlib

import pytest

from msbot_agent.space import MemorySpace, Qos, SpaceAddress, Topic
from msbot_agent.wide import BridgeDirection, BridgedTopic, Gateway
from tests.space.dds.peers import Inbox

INSIDE, OUTSIDE = SpaceAddress("dds"), SpaceAddress("zenoh")
LIGHT = Topic("light", "Light")
RELIABLE, EVERYBODY = Qos(), Qos(partitions=("",))


class Sites:
    """A gateway, and a program at either side."""

    def __init__(self, *crossings: BridgedTopic) -> None:
        self.inside, self.outside = MemorySpace(), MemorySpace()
        self.gateway = Gateway(self.inside, self.outside, (INSIDE, OUTSIDE), crossings)

    def say(self, *, outside: bool = False, qos: Qos = EVERYBODY, topic: Topic = LIGHT) -> None:
        """Write a sample at one side."""
        space = self.outside if outside else self.inside
        writer = space.writer(topic, qos, b"w" * 16)
        writer.write(b"word")
        writer.close()

    def inboxes(self, *, inside: str = "", outside: str = "") -> tuple[Inbox, Inbox]:
        """What is heard at either side."""
        found = Inbox(), Inbox()
        for space, partition, inbox in zip((self.inside, self.outside), (inside, outside), found, strict=True):
            space.reader(LIGHT, Qos(depth=64, partitions=(partition,)), inbox)
        return found


def crossing(direction: BridgeDirection, *, robot: str = "", qos: Qos = RELIABLE) -> BridgedTopic:
    return BridgedTopic(LIGHT, direction, robot, qos)


@pytest.mark.parametrize(
    ("direction", "crossed"),
    [(BridgeDirection.OUT, (1, 2)), (BridgeDirection.IN, (2, 1)), (BridgeDirection.BOTH, (2, 2))],
)
def test_samples_cross_in_their_direction_and_none_comes_back(
    direction: BridgeDirection, crossed: tuple[int, int]
) -> None:
    sites = Sites(crossing(direction))
    inside, outside = sites.inboxes()
    sites.say()
    sites.say(outside=True)
    assert (len(inside.samples), len(outside.samples)) == crossed
    assert sum(number for _, _, number in sites.gateway.crossed()) == sum(crossed) - 2
    sites.gateway.close()
    sites.say()
    assert len(outside.samples) == crossed[1]


def test_a_robots_topic_has_its_partition_at_either_side() -> None:
    sites = Sites(crossing(BridgeDirection.OUT, robot="ROVER"))
    _, theirs = sites.inboxes(outside="ROVER")
    _, others = sites.inboxes()
    sites.say(qos=Qos(partitions=("msbot/ROVER",)))
    sites.say(qos=Qos(partitions=("msbot/OTHER",)))
    sites.say()
    assert (len(theirs.samples), len(others.samples)) == (1, 0)


def test_what_is_not_listed_does_not_cross() -> None:
    sites = Sites(crossing(BridgeDirection.BOTH))
    inbox = Inbox()
    sites.outside.reader(Topic("secret", "Light"), Qos(), inbox)
    sites.say(topic=Topic("secret", "Light"))
    assert inbox.samples == []


def test_kept_samples_are_kept_at_the_other_side() -> None:
    sites = Sites(crossing(BridgeDirection.OUT, qos=Qos(transient_local=True, depth=1)))
    kept = sites.inside.writer(LIGHT, Qos(transient_local=True, depth=1, partitions=("",)), b"w" * 16)
    kept.write(b"old")
    kept.write(b"new")
    late = Inbox()
    sites.outside.reader(LIGHT, Qos(transient_local=True, partitions=("",)), late)
    assert late.payloads == [b"new"]


async def test_what_keeps_a_topic_from_crossing_is_told_once(caplog: pytest.LogCaptureFixture) -> None:
    sites = Sites(crossing(BridgeDirection.OUT))
    sites.inside.writer(LIGHT, Qos(reliable=False, partitions=("",)), b"w" * 16)
    task = asyncio.create_task(sites.gateway.run())
    for _ in range(3):
        await asyncio.sleep(0)
    task.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await task
    assert caplog.messages == ["light: RELIABILITY: the reader asks for RELIABLE, the writer offers BEST_EFFORT"]
    assert sites.gateway.troubles() == caplog.messages
