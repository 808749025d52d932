"""The object that a client asks for, whichever form it was described in.

Two definitions compare equal exactly when CREATE with REUSE finds the object it wants (STATUS OK_MATCHED, seen on the
wire): participants by domain and name, topics by name, type and quality of service, publishers and subscribers always,
writers and readers by quality of service and topic, requesters and repliers by topics and types.

DEVIATION: the genuine agent does not compare the topic id of a writer or reader in binary form. A part that restarts
with its topics in another order would be answered OK_MATCHED and go on writing to the old topic; here the answer is a
MISMATCH, or with REPLACE the endpoint moves to the new topic.
"""

from __future__ import annotations

from dataclasses import field
from typing import TypeAlias

from msbot_xrce.lazy import dataclass

FurtherQos: TypeAlias = tuple[tuple[str, str], ...]
"""Quality of service that no data space here supports: it is only compared."""


@dataclass(frozen=True, slots=True)
class ParticipantDef:
    """A place in one domain."""

    domain_id: int
    """255 = the agent's own."""
    name: str


@dataclass(frozen=True, slots=True)
class TopicDef:
    """A topic of a participant."""

    name: str
    type_name: str
    """Empty when the client did not say."""
    keep_all: bool = False
    depth: int | None = None
    further: FurtherQos = ()


@dataclass(frozen=True, slots=True)
class PublisherDef:
    """A group of writers."""

    name: str = field(default="", compare=False)


@dataclass(frozen=True, slots=True)
class SubscriberDef:
    """A group of readers."""

    name: str = field(default="", compare=False)


@dataclass(frozen=True, slots=True)
class _EndpointDef:
    topic_id: int | None
    """The topic's object id (binary form); None: the topic is given by name."""
    topic_name: str | None
    """The topic's name (XML and reference); None: the topic is given by id."""
    type_name: str | None = field(compare=False)
    """What the endpoint says about its type; the topic's own type counts."""
    reliable: bool
    transient_local: bool
    """Also for the stronger durabilities TRANSIENT and PERSISTENT."""
    keep_all: bool = False
    depth: int | None = None
    """Samples kept per writer or reader; None = not said."""
    late_depth: int | None = None
    """Samples kept for readers that come later (durability service); None = `depth`."""
    partitions: tuple[str, ...] = ()
    deadline_s: float | None = None
    lifespan_s: float | None = None
    exclusive: bool = False
    """Ownership."""
    strength: int = 0
    """Strength of a writer, where ownership is exclusive."""
    separation_s: float = 0.0
    """Time-based filter of a reader."""
    further: FurtherQos = ()


@dataclass(frozen=True, slots=True)
class WriterDef(_EndpointDef):
    """A data writer."""


@dataclass(frozen=True, slots=True)
class ReaderDef(_EndpointDef):
    """A data reader."""


@dataclass(frozen=True, slots=True)
class _ServiceDef:
    service_name: str = field(compare=False)
    request_type: str
    reply_type: str
    request_topic: str
    reply_topic: str


@dataclass(frozen=True, slots=True)
class RequesterDef(_ServiceDef):
    """The side of a service that asks: writes the request topic, reads the reply topic."""


@dataclass(frozen=True, slots=True)
class ReplierDef(_ServiceDef):
    """The side of a service that answers: reads the request topic, writes the reply topic."""


Definition: TypeAlias = (
    ParticipantDef | TopicDef | PublisherDef | SubscriberDef | WriterDef | ReaderDef | RequesterDef | ReplierDef
)
