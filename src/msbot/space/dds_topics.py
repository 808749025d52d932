"""The ways of a topic into DDS: under which name, of which type, in which partitions, in which form."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from msbot.space.contract import Topic

Convert = Callable[[bytes], bytes]
"""From one form of a payload to another; raises RemoteProtocolError for one that makes no sense."""


@dataclass(frozen=True, slots=True)
class Way:
    """One name of a topic in DDS."""

    name: str
    type_name: str
    partitions: tuple[str, ...] | None = None
    """Where it is; None leaves it to the space, and to the client that names partitions itself."""
    outward: Convert | None = None
    """From the client's form to that in DDS; None = they are the same."""
    inward: Convert | None = None


WaysOf = Callable[[Topic], tuple[Way, ...]]


def as_it_is(topic: Topic) -> tuple[Way, ...]:
    """Names and types verbatim: what an agent without a blueprint does."""
    return (Way(topic.name, topic.type_name),)
