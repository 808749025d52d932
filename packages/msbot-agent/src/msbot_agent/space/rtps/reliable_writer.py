"""A reliable writer towards any number of readers elsewhere (DDSI-RTPS 2.3 §8.4.9). Pure.

Each reader has a proxy here. It gets the samples that are for it, with a GAP for the numbers between that are not, and
a HEARTBEAT behind; it answers with ACKNACK what it has and misses, and gets that again. A HEARTBEAT that is not
answered is repeated, less and less often. What every reader has that it is for is forgotten, and of the rest the
oldest, when there is more than `depth`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from itertools import islice

from msbot_agent.space.contract import Guid
from msbot_agent.space.rtps import rtps_messages
from msbot_agent.space.rtps.descriptions import EndpointDescription
from msbot_agent.space.rtps.reliable_reader import ReliableReader
from msbot_agent.space.rtps.rtps_messages import AckNack, Inline, NackFrag, RtpsHeartbeat
from msbot_xrce.lazy import dataclass

FIRST_BEAT_S = 0.02
"""How long a HEARTBEAT waits for its answer at first; twice as long each time after that, up to `SLOWEST_BEAT_S`."""
SLOWEST_BEAT_S = 1.0
AGAIN_AT_ONCE = 64
"""Samples that are sent again for one ACKNACK; what is missing after them is asked for again."""

Send = Callable[["ReaderProxy", list[bytes]], None]
"""Takes submessages for a reader, in order."""


@dataclass(frozen=True, slots=True)
class RtpsSample:
    """A sample in the history."""

    payload: bytes
    """With its encapsulation header."""
    inline: Inline
    readers: frozenset[Guid] | None = None
    """Whom it is for; None: everybody."""
    plain: bytes | None = None
    """The payload for readers that read no inline QoS, with its header; None: the same."""


@dataclass(slots=True, eq=False)
class ReaderProxy:
    """A reader elsewhere."""

    guid: Guid
    locators: tuple[tuple[str, int], ...]
    start: int
    """The first number that may be for it."""
    plain: bool = False
    """It reads the form without inline QoS."""
    reliable: bool = True
    held_until: float | None = None
    """Nothing is sent to it before: the way back may not be known yet."""
    sent: int = 0
    """The last number that was sent, or told not to come."""
    acked: int = 0
    heard: int = -1
    """Number of the last ACKNACK."""
    has_begun: bool = False
    """It has told that it knows where to begin."""
    beats: int = 0
    next_beat: float | None = None
    pause: float = FIRST_BEAT_S


class ReliableWriter:
    """The state of one writer."""

    def __init__(self, guid: Guid, send: Send, *, depth: int, durable: bool = False) -> None:
        """`durable`: what was written before a reader came is for it, too."""
        self.guid = guid
        self.proxies: dict[Guid, ReaderProxy] = {}
        self.last = 0
        self.lost = 0
        """Samples that were forgotten before every reader had them."""
        self._send = send
        self._depth = depth
        self._durable = durable
        self._changes: dict[int, RtpsSample] = {}

    @property
    def waiting(self) -> int:
        """Samples in its history."""
        return len(self._changes)

    def match(
        self,
        guid: Guid,
        locators: tuple[tuple[str, int], ...],
        now: float,
        *,
        plain: bool = False,
        reliable: bool = True,
        held_until: float | None = None,
    ) -> None:
        """A reader is there."""
        start = 1 if self._durable else self.last + 1
        proxy = ReaderProxy(guid, locators, start, plain, reliable, held_until, start - 1, start - 1)
        self.proxies[guid] = proxy
        if held_until is None:
            self._welcome(proxy, now)

    def unmatch(self, guid: Guid) -> None:
        """A reader is gone."""
        if self.proxies.pop(guid, None) is not None:
            self._tidy()

    def release(self, proxy: ReaderProxy, now: float) -> None:
        """The way back is known: send what has waited for it."""
        if proxy.held_until is not None:
            proxy.held_until = None
            self._welcome(proxy, now)

    def write(self, number: int, change: RtpsSample, now: float) -> None:
        """Send a sample; numbers may be left out, but only grow."""
        self.last = number
        mine = [proxy for proxy in self.proxies.values() if change.readers is None or proxy.guid in change.readers]
        if mine or self._durable:
            self._changes[number] = change
        for proxy in mine:
            if proxy.held_until is None:
                self._send(proxy, [*self._begin(proxy), *self._new(proxy), *self._beat(proxy, now)])
        self._tidy()

    def forget(self, number: int) -> None:
        """A kept sample has been replaced: nobody gets it any more."""
        self._changes.pop(number, None)

    def handle_acknack(self, guid: Guid, said: AckNack, now: float) -> None:
        """A reader tells what it has and misses."""
        proxy = self.proxies.get(guid)
        if proxy is None or (0 <= proxy.heard - said.count < 1 << 16 and proxy.heard != said.count):
            return
        proxy.heard = said.count
        proxy.has_begun |= bool(said.numbers.set) or said.numbers.base > proxy.start
        base = min(said.numbers.base, self.last + 1)
        if base - 1 > proxy.acked:
            proxy.acked = base - 1
            proxy.pause = FIRST_BEAT_S
        out: list[bytes] = []
        if proxy.held_until is None:
            out += self._again(proxy, said.numbers.set)
            if out or not said.final:
                out += self._beat(proxy, now)
        if out:
            self._send(proxy, out)
        self._tidy()
        if not self._unacked(proxy):
            proxy.next_beat = None

    def heard_fragments(self, guid: Guid, said: NackFrag) -> None:
        """A reader misses parts of a sample."""
        proxy, change = self.proxies.get(guid), self._changes.get(said.number)
        if proxy is None or change is None or not self._is_for(change, proxy):
            return
        payload, inline = self._form(change, proxy)
        most = -(-len(payload) // rtps_messages.FRAGMENT)
        beside = rtps_messages.inline_octets(inline)
        self._send(
            proxy,
            [
                rtps_messages.data_frag(proxy.guid[12:], self.guid[12:], said.number, beside, payload, fragment)
                for fragment in said.fragments.set[:AGAIN_AT_ONCE]
                if 1 <= fragment <= most
            ],
        )

    def deadline(self) -> float | None:
        """When `tick` has something to do."""
        times = [
            time for proxy in self.proxies.values() for time in (proxy.next_beat, proxy.held_until) if time is not None
        ]
        return min(times, default=None)

    def tick(self, now: float) -> None:
        """Repeat what was not answered."""
        for proxy in list(self.proxies.values()):
            if proxy.held_until is not None and proxy.held_until <= now:
                self.release(proxy, now)
            elif proxy.next_beat is not None and proxy.next_beat <= now:
                proxy.pause = min(2 * proxy.pause, SLOWEST_BEAT_S)
                self._send(proxy, list(self._beat(proxy, now)))

    # Samples for one reader.

    def _welcome(self, proxy: ReaderProxy, now: float) -> None:
        """The first HEARTBEAT tells a reader where to begin; what is kept it asks for itself, as fast as it can."""
        if self._durable:
            proxy.sent = self.last
        self._send(proxy, [*self._begin(proxy), *self._new(proxy), *self._beat(proxy, now)])

    def _begin(self, proxy: ReaderProxy) -> Iterator[bytes]:
        """Where to begin, before the first samples."""
        if proxy.reliable and not proxy.has_begun and proxy.sent < self.last:
            proxy.beats += 1
            ids = proxy.guid[12:], self.guid[12:]
            yield rtps_messages.heartbeat(RtpsHeartbeat(*ids, proxy.start, proxy.start - 1, proxy.beats, final=False))

    def _new(self, proxy: ReaderProxy) -> Iterator[bytes]:
        """What was not sent to it yet."""
        numbers = range(proxy.sent + 1, self.last + 1)
        if len(numbers) <= len(self._changes):
            mine = [number for number in numbers if self._holds(number, proxy)]
        else:
            mine = [number for number in self._changes if number > proxy.sent and self._holds(number, proxy)]
        at = proxy.sent + 1
        for number in mine:
            if number > at:
                yield self._gap(proxy, at, number)
            yield from self._data(proxy, number)
            at = number + 1
        if at <= self.last:
            yield self._gap(proxy, at, self.last + 1)
        proxy.sent = self.last

    def _again(self, proxy: ReaderProxy, missing: Collection[int]) -> list[bytes]:
        """What it misses once more, and that the rest will not come."""
        wanted = [number for number in missing if number <= self.last]
        gone = [number for number in wanted if number < proxy.start or not self._holds(number, proxy)]
        out = [rtps_messages.gap(proxy.guid[12:], self.guid[12:], gone[0], gone[0] + 1, gone[1:])] if gone else []
        out_of = set(gone)
        for number in islice((one for one in wanted if one not in out_of), AGAIN_AT_ONCE):
            out += self._data(proxy, number)
        return out

    def _data(self, proxy: ReaderProxy, number: int) -> Iterator[bytes]:
        payload, inline = self._form(self._changes[number], proxy)
        return rtps_messages.data(proxy.guid[12:], self.guid[12:], number, inline, payload)

    @staticmethod
    def _form(change: RtpsSample, proxy: ReaderProxy) -> tuple[bytes, Inline]:
        if proxy.plain and change.plain is not None:
            return change.plain, rtps_messages.NOTHING
        return change.payload, change.inline

    def _gap(self, proxy: ReaderProxy, start: int, base: int) -> bytes:
        return rtps_messages.gap(proxy.guid[12:], self.guid[12:], start, base)

    def _beat(self, proxy: ReaderProxy, now: float) -> Iterator[bytes]:
        """What there is for a reader.

        Cyclone DDS takes what the first HEARTBEAT names for gone. So as long as it is not known that a reader has
        heard one, another goes first that names the place to begin and no sample.
        """
        if not proxy.reliable:
            return
        proxy.next_beat = now + proxy.pause
        ids = proxy.guid[12:], self.guid[12:]
        if not proxy.has_begun:
            proxy.beats += 1
            yield rtps_messages.heartbeat(RtpsHeartbeat(*ids, proxy.start, proxy.start - 1, proxy.beats, final=False))
        if proxy.has_begun or self.last >= proxy.start:
            proxy.beats += 1
            first = max(proxy.start, min(self._changes, default=self.last + 1))
            yield rtps_messages.heartbeat(RtpsHeartbeat(*ids, first, self.last, proxy.beats, final=False))

    # The history.

    def _holds(self, number: int, proxy: ReaderProxy) -> bool:
        change = self._changes.get(number)
        return change is not None and self._is_for(change, proxy)

    @staticmethod
    def _is_for(change: RtpsSample, proxy: ReaderProxy) -> bool:
        return change.readers is None or proxy.guid in change.readers

    def _unacked(self, proxy: ReaderProxy) -> bool:
        return proxy.reliable and (
            any(number > proxy.acked and self._is_for(change, proxy) for number, change in self._changes.items())
            or (proxy.heard < 0)
        )

    def _tidy(self) -> None:
        if self._durable:
            return
        for number, change in list(self._changes.items()):
            if len(self._changes) > self._depth:
                self.lost += 1
            elif any(
                proxy.acked < number if proxy.reliable else proxy.sent < number
                for proxy in self.proxies.values()
                if self._is_for(change, proxy) and number >= proxy.start
            ):
                continue
            del self._changes[number]


# A writer or reader of ours, and what is told of it.


@dataclass(slots=True, eq=False)
class RtpsEndpoint:
    """A writer or reader of ours."""

    description: EndpointDescription
    writer: ReliableWriter | None = None
    reader: ReliableReader | None = None
    replies: str = ""
    """Of a writer of requests: the topic of their replies."""
    number: int = 0
    """In which sample of discovery it is told."""

    @property
    def guid(self) -> Guid:
        """By which others know it."""
        return self.description.guid

    @property
    def state(self) -> ReliableWriter | ReliableReader:
        """Its state machine."""
        found = self.writer or self.reader
        assert found is not None
        return found
