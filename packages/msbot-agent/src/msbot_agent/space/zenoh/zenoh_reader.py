"""A reader that hears writers in this process' memory and in Zenoh."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import ModuleType
from typing import TYPE_CHECKING

from msbot_agent.space.contract import Guid, Sample, Topic
from msbot_agent.space.dds_topics import Convert
from msbot_agent.space.qos_matching import mismatch, partitions_meet
from msbot_agent.space.readers import Clock, MemoryReader, SelectiveReader
from msbot_agent.space.zenoh.key_expressions import PeerEndpoint, has_wildcards, partition_of
from msbot_agent.space.zenoh.sample_envelope import LoopQueue, SampleEnvelope, read_envelope
from msbot_agent.space.zenoh.zenoh_endpoint import LibraryEndpoint
from msbot_xrce.errors import RemoteProtocolError

if TYPE_CHECKING:
    import zenoh

MAX_PEERS = 1024
"""Writers in other programs that are remembered for one reader; beyond, all are met anew.

They are remembered when they are gone, too: they may only be cut off. A sample may come twice, by two names of a topic
or because it was repeated; its number tells.
"""
LEAST_WAITING = 1024
"""Samples of one reader that may wait for the loop, whatever its depth."""


class Peer:
    """A writer in another program."""

    __slots__ = ("fits", "newest")

    def __init__(self, *, fits: bool) -> None:
        self.fits = fits
        self.newest = 0


class LibraryReader(LibraryEndpoint):
    """One reader in Zenoh, under one of the topic's names."""

    __slots__ = ("_clock", "_credit", "_given_way", "_inward", "_own_of", "_peers", "_reader", "_samples")

    WRITES = False
    LOST = "samples were lost on the way from a Zenoh peer"
    REFUSED = "samples of Zenoh peers made no sense"

    def __init__(
        self,
        *arguments: object,
        inward: Convert | None,
        reader: MemoryReader,
        peers: dict[Guid, Peer],
        own_of: Mapping[Guid, Guid],
        clock: Clock,
    ) -> None:
        """`own_of` maps the identity by which others know a requester of this program to its own."""
        super().__init__(*arguments)  # type: ignore[arg-type]
        self._inward = inward
        self._reader = reader
        self._peers = peers
        self._own_of = own_of
        self._clock = clock
        self._samples: LoopQueue[zenoh.Sample] = LoopQueue(
            self._loop, self._take, max(self.qos.depth, LEAST_WAITING), lambda sample: len(sample.payload)
        )
        self._given_way = 0
        """Samples that gave way and are counted."""
        self._credit = 0
        """... and have not been seen as gaps between numbers."""

    def close(self) -> None:
        """Take nothing more."""
        self.is_open = False
        self._news.clear()
        self._samples.clear()

    def _declare_data(self, library: ModuleType, session: zenoh.Session) -> None:
        callback = library.handlers.Callback(self._samples.put, indirect=False)
        qos, ext = self.qos, library.ext
        options = {"allowed_origin": library.Locality.REMOTE}
        if not qos.reliable and not qos.transient_local:
            self._declared.append(session.declare_subscriber(self.key, callback, **options))
            return
        history = ext.HistoryConfig(detect_late_publishers=True, max_samples=qos.depth) if qos.transient_local else None
        recovery = ext.RecoveryConfig(periodic_queries=None, heartbeat=True) if qos.reliable else None
        subscriber = ext.declare_advanced_subscriber(
            session, self.key, callback, history=history, recovery=recovery, **options
        )
        self._declared.append(subscriber)

    def _take(self, sample: zenoh.Sample) -> None:
        attachment = sample.attachment
        envelope = None if attachment is None else read_envelope(attachment.to_bytes())
        if envelope is None:
            self.refused += 1
            return
        peer = self._peers.get(envelope.writer) or self._meet(envelope)
        if not peer.fits or envelope.number <= peer.newest:
            return
        if envelope.is_repeated and peer.newest == 0 and not self.qos.transient_local:
            return  # it is older than this reader
        if has_wildcards(self.partition) and not partitions_meet(
            (partition_of(str(sample.key_expr)),), (self.partition,)
        ):
            return
        if self.qos.reliable:
            self._look_for_losses(envelope, peer.newest)
        peer.newest = envelope.number
        if isinstance(self._reader, SelectiveReader):
            self._reader.strengths[envelope.writer] = envelope.offered.strength
        related = envelope.related
        if related is not None:
            asker = self._own_of.get(related[0])
            if asker is None:
                return  # the answer to somebody else
            related = asker, related[1]
        payload = sample.payload.to_bytes()
        if self._inward is not None:
            try:
                payload = self._inward(payload)
            except RemoteProtocolError:
                self.refused += 1
                return
        lifespan = envelope.offered.lifespan_s
        expires_at = None if lifespan is None else self._clock() + lifespan
        self._reader.accept(Sample(payload, envelope.writer, envelope.number, related, expires_at))

    def _look_for_losses(self, envelope: SampleEnvelope, newest: int) -> None:
        """Count what gave way here, and what the numbers show to be missing besides."""
        if self._samples.lost != self._given_way:
            here, self._given_way = self._samples.lost - self._given_way, self._samples.lost
            self._credit += here
            self._count_lost(here)
        if newest == 0:
            newest = self._before_the_first(envelope)
        if envelope.number > newest + 1:
            missing = envelope.number - newest - 1
            known = min(missing, self._credit)
            self._credit -= known
            if missing > known:
                self._count_lost(missing - known)

    def _before_the_first(self, envelope: SampleEnvelope) -> int:
        """The number before the first sample of a writer that came here, whether that could be taken or gave way."""
        first = self._samples.first_lost
        attachment = None if first is None else first.attachment
        lost = None if attachment is None else read_envelope(attachment.to_bytes())
        return (envelope if lost is None or lost.writer != envelope.writer else lost).number - 1

    def _meet(self, envelope: SampleEnvelope) -> Peer:
        if len(self._peers) >= MAX_PEERS:
            self._peers.clear()
        peer = self._peers[envelope.writer] = Peer(fits=mismatch(envelope.offered, self.qos) is None)
        return peer

    def _gone(self, other: PeerEndpoint) -> None:
        if isinstance(self._reader, SelectiveReader):
            self._reader.forget(other.guid)


class ZenohReader:
    """Satisfies `Reader`; made by `ZenohSpace.reader`."""

    __slots__ = ("_close", "_memory", "_notes", "inlets", "topic")

    def __init__(
        self,
        memory: MemoryReader,
        inlets: tuple[LibraryReader, ...],
        notes: tuple[str, ...],
        close: Callable[[ZenohReader], None],
    ) -> None:
        """`notes` say what cannot cross."""
        self.topic: Topic = memory.topic
        self.inlets = inlets
        self._memory = memory
        self._notes = notes
        self._close: Callable[[ZenohReader], None] | None = close

    @property
    def delivered(self) -> int:
        """Samples taken since it was made."""
        return self._memory.delivered

    @property
    def lost(self) -> int:
        """Samples pushed out of the history before they were taken."""
        return self._memory.lost

    def take(self) -> Sample | None:
        """The oldest sample not yet taken, or None."""
        return self._memory.take()

    def troubles(self) -> tuple[str, ...]:
        """Which writers should be heard and cannot, here and elsewhere."""
        found = [*self._notes, *self._memory.troubles()]
        for inlet in self.inlets:
            found += inlet.troubles()
        return tuple(found)

    def close(self) -> None:
        """Leave the space. Closing twice does nothing."""
        if self._close is not None:
            self._close(self)
            self._close = None
            self._memory.close()
