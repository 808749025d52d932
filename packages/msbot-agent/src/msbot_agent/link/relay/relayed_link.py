"""The parts behind a relay, as the master's agent sees them: one more link, whose packets travel over another one.

Packets for a part on a slow bus must not pile up in the relay, where they would go stale: so many are on their way to
one part at most, and the relay reports how far it is. A report that is lost costs a pause, not the part: after
`STALE_S` without one, all that was sent counts as lost.
"""

from __future__ import annotations

import asyncio
from collections.abc import Hashable
from typing import Final, NamedTuple

from msbot_agent.link.base import BaseLink
from msbot_agent.link.contract import (
    ConnectionUser,
    Link,
    LinkInfo,
    Peer,
    Signal,
    pupil_of_connection,
    user_of_connection,
)
from msbot_agent.link.relay.forwarder import BEAT_S, COUNTS, MOST_PARTS, SILENT_S, STOP_TIMES
from msbot_agent.link.relay.relay_messages import (
    ENVELOPE,
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
    encode,
)
from msbot_agent.text.sentence import said
from msbot_xrce.errors import LinkDown, LinkFull
from msbot_xrce.lazy import dataclass

WINDOW: Final = 8
"""Packets that may be on their way to one part."""
STALE_S: Final = 0.5
"""After so long without a report, packets on their way count as lost."""
FORGOTTEN_S: Final = 60.0
"""A relay silent for so long is forgotten, with its parts."""


class RelayedPeer(NamedTuple):
    """A part behind a relay."""

    relay: str
    number: int
    visitor: ConnectionUser | None = None
    """The person by whose connection the relay came in, if it came by one: what it brings is that person's."""


@dataclass(frozen=True, slots=True)
class RelayGreeting:
    """What a master tells every relay."""

    profile_hash: int = 0
    """CRC-32 of the robot's name, version and serial number, for the beacon on a CAN bus."""


@dataclass(slots=True)
class _Known:
    words: str = ""
    sent: int = 0
    handled: int = 0
    stale_at: float = 0.0


