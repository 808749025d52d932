"""The master's end of a relay, with a way that keeps what it is given: one message at a time."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

import pytest

from msbot.process.virtual_time import run_virtual
from msbot_agent.link import BaseLink, LinkInfo, Peer, Signal
from msbot_agent.link.relay.forwarder import COUNTS, SILENT_S, STOP_TIMES
from msbot_agent.link.relay.relay_messages import (
    Down,
    Event,
    Heard,
    Hello,
    Message,
    RelayBeat,
    RelayEventKind,
    Room,
    Up,
    Welcome,
    decode,
)
from msbot_agent.link.relay.relayed_link import FORGOTTEN_S, STALE_S, WINDOW, RelayedLink, RelayedPeer, RelayGreeting
from msbot_xrce.errors import LinkDown, LinkFull
from tests.link.ends import End

BOOT = b"boot 123"
HELLO = Hello(BOOT, "pi", "can:can0", 4096, 0, shared_bus=True, compresses=True)
FIRST = RelayedPeer("pi", 1)


class Way(BaseLink):
    """The link on which the relay speaks."""

    def __init__(self) -> None:
        super().__init__(LinkInfo("udp:1", 1000))
        self.sent: list[Message] = []
        self.fault: Exception | None = None
        self.room = True

    def has_room(self, peer: Peer) -> bool:
        return self.room

    def describe(self, peer: Peer) -> str:
        return "10.0.0.2"

    async def run(self) -> None:
        raise AssertionError("the relay's link does not run the way")

    def send(self, packet: bytes, peer: Peer) -> None:
        if self.fault is not None:
            raise self.fault
        self.sent.append(decode(packet))

    def taken(self) -> list[Message]:
        """What was sent since the last time."""
        sent, self.sent = self.sent, []
        return sent


class Stage:
    """A relay that has introduced itself."""

    def __init__(self) -> None:
        self.way = Way()
        self.link = RelayedLink(HELLO, self.way, ("10.0.0.2", 5), RelayGreeting(77))
        self.end = End(self.link)
        self.running: asyncio.Task[None] | None = None

    def hear(self, *messages: Message) -> None:
        for message in messages:
            self.link.receive(message, asyncio.get_running_loop().time())

    def signals(self) -> list[tuple[Signal, Any, str]]:
        return [self.end.signals.get_nowait() for _ in range(self.end.signals.qsize())]


def play(scene: Callable[[Stage], Awaitable[None]]) -> None:
    async def main() -> None:
        stage = Stage()
        stage.running = asyncio.create_task(stage.link.run())
        await asyncio.sleep(0)
        await scene(stage)
        stage.running.cancel()
        await asyncio.gather(stage.running, return_exceptions=True)

    run_virtual(main())


def test_it_is_like_the_link_that_the_relay_carries() -> None:
    info = Stage().link.info
    assert (info.name, info.mtu) == ("can:can0 behind relay pi", 992)  # an envelope fits around each packet
    assert (info.bits_per_second, info.shared_bus, info.compresses) == (None, True, True)


def test_packets_go_both_ways_and_are_counted_for_each_part() -> None:
    async def scene(stage: Stage) -> None:
        link = stage.link
        assert not link.was_used
        with pytest.raises(LinkDown, match="there is no such part behind the relay pi"):
            link.send(b"x", FIRST)
        stage.hear(Up(1, "node 3", b"up"), Up(2, "", b"other"))
        assert stage.end.packets.get_nowait() == (b"up", FIRST)
        assert link.was_used
        assert link.describe(FIRST) == "node 3 behind relay pi"
        assert link.describe(RelayedPeer("pi", 2)) == "part 2 behind relay pi"
        stage.hear(Up(1, "", b"again"))
        assert link.describe(FIRST) == "node 3 behind relay pi"
        stage.hear(Up(1, "node 4", b"again"))
        assert link.describe(FIRST) == "node 4 behind relay pi"
        link.send(b"one", FIRST)
        link.send(b"two", FIRST)
        link.send(b"three", RelayedPeer("pi", 2))
        assert stage.way.taken() == [Down(1, 1, b"one"), Down(1, 2, b"two"), Down(2, 1, b"three")]
        assert link.counters.packets_out == 3
        assert not link.has_room(("10.0.0.1", 5))
        assert not link.has_room(RelayedPeer("pi", 3))

    play(scene)


def test_one_packet_is_use_and_the_relay_answers_for_all_its_parts() -> None:
    async def scene(stage: Stage) -> None:
        stage.hear(Up(1, "", b"up"))
        assert stage.link.was_used
        assert stage.link.origin(FIRST) == stage.link.origin(RelayedPeer("pi", 2)) == ("udp:1", ("10.0.0.2", 5))
        stage.link.room_on_the_way()
        assert stage.end.room.get_nowait() is None
        stage.link.send_stop()
        assert stage.way.taken()[-1] == Heard(0, 0, 1, 0)

    play(scene)


@pytest.mark.parametrize(("mtu", "of_way", "left"), [(4096, 1000, 992), (500, 1000, 500), (0, 1000, 1), (500, 9, 1)])
def test_a_packet_is_as_long_as_both_links_can_carry(mtu: int, of_way: int, left: int) -> None:
    way = Way()
    way.info = LinkInfo("udp:1", of_way)
    hello = Hello(BOOT, "pi", "can:can0", mtu, 0, shared_bus=True, compresses=True)
    assert RelayedLink(hello, way, "a", RelayGreeting(77)).info.mtu == left


def test_so_many_are_on_the_way_to_a_part_until_the_relay_reports() -> None:
    async def scene(stage: Stage) -> None:
        stage.hear(Up(1, "", b"up"))
        for _ in range(WINDOW):
            assert stage.link.has_room(FIRST)
            stage.link.send(b"x", FIRST)
        assert not stage.link.has_room(FIRST)
        with pytest.raises(LinkFull, match="8 packets are on their way to part 1 behind relay pi"):
            stage.link.send(b"x", FIRST)
        stage.hear(Room(((1, 65535), (2, 5))))  # late, and of a part that nobody knows
        assert not stage.link.has_room(FIRST)
        assert stage.end.room.empty()
        stage.hear(Room(((1, 3),)))
        assert stage.end.room.get_nowait() == FIRST
        assert stage.link.has_room(FIRST)
        stage.hear(Room(((1, 4),)), Room(((1, 2),)))
        assert stage.end.room.empty()  # there was room already
        for _ in range(4):
            stage.link.send(b"x", FIRST)
        assert not stage.link.has_room(FIRST)
        stage.way.room = False
        stage.hear(Room(((1, 12),)))
        assert not stage.link.has_room(FIRST)  # the way itself is full

    play(scene)


def test_without_a_report_packets_count_as_lost_after_a_while() -> None:
    async def scene(stage: Stage) -> None:
        stage.hear(Up(1, "", b"up"))
        for _ in range(WINDOW):
            stage.link.send(b"x", FIRST)
        await asyncio.sleep(STALE_S / 2)
        assert not stage.link.has_room(FIRST)
        await asyncio.sleep(2 * STALE_S)
        assert stage.end.room.get_nowait() == FIRST
        assert stage.link.has_room(FIRST)

    play(scene)


def test_numbers_begin_again_after_65535() -> None:
    async def scene(stage: Stage) -> None:
        stage.hear(Up(1, "", b"up"))
        part = stage.link._parts[1]
        part.sent = part.handled = COUNTS - 4
        for count in range(COUNTS - 3, COUNTS + 3):
            stage.link.send(b"x", FIRST)
            stage.hear(Room(((1, count % COUNTS),)))
        assert [message.count for message in stage.way.taken()[-4:] if isinstance(message, Down)] == [65535, 0, 1, 2]
        assert stage.link.has_room(FIRST)

    play(scene)


def test_every_beat_is_answered_and_each_stop_is_said_once() -> None:
    async def scene(stage: Stage) -> None:
        stage.signals()
        for stops, heard, said in ((0, 0, []), (1, 1, ["button"]), (1, 1, []), (2, 2, ["button"]), (0, 2, [])):
            stage.hear(RelayBeat(9, stops, "button"))
            assert stage.way.taken() == [Heard(9, heard, 0, 0)]
            assert [words for signal, _, words in stage.signals() if signal is Signal.STOP] == said
        stage.way.fault = LinkFull("full")
        stage.hear(RelayBeat(10, 0, ""))
        assert stage.link.counters.dropped == {"answer to the relay: no room": 1}

    play(scene)


def test_stop_is_sent_several_times_and_with_every_beat() -> None:
    async def scene(stage: Stage) -> None:
        stage.link.send_stop(7)
        assert stage.way.taken() == [Heard(0, 0, 1, 7)] * STOP_TIMES
        stage.hear(RelayBeat(3, 0, ""))
        assert stage.way.taken() == [Heard(3, 0, 1, 7)]
        stage.link.send_stop(8)
        assert stage.way.taken() == [Heard(0, 0, 2, 8)] * STOP_TIMES
        stage.link.welcome(stage.way, ("10.0.0.3", 6), 0.0)
        assert stage.way.taken() == [Welcome(BOOT, 77, 2)]
        stage.way.fault = LinkDown("down")
        with pytest.raises(LinkDown):
            stage.link.send_stop(1)

    play(scene)


def test_the_stop_after_65535_others_is_said_with_number_1_as_0_means_none() -> None:
    async def scene(stage: Stage) -> None:
        stage.link._stops = COUNTS - 2
        stage.link.send_stop(7)
        stage.way.taken()
        stage.hear(RelayBeat(3, 0, ""))
        assert stage.way.taken() == [Heard(3, 0, 65535, 7)]
        stage.link.send_stop(8)
        assert stage.way.taken() == [Heard(0, 0, 1, 8)] * STOP_TIMES

    play(scene)


def test_what_happens_to_a_part_is_told() -> None:
    async def scene(stage: Stage) -> None:
        stage.signals()
        events = (
            Event(1, RelayEventKind.CAME, "node 1"),
            Event(1, RelayEventKind.GONE, "silent"),
            Event(1, RelayEventKind.BACK, "back"),
        )
        stage.hear(RelayBeat(1, 0, "", events))
        assert stage.signals() == [
            (Signal.PEER_JOINED, FIRST, "node 1"),
            (Signal.PEER_GONE, FIRST, "silent"),
            (Signal.PEER_BACK, FIRST, "back"),
        ]
        assert stage.link.describe(FIRST) == "node 1 behind relay pi"

    play(scene)


def test_a_relay_is_silent_back_and_in_the_end_forgotten() -> None:
    async def scene(stage: Stage) -> None:
        stage.hear(Up(1, "", b"up"))
        stage.signals()
        await asyncio.sleep(SILENT_S - 0.6)
        assert stage.link.has_room(FIRST)
        await asyncio.sleep(1.2)
        assert stage.link.is_silent
        assert stage.signals() == [(Signal.PEER_GONE, FIRST, "the relay pi is silent")]
        assert not stage.link.has_room(FIRST)
        with pytest.raises(LinkDown, match="the relay pi is silent"):
            stage.link.send(b"x", FIRST)
        stage.hear(RelayBeat(1, 0, ""))
        assert stage.signals() == [(Signal.PEER_BACK, FIRST, "the relay is back")]
        assert stage.end.room.get_nowait() is None
        assert stage.link.has_room(FIRST)
        assert stage.running is not None
        await asyncio.sleep(FORGOTTEN_S - 1)
        assert not stage.running.done()
        await asyncio.sleep(2)
        assert stage.running.done()
        assert stage.signals()[-1] == (Signal.LINK_DOWN, None, "closed")

    play(scene)


def test_after_its_end_it_takes_nothing() -> None:
    async def scene(stage: Stage) -> None:
        stage.hear(Up(1, "", b"up"))
        assert stage.link.has_room(FIRST)
        stage.link.end()
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        assert stage.running is not None
        assert stage.running.done()
        assert not stage.link.has_room(FIRST)
        with pytest.raises(LinkDown):
            stage.link.send(b"x", FIRST)

    play(scene)
