"""The data space: topics, samples, quality of service. Payloads are opaque bytes (CDR, little endian).

The agent acts in a space for its clients; which space it is (this process' memory, DDS) is decided where the
agent is put together. A space matches writers and readers by domain, topic name and type name.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, slots=True)
class Qos:
    """The part of DDS quality of service that MsBOT honours."""

    reliable: bool = True
    transient_local: bool = False
    """The writer keeps its last `depth` samples for readers that come later."""
    keep_all: bool = False
    """Bounded all the same: see `depth`."""
    depth: int = 16
    """Samples kept per writer (late joiners) and per reader (slow readers), at least 1."""


@dataclass(frozen=True, slots=True)
class Topic:
    """What writers and readers must agree on to be matched."""

    name: str
    type_name: str
    domain: int = 0


Guid = bytes
"""16 bytes: 12 prefix (who) + 4 entity id, as in DDS."""


@dataclass(slots=True)
class Sample:
    """One value on its way from a writer to its readers."""

    payload: bytes
    writer: Guid
    sequence_nr: int
    """Counted per writer from 1."""
    related: tuple[Guid, int] | None = None
    """For a reply: the writer and sequence number of the request it answers."""


Deliver = Callable[[Sample], bool]
"""Takes a sample now (True) or leaves it in the reader's history for a later `take` (False). Must not raise."""


class Writer(Protocol):
    """A data writer in the space."""

    guid: Guid
    topic: Topic
    published: int
    """Samples written since it was made."""

    def write(self, payload: bytes, related: tuple[Guid, int] | None = None) -> int:
        """Give one sample to every matched reader; returns its sequence number."""

    def close(self) -> None:
        """Leave the space; unmatches all readers."""


class Reader(Protocol):
    """A data reader in the space."""

    topic: Topic
    delivered: int
    """Samples taken since it was made (by `Deliver` returning True or by `take`)."""
    lost: int
    """Samples pushed out of the history before anybody took them."""

    def take(self) -> Sample | None:
        """The oldest sample not yet taken, or None."""

    def close(self) -> None:
        """Leave the space; unmatches all writers."""


class Space(Protocol):
    """Where writers and readers meet."""

    def writer(self, topic: Topic, qos: Qos, guid: Guid) -> Writer:
        """Make a writer and match it with every fitting reader."""

    def reader(self, topic: Topic, qos: Qos, deliver: Deliver) -> Reader:
        """Make a reader; samples that late joiners get are delivered at once."""


# The space in memory stands below because it needs the words above.
from msbot.space.memory import MemorySpace  # noqa: E402

__all__ = ["Deliver", "Guid", "MemorySpace", "Qos", "Reader", "Sample", "Space", "Topic", "Writer"]
