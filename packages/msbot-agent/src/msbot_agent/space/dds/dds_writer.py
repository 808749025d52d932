"""A writer that is heard in this process' memory and in DDS."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from ctypes import byref

from msbot_agent.space.contract import Guid, Qos, Topic
from msbot_agent.space.dds.dds_endpoint import LibraryEndpoint
from msbot_agent.space.dds.libddsc import TIMEOUT, DdsLibrary, Matched
from msbot_agent.space.dds.raw_type import Serialiser
from msbot_agent.space.dds.remote_endpoints import RemoteEndpoints
from msbot_agent.space.dds_topics import Convert
from msbot_agent.space.memory import MemoryWriter
from msbot_xrce.errors import RemoteProtocolError

PUBLICATION_MATCHED = 1 << 11
OFFERED_INCOMPATIBLE = 1 << 3
OFFERED_STATUSES = PUBLICATION_MATCHED | OFFERED_INCOMPATIBLE


class LibraryWriter(LibraryEndpoint):
    """One writer in the library, under one of the topic's names."""

    __slots__ = ("_backlog", "_has_ended", "_retry", "has_readers", "is_kept", "sample_type", "token")

    WRITES = True
    DIFFERS = "a DDS peer asked for what is not offered"
    LOST = "samples were lost: a DDS peer does not acknowledge in time"
    REFUSED = "samples could not be written to DDS"

    def __init__(  # noqa: PLR0917 - made by DdsSpace only
        self,
        library: DdsLibrary,
        serialiser: Serialiser,
        entity: int,
        sample_type: int,
        name: str,
        type_name: str,
        qos: Qos,
        neighbours: RemoteEndpoints,
        retry: Callable[[LibraryWriter], None],
        domain: int,
    ) -> None:
        super().__init__(library, serialiser, entity, name, type_name, qos, neighbours, domain)
        self.sample_type = sample_type
        self.has_readers = False
        """Whether another program reads it now."""
        self.is_kept = qos.transient_local
        """Whether samples are written even if nobody reads them yet."""
        self.token = 0
        """Its token at the waiter."""
        self._retry = retry
        self._backlog: deque[bytes] = deque()
        self._has_ended = False

    @property
    def waiting(self) -> int:
        """Samples for which a slow peer has no room now."""
        return len(self._backlog)

    def write(self, payload: bytes) -> None:
        """Write a sample; without room it waits, up to the writer's depth, beyond which the oldest is dropped."""
        if self._backlog:
            self._wait(payload)
        elif self._put(payload) == TIMEOUT:
            self._wait(payload)
            self._retry(self)

    def flush(self) -> bool:
        """Write the samples that wait; True when none is left."""
        backlog = self._backlog
        while backlog:
            if self._put(backlog[0]) == TIMEOUT:
                return False
            backlog.popleft()
        return True

    def update_matches(self) -> None:
        """Find out which readers match and which cannot; called by the waiter."""
        matched = Matched()
        if self._library.calls.dds_get_publication_matched_status(self.entity, byref(matched)) >= 0:
            self.has_readers = matched.current > 0
            if not self.has_readers:
                self._backlog.clear()  # there is no reader left to wait for
        self._look_for_incompatible()

    def close(self) -> None:
        """Forget the samples that wait."""
        self._backlog.clear()

    def end(self) -> None:
        """The space leaves DDS, and the library forgets the writer: what is written from now on goes nowhere."""
        self._has_ended = True
        self.close()

    def _put(self, payload: bytes) -> int:
        if self._has_ended:
            return 0
        try:
            code = self._serialiser.write(self.entity, self.sample_type, payload)
        except RemoteProtocolError:
            code = 0
            self.counts.refused += 1
        if code < 0 and code != TIMEOUT:
            self.counts.refused += 1
        return code

    def _wait(self, payload: bytes) -> None:
        if not self.qos.reliable:
            self.counts.lost += 1
            return
        if len(self._backlog) >= self.qos.depth:
            self._backlog.popleft()
            self.counts.lost += 1
        self._backlog.append(payload)


class DdsWriter:
    """Satisfies `Writer`; made by `DdsSpace.writer`."""

    __slots__ = ("_close", "_memory", "_notes", "_outlets", "guid", "topic")

    def __init__(
        self,
        memory: MemoryWriter,
        outlets: tuple[tuple[LibraryWriter, Convert | None], ...],
        notes: tuple[str, ...],
        close: Callable[[DdsWriter], None],
    ) -> None:
        """`notes` say which of its names DDS did not accept, and why."""
        self.guid = memory.guid
        self.topic: Topic = memory.topic
        self._memory = memory
        self._outlets = outlets
        self._notes = notes
        self._close: Callable[[DdsWriter], None] | None = close

    @property
    def published(self) -> int:
        """Samples written since it was made."""
        return self._memory.published

    @property
    def readers(self) -> int:
        """Readers that match it now: those here, and one for each topic of DDS that has some."""
        return self._memory.readers + sum(outlet.has_readers for outlet, _ in self._outlets)

    @property
    def outlets(self) -> tuple[LibraryWriter, ...]:
        """Its writers in the library."""
        return tuple(outlet for outlet, _ in self._outlets)

    def write(self, payload: bytes, related: tuple[Guid, int] | None = None) -> int:
        """Give one sample to every matched reader here and elsewhere; returns its sequence number."""
        number = self._memory.write(payload, related)
        for outlet, convert in self._outlets:
            if outlet.has_readers or outlet.is_kept:
                self._write_out(outlet, convert, payload)
        return number

    def troubles(self) -> tuple[str, ...]:
        """Which readers should hear it and cannot, here and elsewhere."""
        found = [*self._notes, *self._memory.troubles()]
        for outlet, _ in self._outlets:
            found += outlet.troubles()
        return tuple(found)

    def close(self) -> None:
        """Leave the space. Closing twice does nothing."""
        if self._close is not None:
            self._close(self)
            self._close = None
            self._memory.close()

    def _write_out(self, outlet: LibraryWriter, convert: Convert | None, payload: bytes) -> None:
        if convert is None:
            outlet.write(payload)
            return
        try:
            converted = convert(payload)
        except RemoteProtocolError:
            outlet.counts.refused += 1
        else:
            outlet.write(converted)
