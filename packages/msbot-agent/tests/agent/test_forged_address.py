"""Who forges an address can have the agent send something there: it is little, and becomes less when nobody answers."""

from __future__ import annotations

import asyncio
import math
import struct

import pytest

from msbot.process.virtual_time import run_virtual
from msbot_agent.agent import Agent, AgentSettings
from msbot_agent.space import MemorySpace
from tests.agent.wiring import FakeLink, serving

LOGIN = bytes.fromhex("8000000000011000585243450100010fbb0000078100fc01")
"""CREATE_CLIENT; from here on the client says nothing that depends on an answer."""


def submessage(kind: int, body: bytes) -> bytes:
    return struct.pack("<BBH", kind, 1, len(body)) + body + bytes(-len(body) % 4)


MISSING = bytes.fromhex("81000000") + submessage(11, struct.pack("<HHB", 1, 0x7FFF, 0x80) + bytes(3))
"""A HEARTBEAT about messages that never come."""
UNUSABLE = b"".join(
    submessage(1, struct.pack(">HH", number, 0x11) + b"\1\2\0\0" + struct.pack("<I", 4) + b"abc\0\0\0")
    for number in range(20)
)
ANSWERED = bytes.fromhex("81800000") + UNUSABLE
"""Objects whose STATUS is reliable, and never acknowledged."""


def answers_to(packet: bytes, *seconds: float) -> list[list[int]]:
    """The sizes of what is sent in each of these times, one after the other, when that packet comes after the login."""
    found: list[list[int]] = []

    async def scenario() -> None:
        agent = Agent(MemorySpace(), settings=AgentSettings(dead_after_s=math.inf))  # as `msbot agent`
        async with serving(agent, FakeLink(keeps_order=False)) as link:  # as UDP
            link.inject(LOGIN)
            link.take_sent()
            link.inject(packet)
            for wait_s in seconds:
                await asyncio.sleep(wait_s)
                found.append([len(one) for one in link.take_sent()])

    run_virtual(scenario())
    return found


@pytest.mark.promise("A flood neither keeps parts out nor makes active ones late")
def test_who_was_told_what_is_missing_and_says_nothing_is_asked_ever_more_rarely() -> None:
    asked, later = answers_to(MISSING, 20.0, 600.0)
    assert 8 <= len(asked) <= 40
    assert sum(asked) < 600
    assert later == []


@pytest.mark.promise("A flood neither keeps parts out nor makes active ones late")
def test_who_acknowledges_nothing_is_sent_ever_fewer_heartbeats() -> None:
    first, second, later = answers_to(ANSWERED, 5.0, 60.0, 600.0)
    heartbeats = [size for size in first if size <= 16]
    assert len(heartbeats) >= 20, "a client that is merely slow is asked five times a second"
    assert len(second) <= 50
    assert 100 <= len(later) <= 200, "one that comes again later is still told, every few seconds"


@pytest.mark.promise("A flood neither keeps parts out nor makes active ones late")
def test_no_newcomer_is_asked_again_while_the_answer_may_lie_unread_in_the_socket() -> None:
    async def scenario() -> None:
        agent = Agent(MemorySpace(), settings=AgentSettings(dead_after_s=math.inf))
        async with serving(agent, FakeLink(keeps_order=False)) as link:
            clock = asyncio.get_running_loop().time
            link.inject(LOGIN)
            link.inject(ANSWERED)
            link.inject(MISSING)
            await asyncio.sleep(0)
            link.take_sent()
            for _ in range(40):
                link.unread_at = clock()
                await asyncio.sleep(0.01)
            assert link.take_sent() == []
            await asyncio.sleep(0.3)
            assert len(link.take_sent()) >= 2, "a HEARTBEAT and a report"
            for _ in range(500):
                link.unread_at = clock()
                await asyncio.sleep(0.01)
            assert 4 <= len(link.take_sent()) <= 20, "a link that stays behind does not silence the agent"
            await asyncio.sleep(5.0)
            link.take_sent()
            link.inject(bytes.fromhex("81000000") + submessage(11, struct.pack("<HHB", 1, 0x7FFE, 0x80) + bytes(3)))
            link.inject(bytes.fromhex("81800100") + UNUSABLE)
            await asyncio.sleep(0)
            link.take_sent()
            for _ in range(100):
                link.unread_at = clock()
                await asyncio.sleep(0.01)
            assert len(link.take_sent()) >= 5, "whoever has been there for long is asked as ever"

    run_virtual(scenario())
