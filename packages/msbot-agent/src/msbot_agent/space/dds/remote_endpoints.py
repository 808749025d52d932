"""The writers and readers of other programs, as discovery reports them."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from ctypes import c_void_p
from functools import partial

from msbot_agent.space.contract import Guid, Qos
from msbot_agent.space.dds.dds_domain import Domain
from msbot_agent.space.dds.libddsc import (
    ALIVE,
    ANY_STATE,
    PUBLICATIONS,
    SUBSCRIPTIONS,
    BuiltinEndpoint,
    DdsLibrary,
    SampleInfo,
)
from msbot_agent.space.dds.native_qos import qos_of
from msbot_agent.space.dds.waiter import Waiter
from msbot_agent.space.dds_topics import ROBOTS
from msbot_agent.space.qos_matching import mismatch, partitions_meet
from msbot_xrce.lazy import dataclass

MAX_NEIGHBOURS = 8192
"""Endpoints of others that are remembered; mismatches with any further ones are not explained."""

_BATCH = 32


@dataclass(frozen=True, slots=True)
class RemoteEndpoint:
    """A writer or reader of another program."""

    topic: str
    type_name: str
    qos: Qos
    is_writer: bool


class RemoteEndpoints:
    """What other programs write and read in one domain."""

    def __init__(
        self, library: DdsLibrary, domain: Domain, waiter: Waiter, changed: Callable[[RemoteEndpoint], None]
    ) -> None:
        """Begin to listen.

        Args:
            library: the library.
            domain: the domain to listen in.
            waiter: calls back when something was discovered.
            changed: called with every endpoint that appears.
        """
        self._library = library
        self._own = {domain.guid[:12]}
        self._waiter = waiter
        self._changed = changed
        self._by_topic: dict[str, dict[Guid, RemoteEndpoint]] = {}
        self._topic_of: dict[Guid, str] = {}
        self._readers: list[tuple[int, int, int]] = []
        self._samples = (c_void_p * _BATCH)()
        self._infos = (SampleInfo * _BATCH)()
        for topic, is_writer in ((PUBLICATIONS, True), (SUBSCRIPTIONS, False)):
            reader: int = library.calls.dds_create_reader(domain.participant, topic, None, None)
            condition: int = library.calls.dds_create_readcondition(reader, ANY_STATE)
            token = waiter.attach(condition, partial(self._look, reader, is_writer))
            self._readers.append((reader, condition, token))

    def __len__(self) -> int:
        return len(self._topic_of)

    def on_topic(self, name: str) -> Iterator[RemoteEndpoint]:
        """The endpoints on a topic."""
        return iter(self._by_topic.get(name, {}).values())

    def leave_out(self, participant: bytes) -> None:
        """That participant is this program's, too."""
        self._own.add(participant)

    def close(self) -> None:
        """Stop listening."""
        for reader, condition, token in self._readers:
            self._waiter.detach(condition, token)
            self._library.calls.dds_delete(reader)

    def _look(self, reader: int, is_writer: bool) -> None:
        calls = self._library.calls
        self._samples[0] = None  # the library lends its own memory
        count = calls.dds_take(reader, self._samples, self._infos, _BATCH, _BATCH)
        if count <= 0:
            return
        for index in range(count):
            found = BuiltinEndpoint.from_address(self._samples[index] or 0)
            guid = bytes(found.guid)
            info = self._infos[index]
            if not info.valid_data or info.instance_state != ALIVE:
                self._forget(guid)
            elif guid[:12] not in self._own:
                self._remember(guid, found, is_writer)
        calls.dds_return_loan(reader, self._samples, count)

    def _remember(self, guid: Guid, found: ctypes.Structure, is_writer: bool) -> None:
        self._forget(guid)
        if len(self._topic_of) >= MAX_NEIGHBOURS:
            return
        topic = (found.topic or b"").decode("utf-8", "replace")
        if topic.startswith("DCPS"):
            return  # another space in this process, listening like this one
        type_name = (found.type_name or b"").decode("utf-8", "replace")
        neighbour = RemoteEndpoint(topic, type_name, qos_of(self._library, found.qos), is_writer)
        self._topic_of[guid] = topic
        self._by_topic.setdefault(topic, {})[guid] = neighbour
        self._changed(neighbour)

    def _forget(self, guid: Guid) -> None:
        topic = self._topic_of.pop(guid, None)
        if topic is not None:
            peers = self._by_topic[topic]
            del peers[guid]
            if not peers:
                del self._by_topic[topic]


def obstacle(type_name: str, qos: Qos, other: RemoteEndpoint, *, writes: bool) -> str | None:
    """Why an endpoint of ours cannot match one of another program on the same topic; None when it can.

    Args:
        type_name: type name of our endpoint.
        qos: its quality of service, with the partitions it has in DDS.
        other: the other program's endpoint.
        writes: whether ours is the writer.
    """
    if other.is_writer is writes:
        return None
    if not partitions_meet(qos.partitions, other.qos.partitions):
        theirs = other.qos.partitions
        if theirs and all(name.startswith(ROBOTS) for name in theirs):
            return None  # another robot
    elif other.type_name != type_name:
        verb = "read" if writes else "written"
        return f"TYPE: it is {verb} as {other.type_name} by a DDS peer, here it is {type_name}"
    reason = mismatch(qos, other.qos) if writes else mismatch(other.qos, qos)
    return None if reason is None else f"{reason} (a DDS peer)"
