"""What a link holds back, loses, doubles and does not take, beside a plain calculation of when each packet is due."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Coroutine, Sequence
from random import Random
from typing import TypeAlias

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot.process.virtual_time import run_virtual
from msbot_agent.link import BaseLink, LinkInfo, Peer
from msbot_agent.link.disturbed_link import LOST, MOST_COPIES, MOST_HELD, Disturbance, DisturbedLink
from msbot_xrce.errors import LinkFull


class Wire(BaseLink):
    """A link that notes what it gets and when."""

    def __init__(self, *, in_bursts: bool = False) -> None:
        super().__init__(LinkInfo("wire", 1000, in_bursts=in_bursts))
        self.got: list[tuple[float, bytes]] = []
        self.is_full = False

    def has_room(self, peer: Peer) -> bool:
        return not self.is_full

    def send(self, packet: bytes, peer: Peer) -> None:
        if self.is_full:
            raise LinkFull("no room")
        self.got.append((asyncio.get_running_loop().time(), packet))

    def describe(self, peer: Peer) -> str:
        return str(peer)

    def say(self, packet: bytes) -> None:
        self._received(packet, "peer", asyncio.get_running_loop().time())

    async def run(self) -> None:
        await asyncio.get_running_loop().create_future()


class Script:
    """A treatment that does what the test says."""

    def __init__(self, *, inward: bool | None = None) -> None:
        self.inward = inward
        """The one direction that it treats; None: both."""
        self.now: Sequence[float] = (0.0,)
        self.free: dict[Peer, float] = {}

    def applies_to(self, peer: Peer, packet: bytes, *, inward: bool) -> bool:
        return self.inward in (None, inward)

    def delays(self, peer: Peer, now: float, *, inward: bool) -> Sequence[float]:
        return self.now

    def free_at(self, peer: Peer, now: float) -> float:
        return self.free.get(peer, now)


def play(scene: Coroutine[object, object, None]) -> None:
    run_virtual(scene)


WAITS = st.lists(st.sampled_from([0.0, 0.0, 0.5, 1.5, 2.5, math.inf]), max_size=3)
Step: TypeAlias = tuple[int, bool, list[float], list[float]]


def plan(steps: list[Step], end: float, *, inward: bool) -> tuple[list[tuple[float, int]], int]:
    """When the packets of one direction arrive, and how many are lost; what is left at the end comes then, in order."""
    at = 0.0
    due: list[tuple[float, float, int, int]] = []
    lost = 0
    for number, (pause, is_inward, first, second) in enumerate(steps):
        at += pause
        both = [a + b for a in first for b in second] if is_inward else first
        lost += not both
        for wait in both[:MOST_COPIES]:
            due.append((min(at + wait, end), at + wait, len(due), number))
    of_direction = [one for one in sorted(due) if steps[one[3]][1] is inward]
    return [(when, number) for when, _, _, number in of_direction], lost


@given(st.lists(st.tuples(st.integers(0, 2), st.booleans(), WAITS, WAITS), max_size=12))
def test_packets_arrive_when_they_are_due_and_the_rest_when_the_treatments_end(steps: list[Step]) -> None:
    async def scene() -> None:
        loop = asyncio.get_running_loop()
        wire, heard = Wire(), list[tuple[float, bytes]]()
        all_of, inward = Script(), Script(inward=True)
        link = DisturbedLink(wire, all_of)
        link.add(inward)
        link.attach(packet=lambda packet, _peer, now: heard.append((now, packet)))
        for number, (pause, is_inward, all_of.now, inward.now) in enumerate(steps):
            await asyncio.sleep(pause)
            if is_inward:
                wire.say(bytes([number]))
            else:
                link.send(bytes([number]), "peer")
        await asyncio.sleep(1.0)
        end = loop.time()
        link.remove(all_of)
        assert not link.is_idle
        link.remove(inward)
        assert link.is_idle
        await asyncio.sleep(10.0)  # timers of what has been carried early find nothing
        for is_inward, arrived in ((False, wire.got), (True, heard)):
            due, lost = plan(steps, end, inward=is_inward)
            assert [(at, packet[0]) for at, packet in arrived] == due
            assert link.counters.dropped.get(LOST, 0) == lost

    play(scene())


def test_the_timer_of_a_packet_that_was_carried_early_leaves_the_next_one_alone() -> None:
    async def scene() -> None:
        wire, one, other = Wire(), Script(), Script()
        link = DisturbedLink(wire, one, other)
        one.now = (2.0,)
        link.send(b"early", "peer")
        await asyncio.sleep(1.0)
        link.remove(one)
        other.now = (5.0,)
        link.send(b"late", "peer")
        await asyncio.sleep(10.0)
        assert wire.got == [(1.0, b"early"), (6.0, b"late")]

    play(scene())


@pytest.mark.parametrize("in_bursts", [False, True])
@pytest.mark.parametrize("is_attached", [False, True])
def test_a_late_packet_is_a_burst_of_its_own_on_links_that_have_bursts(in_bursts: bool, is_attached: bool) -> None:
    async def scene() -> None:
        wire, script, ends = Wire(in_bursts=in_bursts), Script(), list[float]()
        link = DisturbedLink(wire, script)
        loop = asyncio.get_running_loop()
        if is_attached:
            link.attach(burst_end=lambda: ends.append(loop.time()))
            link.attach(packet=lambda *_: None)  # what was attached before stays
        script.now = (0.0, 1.0, 2.0)
        link.send(b"x", "peer")
        await asyncio.sleep(5.0)
        assert [at for at, _ in wire.got] == [0.0, 1.0, 2.0]
        assert ends == ([1.0, 2.0] if in_bursts and is_attached else [])

    play(scene())


def test_a_peer_that_takes_nothing_is_told_once_when_it_does_and_the_others_go_on() -> None:
    async def scene() -> None:
        wire, one, two, rooms = Wire(), Script(), Script(), list[tuple[float, Peer | None]]()
        link = DisturbedLink(wire, one, two)
        loop = asyncio.get_running_loop()
        failed: list[object] = []
        loop.set_exception_handler(lambda _, context: failed.append(context))
        link.attach(room=lambda peer: rooms.append((loop.time(), peer)))
        link.attach(packet=lambda *_: None)
        one.free, two.free = {"busy": 2.0, "never": math.inf}, {"busy": 3.0}
        for _ in range(3):
            assert (link.has_room("busy"), link.has_room("never"), link.has_room("other")) == (False, False, True)
        with pytest.raises(LinkFull, match="takes no packet now, on purpose"):
            link.send(b"x", "busy")
        link.send(b"y", "other")
        wire.is_full = True
        assert not link.has_room("other")
        wire.is_full = False
        await asyncio.sleep(5.0)
        assert rooms == [(3.0, "busy")]
        assert link.has_room("busy")
        one.free = {"busy": 9.0}
        assert not link.has_room("busy")
        link.remove(one)
        assert rooms == [(3.0, "busy"), (5.0, None)]
        await asyncio.sleep(10.0)
        assert (len(rooms), failed) == (2, []), "the timer is gone"
        assert [packet for _, packet in wire.got] == [b"y"]

    play(scene())


def test_without_a_handler_for_room_nobody_is_told() -> None:
    async def scene() -> None:
        wire, script = Wire(), Script()
        link = DisturbedLink(wire, script)
        loop = asyncio.get_running_loop()
        failed: list[object] = []
        loop.set_exception_handler(lambda _, context: failed.append(context))
        script.free = {"busy": 2.0}
        assert not link.has_room("busy")
        await asyncio.sleep(3.0)
        link.remove(script)
        assert link.has_room("busy")
        assert failed == []

    play(scene())


def test_what_is_held_back_beyond_the_bound_is_lost_and_what_finds_no_room_later_is_counted() -> None:
    async def scene() -> None:
        wire, script = Wire(), Script()
        link = DisturbedLink(wire, script)
        script.now = (1.0,)
        for _ in range(MOST_HELD + 2):
            link.send(b"x", "peer")
        assert link.counters.dropped == {"lost on purpose: too many held back": 2}
        await asyncio.sleep(2.0)
        assert len(wire.got) == MOST_HELD
        link.send(b"x", "peer")
        wire.is_full = True
        await asyncio.sleep(2.0)
        assert link.counters.dropped["held back, then not sent: LinkFull"] == 1

    play(scene())


class Dice(Random):
    """Always throws the same."""

    def __init__(self, value: float) -> None:
        super().__init__(0)
        self.value = value

    def random(self) -> float:
        return self.value


@pytest.mark.parametrize(
    ("thrown", "chances", "waits"),
    [
        (0.0, {}, [0.0]),
        (0.5, {"drop": 0.5}, [0.0]),
        (0.49, {"drop": 0.5}, []),
        (0.5, {"duplicate": 0.5}, [0.0]),
        (0.49, {"duplicate": 0.5}, [0.0, 0.0]),
        (0.5, {"reorder": 0.5, "overtaken_s": 3.0}, [0.0]),
        (0.49, {"reorder": 0.5, "overtaken_s": 3.0}, [3.0]),
        (0.25, {"delay": 2.0, "jitter": 8.0}, [4.0]),
        (0.25, {"delay": 2.0}, [2.0]),
        (0.25, {"delay": 2.0, "jitter": 8.0, "reorder": 1.0, "overtaken_s": 1.0, "duplicate": 1.0}, [5.0, 5.0]),
    ],
)
def test_a_chance_is_taken_below_its_probability(thrown: float, chances: dict[str, float], waits: list[float]) -> None:
    assert list(Disturbance(Dice(thrown), **chances).delays("peer", 1.0, inward=True)) == waits
