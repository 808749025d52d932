"""The relay's state: whose packets wait in which direction, whether the master is there, and who has said STOP. Pure.

Nothing of DDS-XRCE is read: a part's packets go through unchanged, so its session is with the master's agent and its
identity stays its own. Each part has a queue of its own in each direction and they take turns, so that a part that
floods fills only its own; what a relay says for itself (beats, STOP) goes before all of them. The master holds back
packets for a part of which `WINDOW` are on their way (`msbot_agent.link.relay.relayed_link`).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import field
from typing import Final

from msbot_agent.link.contract import LinkInfo, Peer
from msbot_agent.link.relay.relay_messages import (
    MARK,
    MOST_EVENTS,
    MOST_ROOMS,
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
from msbot_xrce.counting import Tally
from msbot_xrce.errors import RemoteProtocolError
from msbot_xrce.lazy import dataclass

BEAT_S: Final = 0.5
"""Period of beats, and of HELLO until there is a welcome."""
SILENT_S: Final = 2.0
"""So long without a word, and the other side counts as silent."""
MOST_PARTS: Final = 256
"""Parts that a relay carries; another one takes the place of the one that was silent for the longest."""
QUEUE_PACKETS: Final = 32
"""Packets of one part that may wait, in each direction."""
STOP_TIMES: Final = 3
"""How often STOP is sent at once; every beat repeats it."""
COUNTS: Final = 1 << 16

FULL_UP: Final = "packet from a part: its queue to the master is full"
FULL_DOWN: Final = "packet for a part: its queue is full"
NOBODY: Final = "packet for a part that is not here"
UNREADABLE: Final = "message that cannot be read"
STRANGE: Final = "packet that is not from a master that takes relays"


@dataclass(frozen=True, slots=True)
class Welcomed:
    """The master takes the relay; its robot has this profile hash."""

    profile_hash: int


@dataclass(frozen=True, slots=True)
class MasterSilent:
    """The master has not been heard for `SILENT_S`."""

    was_there: bool
    """Whether it has ever been heard."""


@dataclass(frozen=True, slots=True)
class MasterBack:
    """The master is heard again."""

    after_s: float


@dataclass(frozen=True, slots=True)
class StopSaid:
    """The master has said STOP: say it on the link, before everything else."""

    reason: int


ForwarderEvent = Welcomed | MasterSilent | MasterBack | StopSaid | Refused


@dataclass(slots=True)
class _Carried:
    """A part that the relay carries."""

    number: int
    peer: Peer
    up: deque[bytes] = field(default_factory=deque)
    down: deque[tuple[int, bytes]] = field(default_factory=deque)
    is_known: bool = False
    """Whether the master has sent something to it, and so knows where it is."""
    handled: int | None = None
    """Number of the latest packet for it that was passed on."""


class Forwarder:
    """The relay's end (see the module's docstring). The owner sends what `to_master` and `to_part` return.

    Args:
        boot: 8 octets, drawn anew at each start.
        name: what people call the relay.
        carried: the link of the parts.
        describe: where a part is, in words.
        on_event: called with what the owner has to do or to say.
    """

    def __init__(
        self,
        *,
        boot: bytes,
        name: str,
        carried: LinkInfo,
        describe: Callable[[Peer], str],
        on_event: Callable[[ForwarderEvent], None],
    ) -> None:
        self.dropped = Tally()
        self._hello = Hello(
            boot, name, carried.name, carried.mtu, carried.bits_per_second or 0, carried.shared_bus, carried.compresses
        )
        self._describe = describe
        self._on_event = on_event
        self._by_peer: dict[Peer, _Carried] = {}
        """The parts, the one that was silent for the longest first."""
        self._by_number: dict[int, _Carried] = {}
        self._latest_number = 0
        self._turns_up: deque[_Carried] = deque()
        self._turns_down: deque[_Carried] = deque()
        self._urgent: deque[bytes] = deque(maxlen=64)
        self._rooms: dict[int, int] = {}
        self._events: list[Event] = []
        """What the master has not confirmed."""
        self._events_in_beat = 0
        self._beats = 0
        self._stops_said = 0
        self._stop_is_confirmed = True
        self._stop_words = ""
        self._stops_heard: int | None = None
        self._is_welcome = False
        self._heard_at: float | None = None
        self._silent_since: float | None = None
        self._is_told = False
        self._due_at = 0.0

    @property
    def parts(self) -> int:
        """How many parts are carried."""
        return len(self._by_peer)

    @property
    def is_welcome(self) -> bool:
        """Whether the master has taken this relay, and has not forgotten it."""
        return self._is_welcome

    # What comes in.

    def from_part(self, packet: bytes, peer: Peer) -> None:
        """A packet from a part."""
        part = self._part(peer)
        if len(part.up) >= QUEUE_PACKETS:
            self.dropped.count(FULL_UP)
            return
        if not part.up:
            self._turns_up.append(part)
        part.up.append(packet)

    def part_event(self, peer: Peer, what: RelayEventKind, words: str, now: float) -> None:
        """A part has come, gone, or is back: the master hears of it at once."""
        if what is RelayEventKind.GONE and peer not in self._by_peer:
            return
        number = self._part(peer).number
        if what is RelayEventKind.CAME:
            words = self._describe(peer)
        if len(self._events) >= MOST_PARTS:
            del self._events[0]  # what it is worth is known from the silence of the part, too
        self._events.append(Event(number, what, words))
        self._send_beat(now)

    def stop_heard(self, words: str, now: float) -> None:
        """Somebody has said STOP on the link of the parts."""
        self._stops_said = _next(self._stops_said)
        self._stop_is_confirmed = False
        self._stop_words = words
        for _ in range(STOP_TIMES):
            self._send_beat(now)

    def from_master(self, octets: bytes, now: float) -> None:
        """A packet from the master's side."""
        if octets[: len(MARK)] != MARK:
            self.dropped.count(STRANGE)
            return
        try:
            message = decode(octets)
        except RemoteProtocolError:
            self.dropped.count(UNREADABLE)
            return
        self._take(message, now)

    def _take(self, message: Message, now: float) -> None:
        match message:
            case Down(number, count, packet):
                self._heard(now)
                self._to_part(number, count, packet)
            case Heard():
                if self._is_welcome:
                    self._heard(now)
                    self._confirmed(message)
                    self._take_stop(message.stops, message.reason)
            case Welcome(boot, profile_hash, stops) if boot == self._hello.boot:
                for part in self._by_peer.values():
                    part.is_known = False
                self._is_welcome = True
                self._heard(now)
                if stops:
                    self._take_stop(stops, reason=0)
                self._stops_heard = stops
                self._on_event(Welcomed(profile_hash))
                self._send_beat(now)
            case Who():
                if self._is_welcome:
                    self._is_welcome = False
                    self._due_at = now
            case Refused():
                self._on_event(message)
            case _:
                self.dropped.count(STRANGE)

    def _to_part(self, number: int, count: int, packet: bytes) -> None:
        part = self._by_number.get(number)
        if part is None:
            self.dropped.count(NOBODY)
            return
        part.is_known = True
        if len(part.down) >= QUEUE_PACKETS:
            self.dropped.count(FULL_DOWN)
            return
        if not part.down:
            self._turns_down.append(part)
        part.down.append((count, packet))

    def _confirmed(self, heard: Heard) -> None:
        if heard.stops_said == self._stops_said:
            self._stop_is_confirmed = True
        if heard.count == self._beats:
            del self._events[: self._events_in_beat]
            self._events_in_beat = 0

    def _take_stop(self, stops: int, reason: int) -> None:
        if self._stops_heard is not None and stops != self._stops_heard:
            self._on_event(StopSaid(reason))
        self._stops_heard = stops

    def _heard(self, now: float) -> None:
        self._heard_at = now
        if self._silent_since is not None:
            after_s, self._silent_since = now - self._silent_since, None
            if self._is_told:
                self._is_told = False
                self._on_event(MasterBack(after_s))

    # Time.

    def start(self, now: float) -> None:
        """Begin: introduce the relay, and wait for the master."""
        self._silent_since = now
        self._due_at = now
        self.handle_timer(now)

    def way_is_new(self, now: float) -> None:
        """The link to the master has opened (again): the master may know the relay from elsewhere."""
        self._is_welcome = False
        self._due_at = now

    def timer(self) -> float:
        """When `handle_timer` wants to be called next."""
        return self._due_at

    def handle_timer(self, now: float) -> None:
        """Say what is due."""
        if now < self._due_at:
            return
        if self._is_welcome:
            self._send_beat(now)
        else:
            self._urgent.append(encode(self._hello))
            self._due_at = now + BEAT_S
        since = self._heard_at if self._silent_since is None else self._silent_since
        if since is not None and now - since > SILENT_S and not self._is_told:
            self._silent_since, self._is_told = since, True
            self._on_event(MasterSilent(was_there=self._heard_at is not None))

    def end(self) -> bytes:
        """The last words."""
        return encode(Bye())

    def _send_beat(self, now: float) -> None:
        self._beats = _next(self._beats)
        events = tuple(self._events[:MOST_EVENTS])
        self._events_in_beat = len(events)
        # A STOP that the master has confirmed is not repeated: another master would take it for a new one.
        stop = (0, "") if self._stop_is_confirmed else (self._stops_said, self._stop_words)
        self._urgent.append(encode(RelayBeat(self._beats, *stop, events)))
        self._due_at = now + BEAT_S

    # What goes out.

    def to_master(self) -> bytes | None:
        """The next packet for the master: the relay's own words first, then each part in turn; None: nothing."""
        if self._urgent:
            return self._urgent.popleft()
        if self._rooms:
            rooms = tuple(self._rooms.items())[:MOST_ROOMS]
            for number, _ in rooms:
                del self._rooms[number]
            return encode(Room(rooms))
        if not self._turns_up:
            return None
        part = self._turns_up.popleft()
        packet = part.up.popleft()
        if part.up:
            self._turns_up.append(part)
        return encode(Up(part.number, "" if part.is_known else self._describe(part.peer), packet))

    def to_part(self, has_room: Callable[[Peer], bool]) -> tuple[Peer, bytes] | None:
        """The next packet for a part that has room, each in turn; None: nothing can be sent."""
        for _ in range(len(self._turns_down)):
            part = self._turns_down[0]
            if not has_room(part.peer):
                self._turns_down.rotate(-1)
                continue
            self._turns_down.popleft()
            count, packet = part.down.popleft()
            if part.down:
                self._turns_down.append(part)
            self._rooms[part.number] = count
            return part.peer, packet
        return None

    def forget_down(self) -> None:
        """The link of the parts has ended: what waits for them is of no use."""
        for part in self._turns_down:
            part.down.clear()
        self._turns_down.clear()

    def _part(self, peer: Peer) -> _Carried:
        part = self._by_peer.pop(peer, None)
        if part is None:
            if len(self._by_peer) >= MOST_PARTS:
                self._remove(next(iter(self._by_peer)))
            part = _Carried(self._free_number(), peer)
            self._by_number[part.number] = part
        self._by_peer[peer] = part
        return part

    def _remove(self, peer: Peer) -> None:
        part = self._by_peer.pop(peer)
        del self._by_number[part.number]
        if part.up:
            self._turns_up.remove(part)
        if part.down:
            self._turns_down.remove(part)
        self._rooms.pop(part.number, None)

    def _free_number(self) -> int:
        """Numbers are used again as late as possible: the master may still know a part that was here."""
        while True:
            self._latest_number = self._latest_number % (COUNTS - 1) + 1
            if self._latest_number not in self._by_number:
                return self._latest_number


def _next(count: int) -> int:
    """The number after that one; 0 is never used again: it means "none"."""
    return count % (COUNTS - 1) + 1
