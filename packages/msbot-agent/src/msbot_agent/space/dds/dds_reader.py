"""A reader that hears writers in this process' memory and in DDS."""

from __future__ import annotations

from collections.abc import Callable
from ctypes import byref, c_int32

from msbot_agent.space.contract import Guid, Qos, Sample, Topic
from msbot_agent.space.dds.dds_endpoint import LibraryEndpoint
from msbot_agent.space.dds.libddsc import DdsLibrary, Matched, Missed
from msbot_agent.space.dds.raw_type import BATCH, Serialiser
from msbot_agent.space.dds.remote_endpoints import RemoteEndpoints
from msbot_agent.space.dds.waiter import Waiter
from msbot_agent.space.dds_topics import Convert
from msbot_agent.space.readers import MemoryReader, SelectiveReader
from msbot_xrce.errors import RemoteProtocolError

SUBSCRIPTION_MATCHED = 1 << 12
REQUESTED_INCOMPATIBLE = 1 << 4
SAMPLE_LOST = 1 << 5
REQUESTED_STATUSES = SUBSCRIPTION_MATCHED | REQUESTED_INCOMPATIBLE | SAMPLE_LOST

MAX_PEERS = 1024
"""Writers in other programs whose samples are numbered; beyond, the numbers start over."""


class Peer:
    """A writer in another program."""

    __slots__ = ("guid", "number")

    def __init__(self, guid: Guid) -> None:
        self.guid = guid
        self.number = 0


class LibraryReader(LibraryEndpoint):
    """One reader in the library, under one of the topic's names."""

    __slots__ = ("_accept", "_convert", "_peers", "condition", "reader", "tokens")

    WRITES = False
    DIFFERS = "a DDS peer offers something else"
    LOST = "samples of DDS peers were lost"
    REFUSED = "samples of DDS peers made no sense"

    def __init__(  # noqa: PLR0917 - made by DdsSpace only
        self,
        library: DdsLibrary,
        serialiser: Serialiser,
        entity: int,
        condition: int,
        name: str,
        type_name: str,
        qos: Qos,
        neighbours: RemoteEndpoints,
        reader: MemoryReader,
        convert: Convert | None,
        domain: int,
    ) -> None:
        super().__init__(library, serialiser, entity, name, type_name, qos, neighbours, domain)
        self.condition = condition
        self.tokens = (0, 0)
        """Tokens for its data and for its statuses at the waiter."""
        self.reader = reader
        self._accept = reader.accept
        self._convert = convert
        self._peers: dict[int, Peer] = {}

    def take(self, most: int = BATCH) -> None:
        """Pass on the samples that have arrived, one batch at most."""
        taken = self._serialiser.take(self.entity, most)
        if taken is None:
            return
        accept, peers, convert = self._accept, self._peers, self._convert
        for publication, body in taken:
            peer = peers.get(publication) or self._meet(publication)
            peer.number += 1
            if convert is None:
                accept(Sample(body, peer.guid, peer.number))
            else:
                self._take_converted(convert, body, peer)

    def update_matches(self) -> None:
        """Find out which writers match and which cannot; called by the waiter."""
        calls = self._library.calls
        matched, lost = Matched(), Missed()
        if calls.dds_get_subscription_matched_status(self.entity, byref(matched)) >= 0 and matched.current_change < 0:
            self._part()
        self._look_for_incompatible()
        if calls.dds_get_sample_lost_status(self.entity, byref(lost)) >= 0:
            self.counts.lost = lost.total

    def _take_converted(self, convert: Convert, body: bytes, peer: Peer) -> None:
        try:
            payload = convert(body)
        except RemoteProtocolError:
            self.counts.refused += 1
        else:
            self._accept(Sample(payload, peer.guid, peer.number))

    def _meet(self, publication: int) -> Peer:
        if len(self._peers) >= MAX_PEERS:
            self._peers.clear()
        calls = self._library.calls
        found = calls.dds_get_matched_publication_data(self.entity, publication)
        guid = bytes(8) + publication.to_bytes(8)
        if found:
            guid = bytes(found.contents.guid)
            if isinstance(self.reader, SelectiveReader):
                strength = c_int32()
                calls.dds_qget_ownership_strength(found.contents.qos, byref(strength))
                self.reader.strengths[guid] = strength.value
            calls.dds_builtintopic_free_endpoint(found)
        peer = self._peers[publication] = Peer(guid)
        return peer

    def _part(self) -> None:
        """Forget the writers that have gone."""
        calls = self._library.calls
        for publication, peer in list(self._peers.items()):
            found = calls.dds_get_matched_publication_data(self.entity, publication)
            if found:
                calls.dds_builtintopic_free_endpoint(found)
                continue
            del self._peers[publication]
            if isinstance(self.reader, SelectiveReader):
                self.reader.forget(peer.guid)


class DdsReader:
    """Satisfies `Reader`; made by `DdsSpace.reader`.

    A reader that keeps all samples takes no more out of DDS than its history holds, so that a reliable writer elsewhere
    waits instead of losing samples.
    """

    __slots__ = ("_close", "_inlets", "_limit", "_memory", "_notes", "_paused", "_waiter", "topic")

    def __init__(
        self,
        memory: MemoryReader,
        inlets: tuple[LibraryReader, ...],
        notes: tuple[str, ...],
        waiter: Waiter,
        close: Callable[[DdsReader], None],
    ) -> None:
        """`notes` say which of its names DDS did not accept, and why."""
        self.topic: Topic = memory.topic
        self._memory = memory
        self._inlets = inlets
        self._notes = notes
        self._waiter = waiter
        self._close: Callable[[DdsReader], None] | None = close
        self._limit = memory.qos.depth if memory.qos.keep_all else None
        self._paused = False

    @property
    def delivered(self) -> int:
        """Samples taken since it was made."""
        return self._memory.delivered

    @property
    def lost(self) -> int:
        """Samples pushed out of the history before they were taken."""
        return self._memory.lost

    @property
    def inlets(self) -> tuple[LibraryReader, ...]:
        """Its readers in the library."""
        return self._inlets

    def take(self) -> Sample | None:
        """The oldest sample not yet taken, or None."""
        sample = self._memory.take()
        if self._paused and not self._memory.waiting:
            self._paused = False
            for inlet in self._inlets:
                self._waiter.resume(inlet.condition, inlet.tokens[0])
        return sample

    def arrived(self, inlet: LibraryReader) -> None:
        """There is something for an inlet; called by the waiter."""
        if self._limit is None:
            inlet.take()
            return
        inlet.take(max(1, self._limit - self._memory.waiting))
        if not self._paused and self._memory.waiting >= self._limit:
            self._paused = True
            for paused in self._inlets:
                self._waiter.pause(paused.condition)

    def troubles(self) -> tuple[str, ...]:
        """Which writers should be heard and cannot, here and elsewhere."""
        found = [*self._notes, *self._memory.troubles()]
        for inlet in self._inlets:
            found += inlet.troubles()
        return tuple(found)

    def close(self) -> None:
        """Leave the space. Closing twice does nothing."""
        if self._close is not None:
            self._close(self)
            self._close = None
            self._memory.close()
