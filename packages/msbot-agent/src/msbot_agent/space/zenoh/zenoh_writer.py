"""A writer that is heard in this process' memory and in Zenoh."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from types import ModuleType
from typing import TYPE_CHECKING

from msbot_agent.space.contract import Guid, Topic
from msbot_agent.space.dds_topics import Convert
from msbot_agent.space.memory import MemoryWriter
from msbot_agent.space.zenoh.key_expressions import PeerEndpoint
from msbot_agent.space.zenoh.sample_envelope import EnvelopeWriter, call_on_loop
from msbot_agent.space.zenoh.zenoh_endpoint import MAX_NEIGHBOURS, LibraryEndpoint
from msbot_xrce.errors import RemoteProtocolError

if TYPE_CHECKING:
    import zenoh

LEAST_REPEATABLE = 64
"""Samples of a reliable, volatile writer that can be repeated, whatever its depth."""
HEARTBEAT_S = 0.2
"""How long after the last sample a reader may learn that it has missed it."""
SETTLE_S = 0.25
"""How long a writer that keeps samples waits for the router to tell who reads: a reader that hears a later sample first
does not accept the earlier ones any more."""
IDLE_S = 1.0
"""A reliable writer that has been idle for so long, or twice that, repeats its last sample: if the connection was
congested, the last ones may have been dropped, and the library's heartbeat with them."""
REPETITIONS = 4
"""How often it does while it stays idle, each time after twice as long: the connection may still be congested."""
REPEAT_S = 0.2
"""How long after a reader is back the last sample is repeated; its subscription may come after its token."""


class LibraryWriter(LibraryEndpoint):
    """One writer in Zenoh, under one of the topic's names."""

    __slots__ = (
        "_awaited",
        "_has_written",
        "_is_watched",
        "_known",
        "_last",
        "_next_repetition",
        "_put",
        "_readers",
        "_sealer",
        "_told_open",
        "_zenoh_error",
        "is_kept",
        "is_wanted",
        "outward",
    )

    WRITES = True
    LOST = "samples were lost on the way to Zenoh peers"
    REFUSED = "samples could not be written to Zenoh"

    def __init__(self, *arguments: object, outward: Convert | None, is_request: bool) -> None:
        super().__init__(*arguments)  # type: ignore[arg-type]
        self.outward = outward
        self.is_kept = self.qos.transient_local or is_request
        """Whether samples are written even if nobody reads them yet."""
        self.is_wanted = False
        """Whether another program reads it; for a reliable writer, whether one ever did: it may only be cut off."""
        self._readers: set[Guid] = set()
        self._known: set[Guid] = set()
        """Readers that were there at some time: one that appears again was cut off."""
        self._last: tuple[bytes, int, tuple[Guid, int] | None] | None = None
        self._has_written = False
        """Whether it has since somebody looked whether it is idle."""
        self._is_watched = False
        self._next_repetition: asyncio.TimerHandle | None = None
        self._awaited: int | None = None
        """Number of the first sample that a reader was there for, while it could not be sent yet."""
        self._put: Callable[..., None] | None = None
        self._zenoh_error: type[Exception] = RemoteProtocolError
        """The library's error, once the library is there."""
        self._told_open: Callable[[LibraryWriter], None] = lambda _: None
        self._sealer = EnvelopeWriter(self._guid, self.qos)

    def on_open(self, listener: Callable[[LibraryWriter], None]) -> None:
        """Call the listener on the loop when samples can be written."""
        self._told_open = listener

    def write(
        self, payload: bytes, number: int, related: tuple[Guid, int] | None = None, *, is_kept: bool = False
    ) -> None:
        """Write a sample, or one that was kept while there was no connection (`is_kept`); never waits."""
        if self._put is None:
            if self.is_wanted and self._awaited is None:
                self._awaited = number
            return
        if not (self.is_wanted or self.is_kept):
            return
        try:
            octets = payload if self.outward is None else self.outward(payload)
        except RemoteProtocolError:
            self.refused += 1
            return
        is_late = is_kept and (self._awaited is None or number < self._awaited)
        if self.qos.reliable:
            self._last = octets, number, related
            self._has_written = True
            if not self._is_watched:
                self._watch()
        self._send(octets, self._sealer.seal(number, related, is_repeated=is_late))

    def close(self) -> None:
        """Write nothing more."""
        self.is_open = False
        self._put = self._last = None
        self._news.clear()

    def _declare_data(self, library: ModuleType, session: zenoh.Session) -> None:
        options = {
            "congestion_control": library.CongestionControl.DROP,
            "allowed_destination": library.Locality.REMOTE,
        }
        qos, ext = self.qos, library.ext
        if not qos.reliable and not qos.transient_local:
            publisher = session.declare_publisher(self.key, **options)
        else:
            kept = (qos.late_depth or qos.depth) if qos.transient_local else max(qos.depth, LEAST_REPEATABLE) + 1
            publisher = ext.declare_advanced_publisher(
                session,
                self.key,
                cache=ext.CacheConfig(max(1, kept)),
                publisher_detection=True,
                sample_miss_detection=ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=HEARTBEAT_S),
                **options,
            )
        self._declared.append(publisher)
        self._zenoh_error = library.ZError
        if self.qos.transient_local:
            call_on_loop(self._loop, self._loop.call_later, SETTLE_S, self._opened, publisher.put)
        else:  # at once: before its readers are heard of
            call_on_loop(self._loop, self._opened, publisher.put)

    def _opened(self, put: Callable[..., None]) -> None:
        if self.is_open:
            self._put = put
            self._told_open(self)

    def _appeared(self, other: PeerEndpoint) -> None:
        if self.qos.reliable and not other.qos.transient_local:
            if other.guid in self._known:
                self._loop.call_later(REPEAT_S, self._repeat)
            elif len(self._known) < MAX_NEIGHBOURS:
                self._known.add(other.guid)
        self._readers.add(other.guid)
        self.is_wanted = True

    def _watch(self) -> None:
        """Look from time to time whether it is idle, instead of starting a timer anew with each sample."""
        if self._next_repetition is not None:
            self._next_repetition.cancel()
        self._is_watched = True
        self._loop.call_later(IDLE_S, self._look_if_idle)

    def _look_if_idle(self) -> None:
        if self._has_written and self.is_open:
            self._has_written = False
            self._loop.call_later(IDLE_S, self._look_if_idle)
        else:
            self._is_watched = False
            self._repeat_while_idle(REPETITIONS - 1, 2 * IDLE_S)

    def _repeat_while_idle(self, left: int, after_s: float) -> None:
        self._repeat()
        self._next_repetition = None
        if left and self.is_open:
            self._next_repetition = self._loop.call_later(after_s, self._repeat_while_idle, left - 1, 2 * after_s)

    def _repeat(self) -> None:
        """A reader that was cut off has to notice what it has missed, or it would only ask with the next sample."""
        if self._last is not None:
            octets, number, related = self._last
            self._send(octets, self._sealer.seal(number, related, is_repeated=True))

    def _send(self, octets: bytes, envelope: bytes) -> None:
        if self._put is not None:
            try:
                self._put(octets, attachment=envelope)
            except self._zenoh_error:
                self.refused += 1

    def _gone(self, other: PeerEndpoint) -> None:
        self._readers.discard(other.guid)
        self.is_wanted = self.qos.reliable or bool(self._readers)


