"""Packets outside of sessions take a bounded part of the agent's time, and newcomers still get in."""

from __future__ import annotations

import asyncio
import logging
from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot_agent.agent import Agent, AgentSettings, ClientInfo
from msbot_agent.agent.fair_share import BEYOND_OUTSIDE, MOST_ORIGINS, MOST_PEERS, TOLD_S, WINDOW_S, SessionlessLimiter
from msbot_xrce.messages import CreateClient, Header, encode_message
from msbot_xrce.sessions import Pong
from tests.agent.scenes import StrictGate, connected, play
from tests.agent.wiring import FakeLink

PER_S = 400.0
BUDGET = round(PER_S * WINDOW_S)
GARBAGE = bytes.fromhex("81000000 07010800 00100075 00000000")
"""WRITE_DATA of a session that is not there."""
Sender = tuple[str, int]
"""Address and port."""


class Stream:
    """Packets of some senders, mixed evenly, window by window."""

    def __init__(self) -> None:
        self.share = SessionlessLimiter(PER_S)
        self.now = 0.0

    def window(self, packets: dict[Sender, int]) -> Counter[Sender]:
        """How many of whose packets were read."""
        due = sorted((place / count, sender) for sender, count in packets.items() for place in range(count))
        taken = Counter(
            sender for at, sender in due if self.share.takes(sender[0], sender, self.now + at * WINDOW_S * 0.99)
        )
        self.now += WINDOW_S
        return taken


def test_little_is_read_whole() -> None:
    stream = Stream()
    senders = {("a", 1): 10, ("b", 1): 5, ("b", 2): 5}
    assert [stream.window(senders) for _ in range(3)] == [Counter(senders)] * 3


def test_a_flood_of_one_address_is_cut_and_newcomers_are_read_at_once() -> None:
    stream = Stream()
    flood = {("flood", 1): 5000}
    stream.window(flood)
    for number in range(20):
        newcomer = (f"new {number}", 1)
        taken = stream.window({**flood, newcomer: 1})
        assert taken[newcomer] == 1
        assert 0 < taken[("flood", 1)] <= BUDGET // 2


def test_a_newcomer_at_the_address_of_the_flood_is_read_as_well() -> None:
    stream = Stream()
    flood = {("flood", 1): 5000}
    stream.window(flood)
    for port in range(2, 20):
        taken = stream.window({**flood, ("flood", port): 1})
        assert taken[("flood", port)] == 1


def test_floods_of_many_addresses_leave_room_for_who_asks_little() -> None:
    stream = Stream()
    floods = {(f"flood {number}", 1): 300 for number in range(40)}
    quiet = ("quiet", 1)
    stream.window(floods)
    assert stream.window({**floods, quiet: 1})[quiet] == 1, "new"
    for _ in range(5):
        taken = stream.window({**floods, quiet: 1})
        assert taken[quiet] == 1
        assert taken.total() <= BUDGET
        assert all(0 < taken[flood] <= 2 for flood in floods)


def test_who_pauses_is_new_again() -> None:
    stream = Stream()
    stream.window({("flood", 1): 5000})
    stream.now += 10 * WINDOW_S
    assert stream.window({("flood", 1): 5000})[("flood", 1)] <= BUDGET // 2


def test_it_is_told_once_a_minute() -> None:
    share = SessionlessLimiter(PER_S)
    assert [share.is_news(at) for at in (5.0, 6.0, 5.0 + TOLD_S, 6.0 + TOLD_S)] == [True, False, True, False]


senders = st.tuples(st.integers(0, 40).map(str), st.integers(0, 5))


@given(st.lists(st.dictionaries(senders, st.integers(1, 200), max_size=30), max_size=4))
def test_no_window_reads_more_than_its_budget_whoever_sends(windows: list[dict[Sender, int]]) -> None:
    stream = Stream()
    for packets in windows:
        assert stream.window(packets).total() <= BUDGET


def test_its_memory_is_bounded_whoever_sends() -> None:
    share = SessionlessLimiter(PER_S)
    for number in range(2 * MOST_ORIGINS):
        share.takes(f"address {number}", 1, 0.0)
    for port in range(2 * MOST_PEERS):
        share.takes("address 0", port, 0.0)
    assert len(share._origins.asked) == MOST_ORIGINS + 1
    assert len(share._peers) == MOST_ORIGINS + 1
    assert len(share._peers["address 0"].asked) == MOST_PEERS + 1


class Bounding(StrictGate):
    """Limits strangers; the client with key 1 has a place."""

    def limits_strangers(self) -> bool:
        return True

    def is_settled(self, client: ClientInfo) -> bool:
        return client.key == 1


def test_an_agent_counts_what_it_does_not_read_and_sessions_are_untouched(caplog: pytest.LogCaptureFixture) -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        (client,) = await connected(link, 1)
        writer = await client.add_writer("light")
        caplog.clear()
        with caplog.at_level(logging.WARNING):
            for _ in range(10):
                for _ in range(500):
                    link.inject(GARBAGE, "stranger")
                client.session.write(writer, b"still", 0x80)
                await client.settle()
                client.session.ping(asyncio.get_running_loop().time())
                await client.settle()
                await asyncio.sleep(WINDOW_S)
        read = agent.dropped()["packet without a session"]
        assert 0 < read <= 10 * BUDGET / 2
        assert agent.dropped()[BEYOND_OUTSIDE] == 5000 - read
        assert agent.topics() == [("light", 10, 0)]
        assert len(client.take(Pong)) == 10, "its questions outside of its session are answered, too"
        (record,) = caplog.records
        assert "more packets outside of sessions than 400 a second, now from peer stranger" in record.message
        link.inject(_login(7), "newcomer")
        assert {view.address for view in agent.clients()} == {"peer 1", "peer newcomer"}

    play(scenario, gate=Bounding(), settings=AgentSettings(max_outside_per_s=PER_S))


def test_an_agent_whose_gate_does_not_mind_reads_everything() -> None:
    async def scenario(agent: Agent, link: FakeLink) -> None:
        for _ in range(5000):
            link.inject(GARBAGE, "stranger")
        assert agent.dropped() == {"packet without a session": 5000}

    play(scenario, gate=StrictGate())


def _login(key: int) -> bytes:
    return encode_message(Header(0x80, 0, 0, None), [CreateClient(key, 0x81, 512)], pad_end=False)
