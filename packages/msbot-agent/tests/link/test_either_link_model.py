"""A part with several masters beside a plain model of it, in stories made by chance; and what becomes of ways."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field
from random import Random

import pytest

from msbot.process.virtual_time import run_virtual
from msbot_agent.link import BaseLink, LinkInfo, Peer, Signal
from msbot_agent.link import failover_link as either_link
from msbot_agent.link.failover_link import ANOTHER, MASTER, FailoverLink
from msbot_agent.link.net.udp import NOBODY_LISTENS
from msbot_xrce.errors import LinkDown
from tests.effort import tries

NAMES = ("one", "two", "three")
Told = tuple[object, ...]


class Way(BaseLink):
    """A link to one master that does what the test says."""

    def __init__(self, name: str) -> None:
        super().__init__(LinkInfo(name, 1000 + len(name)), remote=name)
        self.got: list[bytes] = []
        self.ends: list[float] = []
        self.course: list[tuple[float, Exception | None]] = []
        """Of each time that it is run: how long, and with what it ends."""

    def has_room(self, peer: Peer) -> bool:
        return peer == self.remote

    def send(self, packet: bytes, peer: Peer) -> None:
        assert peer == self.remote
        self.got.append(packet)

    def describe(self, peer: Peer) -> str:
        return str(peer)

    async def run(self) -> None:
        seconds, error = self.course.pop(0) if self.course else (1e9, None)
        try:
            await asyncio.sleep(seconds)
        finally:
            self.ends.append(asyncio.get_running_loop().time())
        if error is not None:
            raise error


@dataclass
class Plain:
    """What is in use, and what is told."""

    told: list[Told] = field(default_factory=list)
    dropped: int = 0
    up: set[int] = field(default_factory=set)
    current: int = 0
    asked_at: float | None = None
    answered: bool = False
    refused: list[int] = field(default_factory=lambda: [0, 0, 0])
    refused_before: int = 0

    def signal(self, number: int, signal: Signal, words: str, now: float) -> None:
        if signal is Signal.LINK_UP:
            if not self.up:
                self.current = number
            self.up.add(number)
            if number == self.current:
                self.told.append((signal, MASTER, NAMES[number], now))
        elif signal is Signal.LINK_DOWN:
            self.up.discard(number)
            if number == self.current:
                self.leave(words, now)
                if not self.up:
                    self.told.append((signal, MASTER, words, now))
        elif signal is Signal.STOP and number == self.current:
            self.told.append((signal, "someone", words, now))

    def leave(self, words: str, now: float) -> None:
        before = self.current
        self.asked_at = None
        others = self.up - {before}
        if others:
            self.current = min(others, key=lambda one: (one - before) % 3)
        self.refused_before = self.refused[self.current]
        if others:
            if self.answered:
                self.told.append((Signal.LINK_DOWN, MASTER, words, now))
            self.answered = False
            self.told.append((Signal.LINK_UP, MASTER, NAMES[self.current], now))

    def look(self, now: float) -> None:
        patience, name = 2.25 if self.answered else 0.5, NAMES[self.current]
        if self.refused[self.current] != self.refused_before:
            self.leave(f"nobody listens at {name}", now)
        elif self.asked_at is not None and now - self.asked_at > patience:
            self.leave(f"no answer from {name} for {patience:g} s", now)


async def story(seed: int) -> None:
    random, loop, ways, plain = Random(seed), asyncio.get_running_loop(), [Way(name) for name in NAMES], Plain()
    link, told, gone = FailoverLink(ways), list[Told](), 0
    assert (link.info.name, link.info.mtu, link.remote) == ("one,two,three", 1003, MASTER)
    link.attach(packet=lambda *what: told.append(what))
    link.attach(signal=lambda *what: told.append(what))
    link.attach(room=lambda peer: told.append(("room", peer)))
    running = asyncio.ensure_future(link.run())
    for step in range(400):
        for _ in range(random.choice((0, 0, 1, 2, 5, 20))):
            await asyncio.sleep(0.125)
            for _ in range(4):  # it looks, before anything else happens
                await asyncio.sleep(0)
            plain.look(loop.time())
        now, number, packet = loop.time(), random.choice((plain.current, random.randrange(3))), bytes((step % 256,))
        way = ways[number]
        match random.choice("sssssppuuudtgrn"):
            case "s":
                way, got = ways[plain.current], [*ways[plain.current].got]
                assert link.has_room(MASTER)
                link.send(packet, MASTER)
                plain.asked_at = now if plain.asked_at is None else plain.asked_at
                assert way.got == [*got, packet]
                gone += 1
            case "p":
                way._packet_handler(packet, way.remote, now)
                if number == plain.current:
                    plain.asked_at, plain.answered = None, True
                    plain.told.append((packet, MASTER, now))
                else:
                    plain.dropped += 1
            case "r":
                way._room_handler(way.remote)
                plain.told += [("room", None)] if number == plain.current else []
            case "n":
                way.counters.dropped.count(NOBODY_LISTENS)
                plain.refused[number] += 1
            case kind:
                signal = {"u": Signal.LINK_UP, "d": Signal.LINK_DOWN, "t": Signal.STOP, "g": Signal.PEER_GONE}[kind]
                way._signal_handler(signal, "someone", f"at {step}", now)
                plain.signal(number, signal, f"at {step}", now)
        assert told == plain.told
        assert link.in_use is ways[plain.current]
        assert link.counters.dropped.get(ANOTHER, 0) == plain.dropped
        assert (link.counters.packets_out, link.counters.bytes_out) == (gone, gone)
    running.cancel()
    await asyncio.wait([running])
    assert [way.ends for way in ways] == [[loop.time()]] * 3, "its ways end with it"


@pytest.mark.parametrize("seed", range(tries(8, 1000)))
def test_whatever_happens_the_same_master_is_in_use(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in (("LOOK_S", 0.125), ("PATIENCE_S", 2.25), ("TRY_S", 0.5)):  # sums of these are exact
        monkeypatch.setattr(either_link, name, value)
    run_virtual(story(seed))


async def test_only_the_master_is_spoken_to_and_only_over_a_way_that_is_open() -> None:
    ways = [Way("one"), Way("two")]
    link = FailoverLink(ways)
    with pytest.raises(LinkDown, match="not to one"):
        link.send(b"x", "one")
    ways[0].remote = None
    with pytest.raises(LinkDown, match="to the master"):
        link.send(b"x", MASTER)
    assert (ways[0].got, link.counters.packets_out) == ([], 0)
    assert (link.describe(MASTER), link.describe(7)) == ("the master at one", "nobody (7)")


NEVER = 1e9


def outcome(*courses: list[tuple[float, Exception | None]], up: dict[int, float], seconds: float) -> object:
    """How a link whose ways take that course is after so many seconds; `up`: when which of them says it is open."""

    async def main() -> object:
        ways = [Way(name) for name in NAMES[: len(courses)]]
        for way, course in zip(ways, courses, strict=True):
            way.course = course
        running = asyncio.ensure_future(FailoverLink(ways).run())
        loop = asyncio.get_running_loop()
        for number, at in up.items():
            open_up: Callable[..., None] = ways[number]._signal_handler
            loop.call_at(at, open_up, Signal.LINK_UP, None, "", at)
        await asyncio.wait([running], timeout=seconds)
        if not running.done():
            running.cancel()
            await asyncio.wait([running])
            return "runs"
        return str(running.exception())

    return run_virtual(main())


def test_it_gives_up_when_every_way_has_failed_and_none_is_open() -> None:
    broken, slow = (0.0, LinkDown("broken")), (NEVER, None)
    assert outcome([slow], [slow], up={}, seconds=60.0) == "runs", "they take their time"
    assert outcome([broken], [broken], up={}, seconds=60.0) == "broken"
    assert outcome([broken] * 99, [slow], up={}, seconds=60.0) == "runs"
    assert outcome([broken] * 99, [(5.0, LinkDown("late"))], up={}, seconds=60.0) == "late"


def test_a_way_that_is_tried_again_counts_as_one_that_may_open() -> None:
    again: list[tuple[float, Exception | None]] = [(0.0, LinkDown("broken")), (NEVER, None)]
    assert outcome(again, [(3.0, LinkDown("late"))], up={}, seconds=60.0) == "runs"
    assert outcome([(0.0, LinkDown("broken"))] * 2, [(0.95, LinkDown("late"))], up={}, seconds=60.0) == "broken"
