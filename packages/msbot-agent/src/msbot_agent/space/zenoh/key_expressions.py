"""The names of topics and endpoints in Zenoh.

A topic's samples have the key `msbot/PARTITION/DOMAIN/TOPIC/TYPE`; a topic with slashes has several words. What Zenoh
does not allow in a word is percent-encoded, and `-` stands for the partition without a name. Each writer and reader
makes itself known by a liveliness token below that key, which says what it offers or asks for.
"""

from __future__ import annotations

from urllib.parse import quote, unquote

from msbot_agent.space.contract import Guid, Qos
from msbot_xrce.lazy import dataclass

ROOT = "msbot"
NO_PARTITION = "-"
GRAPH = "@graph"
"""Begins the part of a token's key that describes an endpoint; `*` does not stand for it."""

_PLAIN = ":[]<>(),=+&;!'"
_RELIABLE, _TRANSIENT_LOCAL, _EXCLUSIVE = 1, 2, 4


def data_key(partition: str, domain: int, topic: str, type_name: str) -> str:
    """Where the samples of a topic are; a partition with wildcards becomes `*`, and the reader has to look closer."""
    return f"{_topic_key(partition, domain, topic)}/{_word(type_name)}"


def partition_of(key: str) -> str:
    """The partition in the key of a sample."""
    word = key.split("/", 2)[1]
    return "" if word == NO_PARTITION else unquote(word)


def graph_key(partition: str, domain: int, topic: str) -> str:
    """The keys of the tokens of everybody at a topic, whatever its type."""
    return f"{_topic_key(partition, domain, topic)}/*/{GRAPH}/**"


def token_key(key: str, guid: Guid, qos: Qos, *, writes: bool) -> str:
    """The token of an endpoint whose samples have that key."""
    return f"{key}/{GRAPH}/{'w' if writes else 'r'}/{guid.hex()}/{flags(qos):x}/{qos.deadline_s or 0:g}"


@dataclass(frozen=True, slots=True)
class PeerEndpoint:
    """A writer or reader of another program, as its token describes it."""

    guid: Guid
    type_name: str
    qos: Qos
    is_writer: bool


def endpoint_of(token: str) -> PeerEndpoint | None:
    """The endpoint that a token describes; None when it makes no sense."""
    before, found, after = token.partition(f"/{GRAPH}/")
    words = after.split("/")
    if not found or len(words) != 4 or words[0] not in ("w", "r"):
        return None
    try:
        guid, number, deadline = bytes.fromhex(words[1]), int(words[2], 16), float(words[3])
    except ValueError:
        return None
    return PeerEndpoint(guid, unquote(before.rpartition("/")[2]), qos_of(number, deadline), words[0] == "w")


def flags(qos: Qos) -> int:
    """What decides whether writer and reader match, as a number."""
    return _RELIABLE * qos.reliable + _TRANSIENT_LOCAL * qos.transient_local + _EXCLUSIVE * qos.exclusive


def qos_of(number: int, deadline_s: float) -> Qos:
    """The quality of service of an endpoint elsewhere; it has the same partition, since it has the same key."""
    return Qos(
        reliable=bool(number & _RELIABLE),
        transient_local=bool(number & _TRANSIENT_LOCAL),
        exclusive=bool(number & _EXCLUSIVE),
        deadline_s=deadline_s if deadline_s > 0 else None,
    )


def has_wildcards(partition: str) -> bool:
    """Whether a partition is a pattern."""
    return any(mark in partition for mark in "*?[")


def _topic_key(partition: str, domain: int, topic: str) -> str:
    words = topic.split("/")
    name = "/".join(map(_word, words)) if all(words) else quote(topic, safe=_PLAIN)
    return f"{ROOT}/{_partition(partition)}/{domain}/{name}"


def _partition(partition: str) -> str:
    if not partition:
        return NO_PARTITION
    if has_wildcards(partition):
        return "*"
    return "%2D" if partition == NO_PARTITION else _word(partition)


def _word(text: str) -> str:
    return quote(text, safe=_PLAIN)