class ZenohWriter:
    """Satisfies `Writer`; made by `ZenohSpace.writer`."""

    __slots__ = ("_close", "_memory", "_notes", "_own", "guid", "outlets", "topic")

    def __init__(
        self,
        memory: MemoryWriter,
        outlets: tuple[LibraryWriter, ...],
        notes: tuple[str, ...],
        own: Mapping[Guid, Guid],
        close: Callable[[ZenohWriter], None],
    ) -> None:
        """`notes` say what cannot cross; `own` are this program's requesters, which are answered in memory."""
        self.guid = memory.guid
        self.topic: Topic = memory.topic
        self.outlets = outlets
        self._memory = memory
        self._notes = notes
        self._own = own
        self._close: Callable[[ZenohWriter], None] | None = close
        for outlet in outlets:
            outlet.on_open(self._catch_up)

    @property
    def published(self) -> int:
        """Samples written since it was made."""
        return self._memory.published

    @property
    def readers(self) -> int | None:
        """Not known of those elsewhere."""
        return self._memory.readers or (None if self.outlets else 0)

    def write(self, payload: bytes, related: tuple[Guid, int] | None = None) -> int:
        """Give one sample to every matched reader here and elsewhere; returns its sequence number."""
        number = self._memory.write(payload, related)
        if related is None or related[0] not in self._own:
            for outlet in self.outlets:
                outlet.write(payload, number, related)
        return number

    def troubles(self) -> tuple[str, ...]:
        """Which readers should hear it and cannot, here and elsewhere."""
        found = [*self._notes, *self._memory.troubles()]
        for outlet in self.outlets:
            found += outlet.troubles()
        return tuple(found)

    def close(self) -> None:
        """Leave the space. Closing twice does nothing."""
        if self._close is not None:
            self._close(self)
            self._close = None
            self._memory.close()

    def _catch_up(self, outlet: LibraryWriter) -> None:
        """What was kept for late readers before there was a connection."""
        for sample in tuple(self._memory.history):
            outlet.write(sample.payload, sample.sequence_nr, sample.related, is_kept=True)
