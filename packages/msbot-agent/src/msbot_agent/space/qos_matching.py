"""Whether a writer's offer and a reader's request match, and if not, because of which policy (DDS 1.4 §2.2.3, table of
RxO)."""

from __future__ import annotations

from fnmatch import fnmatchcase

from msbot_agent.space.contract import Qos

_WILDCARDS = frozenset("*?[")


def mismatch(offered: Qos, requested: Qos) -> str | None:
    """Why a reader cannot accept what a writer offers: the policy's name and both values; None when they match."""
    if requested.reliable and not offered.reliable:
        return "RELIABILITY: the reader asks for RELIABLE, the writer offers BEST_EFFORT"
    if requested.transient_local and not offered.transient_local:
        return "DURABILITY: the reader asks for TRANSIENT_LOCAL, the writer offers VOLATILE"
    if requested.exclusive is not offered.exclusive:
        return f"OWNERSHIP: the reader asks for {_ownership(requested)}, the writer offers {_ownership(offered)}"
    if requested.deadline_s is not None and (offered.deadline_s is None or offered.deadline_s > requested.deadline_s):
        offer = "none" if offered.deadline_s is None else f"{offered.deadline_s:g} s"
        return f"DEADLINE: the reader asks for {requested.deadline_s:g} s, the writer offers {offer}"
    if not partitions_meet(offered.partitions, requested.partitions):
        return f"PARTITION: the reader is in {_partitions(requested)}, the writer in {_partitions(offered)}"
    return None


def partitions_meet(one: tuple[str, ...], other: tuple[str, ...]) -> bool:
    """Whether two lists of partitions have one in common; a pattern meets names, not patterns."""
    if one == other and not any(_WILDCARDS & set(name) for name in one):
        return True
    return any(_meet(name, another) for name in one or ("",) for another in other or ("",))


def _meet(one: str, other: str) -> bool:
    pattern_here, pattern_there = bool(_WILDCARDS & set(one)), bool(_WILDCARDS & set(other))
    if pattern_here and pattern_there:
        return False
    return fnmatchcase(other, one) if pattern_here else fnmatchcase(one, other) if pattern_there else one == other


def _ownership(qos: Qos) -> str:
    return "EXCLUSIVE" if qos.exclusive else "SHARED"


def _partitions(qos: Qos) -> str:
    return ", ".join(repr(name) for name in qos.partitions or ("",))
