"""The master's end of a relay beside a plain one, which counts without end and searches lists, in stories by chance."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field
from random import Random

import pytest

from msbot.process.virtual_time import run_virtual
from msbot_agent.link import Peer, Signal
from msbot_agent.link.relay import relayed_link
from msbot_agent.link.relay.relay_messages import (
    Down,
    Event,
    Heard,
    Message,
    RelayBeat,
    RelayEventKind,
    Room,
    Up,
    Welcome,
)
from msbot_agent.link.relay.relayed_link import RelayedLink, RelayedPeer, RelayGreeting
from msbot_xrce.errors import LinkDown, LinkFull
from tests.effort import tries
from tests.link.relay.test_relayed_link import BOOT, HELLO, Way

KNOWN, WINDOW = 4, 3
"""Small bounds, so that each is reached often."""
Told = tuple[object, ...]
SIGNALS = {
    RelayEventKind.CAME: Signal.PEER_JOINED,
    RelayEventKind.GONE: Signal.PEER_GONE,
    RelayEventKind.BACK: Signal.PEER_BACK,
}


@dataclass
class PlainPart:
    number: int
    words: str = ""
    sent: int = 0
    handled: int = 0
    stale_at: float = 0.0

    @property
    def is_full(self) -> bool:
        return self.sent - self.handled >= WINDOW


@dataclass
class PlainLink:
    """What the link does; its numbers have no end."""

    base: int
    """How many packets each part is taken to have had before."""
    parts: list[PlainPart] = field(default_factory=list)
    """The one longest without news first."""
    told: list[Told] = field(default_factory=list)
    said: list[Message] = field(default_factory=list)
    stops: int = 0
    reason: int = 0
    stops_said: int = 0
    heard_at: float = 0.0
    silent: bool = False
    over: bool = False

    def find(self, number: int) -> PlainPart | None:
        return next((one for one in self.parts if one.number == number), None)

    def note(self, number: int, words: str) -> None:
        part = self.find(number) or PlainPart(number, sent=self.base, handled=self.base)
        part.words = words
        self.parts = [*(one for one in self.parts if one is not part), part][-KNOWN:]

    def signal(self, signal: Signal, number: int, words: str, now: float) -> None:
        self.told.append((signal, RelayedPeer("pi", number), words, now))

    def heard(self, now: float) -> None:
        self.heard_at = now
        if self.silent:
            self.silent = False
            for part in self.parts:
                self.signal(Signal.PEER_BACK, part.number, "the relay is back", now)
            self.told.append(("room", None))

    def receive(self, message: Message, now: float) -> None:
        self.heard(now)
        if isinstance(message, Up):
            if message.words or self.find(message.number) is None:
                self.note(message.number, message.words)
            self.told.append((message.packet, RelayedPeer("pi", message.number), now))
        elif isinstance(message, Room):
            for number, count in message.handled:
                self.report(number, count)
        elif isinstance(message, RelayBeat):
            for event in message.events:
                if event.what is RelayEventKind.CAME:
                    self.note(event.number, event.words)
                self.signal(SIGNALS[event.what], event.number, event.words, now)
            is_new = message.stops_said not in (0, self.stops_said)
            self.stops_said = message.stops_said or self.stops_said
            self.said.append(Heard(message.count, self.stops_said, self.stops, self.reason))
            if is_new:
                self.told.append((Signal.STOP, None, message.words, now))

    def report(self, number: int, count: int) -> None:
        part = self.find(number)
        meant = [] if part is None else [one for one in range(part.handled, part.sent + 1) if one % 65536 == count]
        if part is not None and meant:
            was_full, part.handled = part.is_full, meant[0]
            if was_full:
                self.told.append(("room", RelayedPeer("pi", number)))

    def look(self, now: float) -> None:
        silence = now - self.heard_at
        if silence > 60.0:
            self.over = True
        elif silence > 2.0 and not self.silent:
            self.silent = True
            for part in self.parts:
                self.signal(Signal.PEER_GONE, part.number, "the relay pi is silent", now)
        for part in self.parts:
            if part.is_full and now >= part.stale_at:
                part.handled = part.sent
                self.told.append(("room", RelayedPeer("pi", part.number)))

    def send(self, number: int, packet: bytes, now: float) -> type[Exception] | None:
        part = self.find(number)
        if self.silent or self.over or part is None:
            return LinkDown
        if part.is_full:
            return LinkFull
        part.sent += 1
        part.stale_at = now + 0.5
        self.said.append(Down(number, part.sent % 65536, packet))
        return None


def attempt(link: RelayedLink, packet: bytes, peer: Peer) -> type[Exception] | None:
    try:
        link.send(packet, peer)
    except (LinkDown, LinkFull) as error:
        return type(error)
    return None


async def let_pass(quarters: int, plain: PlainLink) -> None:
    """Quarters of a second; each half second the link looks, before anything else happens."""
    loop = asyncio.get_running_loop()
    for _ in range(quarters):
        await asyncio.sleep(0.25)
        for _ in range(4):
            await asyncio.sleep(0)
        if loop.time() % 0.5 == 0 and not plain.over:
            plain.look(loop.time())


async def story(seed: int) -> None:
    random, way, loop = Random(seed), Way(), asyncio.get_running_loop()
    base = random.choice((0, 65530))
    link, plain = RelayedLink(HELLO, way, "a", RelayGreeting(77)), PlainLink(base)
    told: list[Told] = []
    link.attach(packet=lambda *what: told.append(what))
    link.attach(signal=lambda *what: told.append(what))
    link.attach(room=lambda peer: told.append(("room", peer)))
    running = asyncio.ensure_future(link.run())
    assert not link.has_room(RelayedPeer("pi", 1))
    await asyncio.sleep(0)
    plain.told.append((Signal.LINK_UP, None, "from 10.0.0.2", 0.0))
    for step in range(300):
        await let_pass(random.choice((0, 0, 0, 0, 1, 2)), plain)
        now, number = loop.time(), random.randrange(1, 7)
        part, packet = plain.find(number), bytes((step % 200,))
        counts = (part.handled, part.handled + 1, part.sent, part.sent + 1, part.handled - 1) if part else (0,)
        event = Event(number, random.choice([*RelayEventKind]), f"at {step}")
        match random.choice("uurrrbsssssswxl"):
            case "u":
                message: Message = Up(number, random.choice(("", f"n{step}")), packet)
            case "r":
                message = Room(((number, random.choice(counts) % 65536),))
            case "b":
                stops = plain.stops_said + random.choice((0, 0, 1))
                message = RelayBeat(step, random.choice((0, stops)), f"no {step}", (event,) * random.randrange(2))
            case "s":
                assert attempt(link, packet, RelayedPeer("pi", number)) == plain.send(number, packet, now)
                continue
            case "w":
                link.welcome(way, "a", now)
                plain.said.append(Welcome(BOOT, 77, plain.stops))
                plain.heard(now)
                continue
            case "x":
                link.send_stop(step % 256)
                plain.stops, plain.reason = plain.stops + 1, step % 256
                plain.said += [Heard(0, plain.stops_said, plain.stops, step % 256)] * 3
                continue
            case _:
                await let_pass(random.choice((2, 8, 9, 10, 12)), plain)
                continue
        was_known = number in link._parts
        link.receive(message, now)
        plain.receive(message, now)
        if not was_known and number in link._parts:
            fresh = link._parts[number]
            fresh.sent = fresh.handled = base
        assert told == plain.told
        for one in range(1, 7):
            part = plain.find(one)
            can_go = part is not None and not part.is_full and not plain.silent
            assert link.has_room(RelayedPeer("pi", one)) == can_go
            place = part.words if part is not None and part.words else f"part {one}"
            assert link.describe(RelayedPeer("pi", one)) == f"{place} behind relay pi"
    assert way.taken() == plain.said
    plain.heard_at = loop.time()
    link.receive(Room(()), loop.time())
    await let_pass(4 * 60, plain)
    assert (plain.over, running.done()) == (False, False)
    await let_pass(3, plain)
    assert (plain.over, running.done()) == (True, True)
    assert not link.has_room(RelayedPeer("pi", 1))


@pytest.mark.parametrize("seed", range(tries(14, 1000)))
def test_whatever_happens_the_link_does_what_the_plain_one_does(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(relayed_link, "MOST_PARTS", KNOWN // 2)
    monkeypatch.setattr(relayed_link, "WINDOW", WINDOW)
    run_virtual(story(seed))
