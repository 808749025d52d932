"""A reliable reader of any number of writers elsewhere (DDSI-RTPS 2.3 §8.4.12). Pure.

Each writer has a proxy here. Samples are passed on in their order. The first HEARTBEAT of a writer tells where its
numbers begin for this reader; until then samples wait, and the reader asks for one. A hole is asked for at once, once
more whenever the writer beats, and by the clock less and less often. Samples in fragments are put together; everything
that waits is bounded.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field

from msbot_agent.space.contract import Guid
from msbot_agent.space.rtps import rtps_messages
from msbot_agent.space.rtps.rtps_messages import AckNack, Gap, NackFrag, NumberSet, RtpsData, RtpsHeartbeat
from msbot_xrce.lazy import dataclass

WINDOW = rtps_messages.MOST_BITS
"""How far ahead of the next sample others may be."""
MOST_IN_PARTS = 2
"""Samples of one writer that may be incomplete at a time."""
MOST_FRAGMENTS = 4096
"""Fragments of one sample."""
FIRST_ASK_S = 0.02
SLOWEST_ASK_S = 1.0
"""How long a question waits for its answer at first and at last."""

Take = Callable[[Guid, RtpsData], None]
"""Takes a whole sample, with the GUID of its writer."""
Send = Callable[["WriterProxy", list[bytes]], None]


@dataclass(slots=True)
class Assembly:
    """A sample in fragments."""

    data: RtpsData
    octets: bytearray
    missing: set[int]


@dataclass(slots=True, eq=False)
class WriterProxy:
    """A writer elsewhere."""

    guid: Guid
    locators: tuple[tuple[str, int], ...]
    reliable: bool = True
    next: int | None = None
    """The sample that is to be passed on next; None: no HEARTBEAT has told it yet."""
    ahead: dict[int, RtpsData | None] = field(default_factory=dict)
    """What came before its turn; None: it will not come."""
    parts: dict[int, Assembly] = field(default_factory=dict)
    last: int = 0
    """The last number that the writer is known to have used."""
    beats: int = -1
    asked: int = 0
    next_ask: float | None = None
    pause: float = FIRST_ASK_S


class ReliableReader:
    """The state of one reader."""

    def __init__(self, guid: Guid, send: Send, take: Take) -> None:
        self.guid = guid
        self.proxies: dict[Guid, WriterProxy] = {}
        self.refused = 0
        """Samples that were too large, or made no sense."""
        self._send = send
        self._take = take

    def match(self, guid: Guid, locators: tuple[tuple[str, int], ...], now: float, *, reliable: bool = True) -> None:
        """A writer is there: ask it where to begin."""
        proxy = self.proxies[guid] = WriterProxy(guid, locators, reliable)
        if reliable:
            self._ask(proxy, now)

    def unmatch(self, guid: Guid) -> None:
        """A writer is gone."""
        self.proxies.pop(guid, None)

    def heard_data(self, guid: Guid, data: RtpsData, now: float) -> None:
        """A sample, or a fragment of one."""
        proxy = self.proxies.get(guid)
        if proxy is None or not self._is_wanted(proxy, data.number):
            return
        proxy.last = max(proxy.last, data.number)
        whole = data if not data.first else self._put_together(proxy, data)
        if whole is None:
            return
        if not proxy.reliable:
            proxy.next = data.number + 1
            self._take(guid, whole)
            return
        if proxy.next is None and data.number == 1:
            proxy.next = 1
        proxy.ahead[data.number] = whole
        self._pass_on(proxy)
        if proxy.next is not None and data.number > proxy.next and proxy.next_ask is None:
            self._ask(proxy, now)

    def heard_beat(self, guid: Guid, beat: RtpsHeartbeat, now: float) -> None:
        """A writer tells what it has."""
        proxy = self.proxies.get(guid)
        if proxy is None or not proxy.reliable or 0 <= proxy.beats - beat.count < 1 << 16:
            return
        proxy.beats = beat.count
        proxy.last = max(proxy.last, beat.last)
        proxy.pause = FIRST_ASK_S
        if proxy.next is None or proxy.next < beat.first:
            self._begin_at(proxy, beat.first)
        self._pass_on(proxy)
        if self._has_holes(proxy) or not beat.final:
            self._ask(proxy, now)

    def heard_gap(self, guid: Guid, gap: Gap) -> None:
        """Some numbers will not come."""
        proxy = self.proxies.get(guid)
        if proxy is None or not proxy.reliable:
            return
        base = max(gap.start, gap.numbers.base)
        proxy.last = max(proxy.last, base - 1, *gap.numbers.set)
        if proxy.next is not None:
            if gap.start <= proxy.next < base:
                self._begin_at(proxy, base)
            else:
                for number in range(max(gap.start, proxy.next), min(base, proxy.next + WINDOW)):
                    proxy.ahead.setdefault(number, None)
            for number in gap.numbers.set:
                if self._is_wanted(proxy, number):
                    proxy.ahead.setdefault(number, None)
            self._pass_on(proxy)
        if not self._has_holes(proxy):
            proxy.next_ask = None

    def deadline(self) -> float | None:
        """When `tick` has something to do."""
        return min((proxy.next_ask for proxy in self.proxies.values() if proxy.next_ask is not None), default=None)

    def tick(self, now: float) -> None:
        """Ask again what was not answered."""
        for proxy in self.proxies.values():
            if proxy.next_ask is not None and proxy.next_ask <= now:
                proxy.pause = min(2 * proxy.pause, SLOWEST_ASK_S)
                self._ask(proxy, now)

    @staticmethod
    def _is_wanted(proxy: WriterProxy, number: int) -> bool:
        if proxy.next is None:
            return len(proxy.ahead) < WINDOW and number not in proxy.ahead
        if not proxy.reliable:
            return number >= proxy.next
        return proxy.next <= number < proxy.next + WINDOW and proxy.ahead.get(number) is None

    @staticmethod
    def _begin_at(proxy: WriterProxy, number: int) -> None:
        proxy.next = number
        for held in (proxy.ahead, proxy.parts):
            for old in [one for one in held if not number <= one < number + WINDOW]:
                del held[old]

    def _pass_on(self, proxy: WriterProxy) -> None:
        while proxy.next is not None and proxy.next in proxy.ahead:
            data = proxy.ahead.pop(proxy.next)
            proxy.parts.pop(proxy.next, None)
            proxy.next += 1
            if data is not None:
                self._take(proxy.guid, data)
        if not self._has_holes(proxy):
            proxy.next_ask = None

    @staticmethod
    def _has_holes(proxy: WriterProxy) -> bool:
        return proxy.next is None or proxy.next <= proxy.last

    def _ask(self, proxy: WriterProxy, now: float) -> None:
        """Say what is there and what is missing."""
        proxy.asked += 1
        ids = self.guid[12:], proxy.guid[12:]
        if proxy.next is None:
            out = [rtps_messages.acknack(AckNack(*ids, NumberSet(1), proxy.asked, final=False))]
        else:
            missing = [
                number
                for number in range(proxy.next, min(proxy.last + 1, proxy.next + WINDOW))
                if number not in proxy.ahead and number not in proxy.parts
            ]
            out = [rtps_messages.acknack(AckNack(*ids, NumberSet(proxy.next, tuple(missing)), proxy.asked, final=True))]
            for number, assembly in proxy.parts.items():
                first = min(assembly.missing)
                wanted = tuple(sorted(one for one in assembly.missing if one < first + WINDOW))
                out.append(rtps_messages.nack_frag(NackFrag(*ids, number, NumberSet(first, wanted), proxy.asked)))
        proxy.next_ask = now + proxy.pause if self._has_holes(proxy) else None
        self._send(proxy, out)

    def _put_together(self, proxy: WriterProxy, data: RtpsData) -> RtpsData | None:
        """The whole sample once its last fragment is there."""
        total = -(-data.size // data.fragment_size)
        if data.size > rtps_messages.LARGEST_SAMPLE or not data.first + data.fragments - 1 <= total <= MOST_FRAGMENTS:
            self.refused += 1
            if data.first == 1 and proxy.reliable:
                proxy.ahead[data.number] = None  # it will not be asked for again
                self._pass_on(proxy)
            return None
        held = proxy.parts.get(data.number)
        if held is None:
            if len(proxy.parts) >= MOST_IN_PARTS:
                return None  # asked for again later
            held = proxy.parts[data.number] = Assembly(data, bytearray(data.size), set(range(1, total + 1)))
        elif (held.data.size, held.data.fragment_size) != (data.size, data.fragment_size):
            self.refused += 1
            return None
        for index in range(data.fragments):
            part = data.payload[index * data.fragment_size : (index + 1) * data.fragment_size]
            at = (data.first + index - 1) * data.fragment_size
            if len(part) < min(data.fragment_size, data.size - at):
                self.refused += 1
                return None
            held.octets[at : at + min(len(part), data.size - at)] = part[: data.size - at]
            held.missing.discard(data.first + index)
        if held.missing:
            return None
        del proxy.parts[data.number]
        first = held.data
        return RtpsData(first.reader, first.writer, first.number, first.inline, bytes(held.octets), first.is_key)