class RelayedLink(BaseLink):
    """The parts of one relay; satisfies `Link`. The agent makes it when a relay introduces itself.

    Args:
        hello: how the relay introduced itself.
        way: the link by which the relay speaks.
        peer: the relay, as that link knows it.
        greeting: what to tell it.
    """

    def __init__(self, hello: Hello, way: Link, peer: Peer, greeting: RelayGreeting) -> None:
        mtu = max(1, min(hello.mtu, way.info.mtu - ENVELOPE))
        self.visitor = user_of_connection(peer)
        self.owner = pupil_of_connection(peer)
        """The pupil who runs the relay; empty: no pupil does."""
        self._name = hello.name if not self.owner else said("{name} of {pupil}", name=hello.name, pupil=self.owner)
        super().__init__(
            LinkInfo(
                f"{hello.carried} behind relay {self._name}",
                mtu,
                hello.bits_per_second or None,
                shared_bus=hello.shared_bus,
                compresses=hello.compresses,
                keeps_order=way.info.keeps_order,
            )
        )
        self.hello = hello
        self.way, self.relay = way, peer
        """By which link and from where the relay spoke last."""
        self.is_silent = False
        self._greeting = greeting
        self._parts: dict[int, _Known] = {}
        self._stops = 0
        self._stop_reason = 0
        self._stops_said = 0
        self._heard_at = 0.0
        self._ended: asyncio.Event = asyncio.Event()
        self._running = False

    @property
    def was_used(self) -> bool:
        """Whether a part has ever sent something through it."""
        return self.counters.packets_in > 0

    # What `Link` asks for.

    def has_room(self, peer: Peer) -> bool:
        """See `Link`."""
        if not self._running or self.is_silent or not isinstance(peer, RelayedPeer):
            return False
        part = self._parts.get(peer.number)
        return part is not None and self._in_window(part) and self.way.has_room(self.relay)

    def send(self, packet: bytes, peer: Peer) -> None:
        """See `Link`.

        Raises:
            LinkFull: enough is on its way to that part already.
            LinkDown: the relay is silent, or does not carry that part.
        """
        if not self._running or self.is_silent:
            raise LinkDown(f"the relay {self.hello.name} is silent")
        part = self._parts.get(peer.number) if isinstance(peer, RelayedPeer) else None
        if part is None or not isinstance(peer, RelayedPeer):
            raise LinkDown(f"there is no such part behind the relay {self.hello.name}")
        if not self._in_window(part):
            raise LinkFull(f"{WINDOW} packets are on their way to {self.describe(peer)}")
        count = (part.sent + 1) % COUNTS
        self.way.send(encode(Down(peer.number, count, packet)), self.relay)
        part.sent = count
        now = asyncio.get_running_loop().time()
        part.stale_at = now + STALE_S
        self._sent(packet, peer, now)

    def origin(self, peer: Peer) -> Hashable:  # noqa: ARG002 - the same for all
        """See `Link`: the relay answers for all its parts, as anybody on its computer might pretend to be one."""
        return self.way.info.name, self.way.origin(self.relay)

    def describe(self, peer: Peer) -> str:
        """See `Link`."""
        part = self._parts.get(peer.number) if isinstance(peer, RelayedPeer) else None
        place = part.words if part is not None and part.words else f"part {getattr(peer, 'number', peer)}"
        return f"{place} behind relay {self._name}"

    def send_stop(self, reason: int = 0) -> None:
        """Have the relay say STOP on its link; it goes before all packets, and every beat repeats it.

        Raises:
            LinkDown: the link to the relay carries nothing.
        """
        self._stops = self._stops % (COUNTS - 1) + 1
        self._stop_reason = reason
        for _ in range(STOP_TIMES):
            self._tell(Heard(0, self._stops_said, self._stops, reason))

    async def run(self) -> None:
        """See `Link`: until the relay says goodbye, or is silent for a minute."""
        loop = asyncio.get_running_loop()
        self._running, self._heard_at = True, loop.time()
        self._signal_handler(Signal.LINK_UP, None, f"from {self.way.describe(self.relay)}", loop.time())
        try:
            while not self._ended.is_set():
                try:
                    async with asyncio.timeout(BEAT_S):
                        await self._ended.wait()
                except TimeoutError:
                    self._look(loop.time())
        finally:
            self._running = False
            self._signal_handler(Signal.LINK_DOWN, None, "closed", loop.time())

    # What the agent calls.

    def welcome(self, way: Link, peer: Peer, now: float) -> None:
        """The relay has introduced itself (again), from there."""
        self.way, self.relay = way, peer
        # A STOP that the relay did not get is repeated: it counts from before it.
        self._tell_gently(Welcome(self.hello.boot, self._greeting.profile_hash, self._stops))
        self._heard(now)

    def receive(self, message: Message, now: float) -> None:
        """A message from the relay."""
        match message:
            case Up(number, words, packet):
                self._heard(now)
                if words or number not in self._parts:
                    self._note(number).words = words
                self._received(packet, self._behind(number), now)
            case Room(handled):
                self._heard(now)
                for number, count in handled:
                    self._has_handled(number, count)
            case RelayBeat():
                self._heard(now)
                self._take_beat(message, now)

    def end(self) -> None:
        """It is over: the relay said goodbye, or another one has taken its place."""
        self._ended.set()

    def room_on_the_way(self) -> None:
        """The link that leads to the relay has room again."""
        self._room_handler(None)

    def _take_beat(self, beat: RelayBeat, now: float) -> None:
        for event in beat.events:
            self._happened(event, now)
        is_stop = beat.stops_said not in (0, self._stops_said)
        self._stops_said = beat.stops_said or self._stops_said
        self._tell_gently(Heard(beat.count, self._stops_said, self._stops, self._stop_reason))
        if is_stop:
            self._signal_handler(Signal.STOP, None, beat.words, now)

    def _happened(self, event: Event, now: float) -> None:
        peer = self._behind(event.number)
        match event.what:
            case RelayEventKind.CAME:
                self._note(event.number).words = event.words
                self._signal_handler(Signal.PEER_JOINED, peer, event.words, now)
            case RelayEventKind.GONE:
                self._signal_handler(Signal.PEER_GONE, peer, event.words, now)
            case RelayEventKind.BACK:
                self._signal_handler(Signal.PEER_BACK, peer, event.words, now)

    def _behind(self, number: int) -> RelayedPeer:
        return RelayedPeer(self.hello.name, number, self.visitor)

    def _note(self, number: int) -> _Known:
        part = self._parts.pop(number, None)
        if part is None:
            part = _Known()
            if len(self._parts) >= 2 * MOST_PARTS:
                oldest = next(iter(self._parts))
                del self._parts[oldest]
        self._parts[number] = part
        return part

    def _has_handled(self, number: int, count: int) -> None:
        part = self._parts.get(number)
        if part is None or (part.sent - count) % COUNTS > (part.sent - part.handled) % COUNTS:
            return
        was_full = not self._in_window(part)
        part.handled = count
        if was_full:
            self._room_handler(self._behind(number))

    @staticmethod
    def _in_window(part: _Known) -> bool:
        return (part.sent - part.handled) % COUNTS < WINDOW

    def _heard(self, now: float) -> None:
        self._heard_at = now
        if self.is_silent:
            self.is_silent = False
            for number in tuple(self._parts):
                self._signal_handler(Signal.PEER_BACK, self._behind(number), "the relay is back", now)
            self._room_handler(None)

    def _look(self, now: float) -> None:
        silence_s = now - self._heard_at
        if silence_s > FORGOTTEN_S:
            self.end()
        elif silence_s > SILENT_S and not self.is_silent:
            self.is_silent = True
            words = said("the relay {relay} is silent", relay=self.hello.name)
            for number in tuple(self._parts):
                self._signal_handler(Signal.PEER_GONE, self._behind(number), words, now)
        for number, part in self._parts.items():
            if not self._in_window(part) and now >= part.stale_at:
                part.handled = part.sent
                self._room_handler(self._behind(number))

    def _tell_gently(self, message: Message) -> None:
        """What the relay asks for again if it is lost."""
        try:
            self._tell(message)
        except (LinkDown, LinkFull):
            self.counters.dropped.count("answer to the relay: no room")

    def _tell(self, message: Message) -> None:
        self.way.send(encode(message), self.relay)
