"""What a topic is in DDS: its names, its type, its partitions, and the form of its samples."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from msbot.space.contract import Topic

Convert = Callable[[bytes], bytes]
"""From one form of a payload to another; raises RemoteProtocolError for one that makes no sense."""


@dataclass(frozen=True, slots=True)
class DdsTopic:
    """One of the names under which a topic is in DDS."""

    name: str
    type_name: str
    partitions: tuple[str, ...] | None = None
    """Where it is; None leaves it to the space, and to the client that names partitions itself."""
    outward: Convert | None = None
    """From the client's form to that in DDS; None = they are the same."""
    inward: Convert | None = None


DdsTopicsOf = Callable[[Topic], tuple[DdsTopic, ...]]


def as_it_is(topic: Topic) -> tuple[DdsTopic, ...]:
    """Names and types verbatim: what an agent without a blueprint does."""
    return (DdsTopic(topic.name, topic.type_name),)
