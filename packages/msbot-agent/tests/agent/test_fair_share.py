"""Who sends without measure gets its share; nobody else notices."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field

import pytest

from msbot.process.virtual_time import run_virtual
from msbot_agent.agent import Agent, AgentSettings, ClientInfo, OpenGate
from msbot_agent.agent.fair_share import BEYOND, WINDOW_S, FairShare, Limit
from msbot_agent.space import MemorySpace
from msbot_xrce.counting import Tally
from msbot_xrce.messages import CreateClient, Header, encode_message
from tests.agent.wiring import FakeLink, serving

PER_CLIENT, IN_ALL = 1000.0, 3000.0
NOTHING_TO_ANSWER = bytes.fromhex("07010800 00100075 00000000")
"""WRITE_DATA of an object that is not there."""


@dataclass(eq=False)
class Sender:
    """A client that sends steadily."""

    per_s: float
    packets_in: int = 0
    limit: Limit | None = None
    dropped: Tally = field(default_factory=Tally)

    def send(self, since: float) -> None:
        """For one window; the packets come at even distances."""
        count = round(self.per_s * WINDOW_S)
        for number in range(count):
            if self.limit is None or self.limit.takes(since + number * WINDOW_S / count):
                self.packets_in += 1


@dataclass
class Scene:
    """Some clients and the agent's time."""

    senders: list[Sender]
    is_strict: bool = True
    total: int = 0
    now: float = 0.0

    def __post_init__(self) -> None:
        self.told: list[tuple[Sender, float, float]] = []
        self.shares = FairShare[Sender](PER_CLIENT, IN_ALL, self._limits)

    def _limits(self, sender: Sender, rate: float, share: float) -> bool:
        self.told.append((sender, rate, share))
        return self.is_strict

    def run(self, windows: int) -> dict[int, int]:
        """Let time pass; how many packets of each were taken, by its place."""
        before = [sender.packets_in for sender in self.senders]
        for _ in range(windows):
            for sender in self.senders:
                self.total += round(sender.per_s * WINDOW_S)
                sender.send(self.now)
            self.now += WINDOW_S
            self.shares.compare(self.total, self.senders, self.now)
        return {place: sender.packets_in - before[place] for place, sender in enumerate(self.senders)}


def test_a_flood_is_cut_to_the_share_and_counted_and_others_are_not_touched() -> None:
    scene = Scene([Sender(50_000), Sender(100), Sender(900)])
    scene.run(3)
    taken = scene.run(8)
    flooding, *others = scene.senders
    assert 0.9 * PER_CLIENT * 2 <= taken[0] <= 1.1 * PER_CLIENT * 2
    assert flooding.dropped[BEYOND] > 90_000
    assert (taken[1], taken[2]) == (200, 1800)
    assert [sender.limit for sender in others] == [None, None]
    sender, rate, share = scene.told[0]
    assert (sender, round(rate), share) == (flooding, 50_000, PER_CLIENT)


def test_many_floods_share_what_there_is_and_get_the_same() -> None:
    scene = Scene([*(Sender(20_000) for _ in range(6)), Sender(50)])
    scene.run(3)
    taken = scene.run(8)
    each = (IN_ALL - 50) / 6
    assert all(0.9 * each * 2 <= taken[place] <= 1.1 * each * 2 for place in range(6))
    assert taken[6] == 96, "12 in each window"


def test_who_calms_down_is_free_again_and_little_traffic_is_not_looked_at() -> None:
    scene = Scene([Sender(50_000)])
    scene.run(3)
    (sender,) = scene.senders
    assert sender.limit is not None
    sender.per_s = 500
    scene.run(3)
    assert sender.limit is None
    told = len(scene.told)
    scene.run(10)
    assert len(scene.told) == told


def test_an_agent_whose_gate_does_not_mind_limits_nobody() -> None:
    scene = Scene([Sender(50_000)], is_strict=False)
    assert scene.run(8) == {0: 100_000}


@pytest.mark.parametrize("in_bursts", [True, False])
def test_a_client_whose_packets_call_for_no_answer_is_limited_too(in_bursts: bool) -> None:
    class Strict(OpenGate):
        def limits(self, client: ClientInfo, packets_per_s: float, share: float) -> bool:
            return True

    async def main() -> None:
        settings = AgentSettings(max_packets_per_s=PER_CLIENT, max_packets_in_all_per_s=IN_ALL)
        link = FakeLink(in_bursts=in_bursts)
        agent = Agent(MemorySpace(), gate=Strict(), settings=settings)
        async with serving(agent, link):
            link.plug("client", lambda _: None)
            link.inject(encode_message(Header(0x80, 0, 0, None), [CreateClient(7, 0x81, 512)], pad_end=False))
            link.end_burst()
            number = 0
            for _ in range(8):
                for _ in range(round(4 * PER_CLIENT * WINDOW_S)):
                    link.counters.packets_in += 1
                    link.inject(bytes((0x81, 1, number & 0xFF, number >> 8)) + NOTHING_TO_ANSWER)
                    number += 1
                link.end_burst()
                await asyncio.sleep(WINDOW_S)
            (client,) = agent.clients()
            assert client.dropped.get(BEYOND, 0) > PER_CLIENT * WINDOW_S

    run_virtual(main())
