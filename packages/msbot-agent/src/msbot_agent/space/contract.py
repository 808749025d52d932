"""What a data space is: topics, samples, quality of service. Payloads are opaque octets (CDR, little endian).

The agent acts in a space for its clients; which space that is (this process' memory, DDS) is decided where the agent is
set up. A space matches writers and readers by domain, topic name, type name and quality of service.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Protocol, runtime_checkable

from msbot_xrce.lazy import dataclass


@dataclass(frozen=True, slots=True)
class Qos:
    """The part of DDS quality of service that MsBOT honours (DDS 1.4 §2.2.3)."""

    reliable: bool = True
    transient_local: bool = False
    """The writer keeps its last `depth` samples for readers that come later."""
    keep_all: bool = False
    """Keep all samples; still bounded by `depth`."""
    depth: int = 16
    """Samples kept per writer (late joiners) and per reader (slow readers), at least 1."""
    late_depth: int | None = None
    """Writer: samples kept for late joiners, if not `depth` (DDS: durability service)."""
    partitions: tuple[str, ...] = ()
    """Groups within the topic, with the wildcards * and ?; empty = the group without a name."""
    deadline_s: float | None = None
    """A sample is promised (writer) or expected (reader) at least this often."""
    lifespan_s: float | None = None
    """Writer: how long a sample stays valid."""
    exclusive: bool = False
    """A reader hears only one writer: the strongest of those that write."""
    strength: int = 0
    """Writer: the strongest one is heard where ownership is exclusive."""
    separation_s: float = 0.0
    """Reader: it wants at most one sample in this time (DDS: time-based filter)."""
    service: bool = False
    """Whether it carries requests or replies of a service, whose identity travels beside the payload."""


@dataclass(frozen=True, slots=True)
class Topic:
    """What writers and readers must agree on to be matched."""

    name: str
    type_name: str
    domain: int = 0


Guid = bytes
"""16 bytes: 12 prefix (who) + 4 entity id, as in DDS."""


@dataclass(frozen=True, slots=True)
class Owner:
    """Whose a writer or reader is. It does not matter for who hears whom, only for what peers are told of it."""

    client: int = 0
    """The agent's key of the client; 0: it is this program's own."""
    participant: str = ""
    """Name of the client's participant."""


THIS_PROGRAM = Owner()


@dataclass(slots=True)
class Sample:
    """One value on its way from a writer to its readers."""

    payload: bytes
    writer: Guid
    sequence_nr: int
    """Counted per writer from 1."""
    related: tuple[Guid, int] | None = None
    """For a reply: the writer and sequence number of the request it answers."""
    expires_at: float | None = None
    """When it stops being valid, by the space's clock."""


Deliver = Callable[[Sample], bool]
"""Takes a sample now (True) or leaves it in the reader's history for a later `take` (False). Must not raise."""


class Writer(Protocol):
    """A data writer in the space."""

    guid: Guid
    topic: Topic

    @property
    def published(self) -> int:
        """Samples written since it was made."""

    @property
    def readers(self) -> int | None:
        """Readers that match it now, here and elsewhere; None: nobody can know."""

    def write(self, payload: bytes, related: tuple[Guid, int] | None = None) -> int:
        """Give one sample to every matched reader; returns its sequence number."""

    def troubles(self) -> tuple[str, ...]:
        """Which endpoints should match it now and cannot, one sentence each, with the policy's name."""

    def close(self) -> None:
        """Leave the space; unmatches all readers."""


class Reader(Protocol):
    """A data reader in the space."""

    topic: Topic

    @property
    def delivered(self) -> int:
        """Samples taken since it was made (by `Deliver` returning True or by `take`)."""

    @property
    def lost(self) -> int:
        """Samples pushed out of the history before they were taken."""

    def take(self) -> Sample | None:
        """The oldest sample not yet taken, or None."""

    def troubles(self) -> tuple[str, ...]:
        """Which endpoints should match it now and cannot, and which promises are broken, one sentence each."""

    def close(self) -> None:
        """Leave the space; unmatches all writers."""


class Space(Protocol):
    """Where writers and readers meet."""

    words: str | None
    """Where the space is, for people; None when it is only in this process."""

    def writer(self, topic: Topic, qos: Qos, guid: Guid, owner: Owner = THIS_PROGRAM) -> Writer:
        """Make a writer and match it with every compatible reader."""

    def reader(self, topic: Topic, qos: Qos, deliver: Deliver, owner: Owner = THIS_PROGRAM) -> Reader:
        """Make a reader; samples that late joiners get are delivered at once."""


@dataclass(frozen=True, slots=True)
class OwnEndpoint:
    """A writer or reader of this program as peers in other programs discover it."""

    owner: Owner
    domain: int
    name: str
    """The topic's name there."""
    type_name: str
    guid: Guid
    """By which the peers know it."""
    is_writer: bool


@runtime_checkable
class SharedSpace(Space, Protocol):
    """A space in which other programs take part, too."""

    def participants(self) -> Mapping[int, Guid]:
        """The GUID of this program's participant in each domain that it has joined."""

    def endpoints(self) -> Iterator[OwnEndpoint]:
        """This program's writers and readers."""

    def on_endpoints(self, listener: Callable[[], object]) -> None:
        """Call the listener whenever `endpoints` gives something else than before."""
