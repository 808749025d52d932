"""The relay's state beside a plain one, which keeps lists and searches through them, in stories made by chance."""

from __future__ import annotations

from dataclasses import dataclass, field
from random import Random

import pytest

from msbot_agent.link import LinkInfo, Peer
from msbot_agent.link.relay import forwarder as relay_forwarder
from msbot_agent.link.relay.forwarder import (
    FULL_DOWN,
    FULL_UP,
    NOBODY,
    STRANGE,
    UNREADABLE,
    Forwarder,
    ForwarderEvent,
    MasterBack,
    MasterSilent,
    StopSaid,
    Welcomed,
)
from msbot_agent.link.relay.relay_messages import (
    Bye,
    Down,
    Event,
    Heard,
    Hello,
    Message,
    Refused,
    RelayBeat,
    RelayEventKind,
    Room,
    Up,
    Welcome,
    Who,
    decode,
    encode,
)
from tests.effort import tries

BOOT = b"boot 123"
PARTS, PACKETS, ROOMS, EVENTS = 4, 3, 2, 2
"""Small bounds, so that each is reached often."""
HELLO = Hello(BOOT, "pi", "can:can0", 4096, 0, shared_bus=True, compresses=False)


@dataclass
class PlainPart:
    number: int
    peer: Peer
    heard: int
    """When something was last heard of it, or about it."""
    known: bool = False
    up: list[bytes] = field(default_factory=list)
    down: list[tuple[int, bytes]] = field(default_factory=list)
    up_turn: int = 0
    down_turn: int = 0
    """Since when it has been waiting for its turn."""


@dataclass
class PlainRelay:
    """What a relay does, with lists that are searched through."""

    parts: list[PlainPart] = field(default_factory=list)
    said: list[Message] = field(default_factory=list)
    rooms: list[tuple[int, int]] = field(default_factory=list)
    told: list[ForwarderEvent] = field(default_factory=list)
    dropped: list[str] = field(default_factory=list)
    unconfirmed: list[tuple[Event, int]] = field(default_factory=list)
    """And the latest beat that had it."""
    beats: int = 0
    stops_said: int = 0
    stop: tuple[int, str] = (0, "")
    stops_heard: int | None = None
    welcome: bool = False
    heard_at: float | None = None
    silent_since: float | None = 0.0
    is_told: bool = False
    due: float = 0.0
    number: int = 0
    clock: int = 0

    def tick(self) -> int:
        self.clock += 1
        return self.clock

    def part(self, peer: Peer) -> PlainPart:
        found = [one for one in self.parts if one.peer == peer]
        if not found:
            if len(self.parts) == PARTS:
                oldest = min(self.parts, key=lambda one: one.heard)
                self.parts.remove(oldest)
                self.rooms = [one for one in self.rooms if one[0] != oldest.number]
            self.number += 1
            found = [PlainPart(self.number, peer, 0)]
            self.parts += found
        found[0].heard = self.tick()
        return found[0]

    def from_part(self, packet: bytes, peer: Peer) -> None:
        part = self.part(peer)
        if len(part.up) == PACKETS:
            self.dropped.append(FULL_UP)
            return
        if not part.up:
            part.up_turn = self.tick()
        part.up.append(packet)

    def part_event(self, peer: Peer, what: RelayEventKind, words: str, now: float) -> None:
        if what is RelayEventKind.GONE and peer not in [one.peer for one in self.parts]:
            return
        number = self.part(peer).number
        words = f"CAN node {peer}" if what is RelayEventKind.CAME else words
        self.unconfirmed = [*self.unconfirmed, (Event(number, what, words), 0)][-PARTS:]
        self.beat(now)

    def stop_heard(self, words: str, now: float) -> None:
        self.stops_said += 1
        self.stop = (self.stops_said, words)
        for _ in range(3):
            self.beat(now)

    def say(self, message: Message) -> None:
        self.said = [*self.said, message][-64:]

    def beat(self, now: float) -> None:
        self.beats += 1
        first = [event for event, _ in self.unconfirmed[:EVENTS]]
        self.unconfirmed = [
            (one, self.beats if at < EVENTS else last) for at, (one, last) in enumerate(self.unconfirmed)
        ]
        self.say(RelayBeat(self.beats, *self.stop, tuple(first)))
        self.due = now + 0.5

    def heard(self, now: float) -> None:
        self.heard_at = now
        if self.silent_since is not None and self.is_told:
            self.told.append(MasterBack(now - self.silent_since))
        self.silent_since, self.is_told = None, False

    def take_stop(self, stops: int, reason: int) -> None:
        if self.stops_heard not in (None, stops):
            self.told.append(StopSaid(reason))
        self.stops_heard = stops

    def take(self, message: Message, now: float) -> None:
        if isinstance(message, Down):
            self.heard(now)
            for part in self.parts:
                if part.number == message.number:
                    self.down(part, message)
                    break
            else:
                self.dropped.append(NOBODY)
        elif isinstance(message, Heard) and self.welcome:
            self.heard(now)
            if message.stops_said == self.stops_said:
                self.stop = (0, "")
            if message.count == self.beats:
                self.unconfirmed = [one for one in self.unconfirmed if one[1] != self.beats]
            self.take_stop(message.stops, message.reason)
        elif isinstance(message, Welcome) and message.boot == BOOT:
            self.welcome = True
            for part in self.parts:
                part.known = False
            self.heard(now)
            if message.stops:
                self.take_stop(message.stops, 0)
            self.stops_heard = message.stops
            self.told.append(Welcomed(message.profile_hash))
            self.beat(now)
        elif isinstance(message, Who) and self.welcome:
            self.welcome, self.due = False, now
        elif isinstance(message, Refused):
            self.told.append(message)
        elif not isinstance(message, Heard | Who):
            self.dropped.append(STRANGE)

    def down(self, part: PlainPart, message: Down) -> None:
        part.known = True
        if len(part.down) == PACKETS:
            self.dropped.append(FULL_DOWN)
            return
        if not part.down:
            part.down_turn = self.tick()
        part.down.append((message.count, message.packet))

    def timer(self, now: float) -> None:
        if now < self.due:
            return
        if self.welcome:
            self.beat(now)
        else:
            self.say(HELLO)
            self.due = now + 0.5
        since = self.silent_since if self.silent_since is not None else self.heard_at
        if since is not None and now - since > 2.0 and not self.is_told:
            self.silent_since, self.is_told = since, True
            self.told.append(MasterSilent(self.heard_at is not None))

    def to_master(self) -> Message | None:
        if self.said:
            return self.said.pop(0)
        if self.rooms:
            first, self.rooms = self.rooms[:ROOMS], self.rooms[ROOMS:]
            return Room(tuple(first))
        waiting = [one for one in self.parts if one.up]
        if not waiting:
            return None
        part = min(waiting, key=lambda one: one.up_turn)
        part.up_turn = self.tick()
        return Up(part.number, "" if part.known else f"CAN node {part.peer}", part.up.pop(0))

    def to_part(self, with_room: set[Peer]) -> tuple[Peer, bytes] | None:
        for part in sorted((one for one in self.parts if one.down), key=lambda one: one.down_turn):
            waited, part.down_turn = part.down_turn, self.tick()  # its turn has come
            if part.peer not in with_room:
                continue
            assert waited
            count, packet = part.down.pop(0)
            if part.number in [number for number, _ in self.rooms]:
                self.rooms = [(number, count if number == part.number else was) for number, was in self.rooms]
            else:
                self.rooms.append((part.number, count))
            return part.peer, packet
        return None


