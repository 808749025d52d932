"""What travels beside each sample: who wrote it, its number, what the writer offers, and which request it answers."""

from __future__ import annotations

from struct import Struct

from msbot_agent.space.contract import Guid, Qos
from msbot_agent.space.zenoh.keys import flags, qos_of
from msbot_xrce.common.lazy_dataclass import dataclass

VERSION = 1
_REPEATED = 0x80
_PLAIN = Struct("<BB16sQiff")
_RELATED = Struct("<16sQ")
_WITH_RELATED = _PLAIN.size + _RELATED.size
LONGEST_S = 1e9
"""Times above this are none."""


@dataclass(frozen=True, slots=True)
class SampleEnvelope:
    """The envelope of a sample that came in."""

    writer: Guid
    number: int
    offered: Qos
    related: tuple[Guid, int] | None
    is_repeated: bool
    """It was written before: repeated, so that a reader that was cut off notices what it has missed, or written before
    there was a connection. It is not for volatile readers that have heard nothing of this writer yet."""


class Sealer:
    """Makes the envelopes of one writer."""

    __slots__ = ("_deadline", "_flags", "_guid", "_lifespan", "_strength")

    def __init__(self, guid: Guid, qos: Qos) -> None:
        """`guid` is the one by which others know it."""
        self._guid = guid
        self._flags = flags(qos)
        self._strength = qos.strength
        self._deadline = qos.deadline_s or 0.0
        self._lifespan = qos.lifespan_s or 0.0

    def seal(self, number: int, related: tuple[Guid, int] | None = None, *, is_repeated: bool = False) -> bytes:
        """The envelope of a sample."""
        flags_now = self._flags | _REPEATED if is_repeated else self._flags
        plain = _PLAIN.pack(VERSION, flags_now, self._guid, number, self._strength, self._deadline, self._lifespan)
        return plain if related is None else plain + _RELATED.pack(*related)


def read_envelope(octets: bytes) -> SampleEnvelope | None:
    """The envelope; None when it makes no sense."""
    if len(octets) not in (_PLAIN.size, _WITH_RELATED):
        return None
    version, number_of_flags, guid, number, strength, deadline, lifespan = _PLAIN.unpack_from(octets)
    if version != VERSION or not 0 <= deadline < LONGEST_S or not 0 <= lifespan < LONGEST_S:
        return None
    known = qos_of(number_of_flags, deadline)
    offered = Qos(
        reliable=known.reliable, transient_local=known.transient_local, exclusive=known.exclusive,
        deadline_s=known.deadline_s, strength=strength, lifespan_s=lifespan or None,
    )  # fmt: skip
    related = _RELATED.unpack_from(octets, _PLAIN.size) if len(octets) == _WITH_RELATED else None
    return SampleEnvelope(guid, number, offered, related, bool(number_of_flags & _REPEATED))
