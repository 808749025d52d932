"""Converts quality of service to the library's form, and back from what it reports of others.

Samples in transit between two programs are not what DDS calls history: a reader that wants only the last sample still
gets every sample that it has time for. So both ends have room for `ON_THE_WAY` samples whatever their depth. How many
samples a late joiner gets is set by the durability service, whose default would be a single one.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from ctypes import POINTER, byref, c_char_p, c_int, c_int32, c_int64, c_uint32, c_void_p, cast

from msbot_agent.space.contract import Qos
from msbot_agent.space.dds.libddsc import FOR_EVER, DdsLibrary

ON_THE_WAY = 256
"""Samples of one writer or reader that may be on their way."""

_VOLATILE, _TRANSIENT_LOCAL = 0, 1
_BEST_EFFORT, _RELIABLE = 0, 1
_KEEP_LAST, _KEEP_ALL = 0, 1
_EXCLUSIVE = 1
_IGNORE_OWN_PARTICIPANT = 1
_UNLIMITED = -1
_BLOCKING_OF_OTHERS = 100_000_000

POLICIES = {
    3: "PRESENTATION", 2: "DURABILITY", 4: "DEADLINE", 5: "LATENCY_BUDGET", 6: "OWNERSHIP", 8: "LIVELINESS",
    11: "RELIABILITY", 12: "DESTINATION_ORDER", 10: "PARTITION", 24: "TYPE_CONSISTENCY", 25: "DATA_REPRESENTATION",
}  # fmt: skip
"""Names of policies by the library's numbers."""

COMPARED = frozenset(["RELIABILITY", "DURABILITY", "OWNERSHIP", "DEADLINE", "PARTITION"])
"""Policies that `msbot_agent.space.qos_matching` compares itself, with both values."""


@contextlib.contextmanager
def writer_qos(library: DdsLibrary, qos: Qos, partitions: tuple[str, ...], user_data: bytes = b"") -> Iterator[int]:
    """A writer's QoS; valid inside the `with`."""
    calls = library.calls
    with _common(library, qos, partitions, user_data) as made:
        # A write never waits: the caller keeps a sample for which there is no room.
        calls.dds_qset_reliability(made, _RELIABLE if qos.reliable else _BEST_EFFORT, 0)
        if qos.transient_local:
            late = max(1, qos.late_depth or qos.depth)
            calls.dds_qset_durability_service(made, 0, _KEEP_LAST, late, _UNLIMITED, _UNLIMITED, _UNLIMITED)
        if qos.lifespan_s is not None:
            calls.dds_qset_lifespan(made, _nanoseconds(qos.lifespan_s))
        calls.dds_qset_ownership_strength(made, qos.strength)
        yield made


@contextlib.contextmanager
def reader_qos(library: DdsLibrary, qos: Qos, partitions: tuple[str, ...], user_data: bytes = b"") -> Iterator[int]:
    """A reader's QoS. It ignores the writers of its own participant: it meets those in memory."""
    calls = library.calls
    with _common(library, qos, partitions, user_data) as made:
        calls.dds_qset_reliability(made, _RELIABLE if qos.reliable else _BEST_EFFORT, _BLOCKING_OF_OTHERS)
        calls.dds_qset_ignorelocal(made, _IGNORE_OWN_PARTICIPANT)
        yield made


@contextlib.contextmanager
def private_qos(library: DdsLibrary, user_data: bytes) -> Iterator[int]:
    """The QoS of an end for this process' own use, which is read by others that it does not concern."""
    made: int = library.calls.dds_create_qos()
    try:
        library.calls.dds_qset_userdata(made, user_data, len(user_data))
        yield made
    finally:
        library.calls.dds_delete_qos(made)


@contextlib.contextmanager
def _common(library: DdsLibrary, qos: Qos, partitions: tuple[str, ...], user_data: bytes) -> Iterator[int]:
    calls = library.calls
    made: int = calls.dds_create_qos()
    try:
        calls.dds_qset_durability(made, _TRANSIENT_LOCAL if qos.transient_local else _VOLATILE)
        room = max(qos.depth, ON_THE_WAY)
        if qos.keep_all:
            calls.dds_qset_history(made, _KEEP_ALL, 0)
            calls.dds_qset_resource_limits(made, room, _UNLIMITED, _UNLIMITED)
        else:
            calls.dds_qset_history(made, _KEEP_LAST, room)
        if qos.deadline_s is not None:
            calls.dds_qset_deadline(made, _nanoseconds(qos.deadline_s))
        if qos.exclusive:
            calls.dds_qset_ownership(made, _EXCLUSIVE)
        if user_data:
            calls.dds_qset_userdata(made, user_data, len(user_data))
        if partitions:
            names = (c_char_p * len(partitions))(*(name.encode() for name in partitions))
            calls.dds_qset_partition(made, len(partitions), names)
        yield made
    finally:
        calls.dds_delete_qos(made)


def qos_of(library: DdsLibrary, native: int) -> Qos:
    """What a discovered writer offers or a reader requests, as far as we compare it."""
    calls = library.calls
    kind, strength, duration = c_int(), c_int32(), c_int64()
    reliable = bool(calls.dds_qget_reliability(native, byref(kind), byref(duration))) and kind.value == _RELIABLE
    durable = bool(calls.dds_qget_durability(native, byref(kind))) and kind.value >= _TRANSIENT_LOCAL
    exclusive = bool(calls.dds_qget_ownership(native, byref(kind))) and kind.value == _EXCLUSIVE
    calls.dds_qget_ownership_strength(native, byref(strength))
    known = bool(calls.dds_qget_deadline(native, byref(duration)))
    endless = not known or duration.value in (0, FOR_EVER)
    return Qos(
        reliable=reliable,
        transient_local=durable,
        exclusive=exclusive,
        strength=strength.value,
        deadline_s=None if endless else duration.value / 1e9,
        partitions=_partitions(library, native),
    )


def _partitions(library: DdsLibrary, native: int) -> tuple[str, ...]:
    calls = library.calls
    count, names = c_uint32(), POINTER(c_void_p)()
    if not calls.dds_qget_partition(native, byref(count), byref(names)) or not names:
        return ()
    found = []
    for index in range(count.value):
        found.append((cast(names[index], c_char_p).value or b"").decode("utf-8", "replace"))
        calls.dds_free(names[index])
    calls.dds_free(names)
    return tuple(found)


def _nanoseconds(seconds: float) -> int:
    return max(1, min(int(seconds * 1e9), FOR_EVER - 1))