@pytest.mark.parametrize("seed", range(tries(20, 1000)))
def test_whatever_happens_the_relay_says_and_does_what_the_plain_one_does(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in (("PARTS", PARTS), ("ROOMS", ROOMS), ("EVENTS", EVENTS)):
        monkeypatch.setattr(relay_forwarder, f"MOST_{name}", value)
    monkeypatch.setattr(relay_forwarder, "QUEUE_PACKETS", PACKETS)
    random, told, plain, now = Random(seed), list[ForwarderEvent](), PlainRelay(), 0.0
    made = Forwarder(
        boot=BOOT,
        name="pi",
        carried=LinkInfo("can:can0", 4096, None, shared_bus=True),
        describe=lambda peer: f"CAN node {peer}",
        on_event=told.append,
    )
    made.start(now)
    plain.timer(now)
    for step in range(400):
        now += random.choice((0.0, 0.1, 0.5, 2.5))
        peer, what = random.randrange(6), random.choice([*RelayEventKind])
        number, packet = random.randrange(max(1, plain.number - 5), plain.number + 3), bytes((step % 251 + 1,))
        heard = Heard(
            plain.beats - random.choice((0, 0, 1)),
            plain.stops_said - random.choice((0, 0, 1)),
            random.choice((0, 1, plain.stops_heard or 0)),
            step % 200,
        )
        heard = heard if min(heard.count, heard.stops_said) >= 0 else Heard(0, 0, 0, 0)
        match random.choice("uuuddddeethhwtttsbTTTTpppppfnx"):
            case "u":
                made.from_part(packet, peer)
                plain.from_part(packet, peer)
            case "e":
                made.part_event(peer, what, f"at {step}", now)
                plain.part_event(peer, what, f"at {step}", now)
            case "t":
                made.handle_timer(now)
                plain.timer(now)
            case "s":
                made.stop_heard(f"no {step}", now)
                plain.stop_heard(f"no {step}", now)
            case "T":
                for _ in range(random.randrange(6)):
                    packet_out, expected = made.to_master(), plain.to_master()
                    assert (None if packet_out is None else decode(packet_out)) == expected
            case "p":
                with_room: set[Peer] = {one for one in range(6) if random.random() < 0.6}
                assert made.to_part(with_room.__contains__) == plain.to_part(with_room)
            case "f" if random.random() < 0.3:
                made.forget_down()
                for part in plain.parts:
                    part.down.clear()
            case "n" if random.random() < 0.5:
                made.way_is_new(now)
                plain.welcome, plain.due = False, now
            case "x":
                octets, words = random.choice(((b"\x80\0", STRANGE), (b"\0\xffR\xff", UNREADABLE)))
                made.from_master(octets, now)
                plain.dropped.append(words)
            case kind:
                boot = BOOT if random.random() < 0.8 else b"boot 124"
                others: dict[str, Message] = {
                    "d": Down(number, step, packet),
                    "h": heard,
                    "b": Bye(),
                    "w": random.choice((Welcome(boot, step, random.randrange(3)), Who(), Refused("no"))),
                }
                message = others.get(kind, Who())
                made.from_master(encode(message), now)
                plain.take(message, now)
        assert (made.timer(), made.is_welcome, made.parts) == (plain.due, plain.welcome, len(plain.parts))
        assert told == plain.told
        assert dict(made.dropped) == {words: plain.dropped.count(words) for words in plain.dropped}
    rest = [decode(packet_out) for packet_out in iter(made.to_master, None)]
    assert rest == [*iter(plain.to_master, None)]
    assert decode(made.end()) == Bye()
