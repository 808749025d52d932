"""The data space over Zenoh: endpoints meet in this process' memory as usual, and also at a router's.

Theory of operation. Every writer and reader exists in memory, with the same rules, speed and order as in a
`MemorySpace`, and once more in Zenoh for each name that the topic has there. Endpoints in Zenoh do not hear those of
the same session, so nothing arrives twice. A sample goes out only while another program reads it, or if it is kept; one
that comes in is handed to the reader in memory. What reliable and transient-local readers were promised is kept by the
library's advanced publishers and subscribers, which number and repeat samples. Without a router the robot works on.
"""

from __future__ import annotations

import asyncio
import logging
import os
import time
from collections.abc import Callable, Sequence
from functools import partial
from hashlib import blake2b
from types import TracebackType
from typing import Self

from msbot_agent.space import service_names
from msbot_agent.space.contract import THIS_PROGRAM, Deliver, Guid, Owner, Qos, Reader, Topic, Writer
from msbot_agent.space.dds_topics import DdsTopic, DdsTopicsOf, as_it_is
from msbot_agent.space.memory import MemorySpace
from msbot_agent.space.network_options import TlsFiles
from msbot_agent.space.zenoh.key_expressions import has_wildcards
from msbot_agent.space.zenoh.router_connection import RouterConnection, check_files
from msbot_agent.space.zenoh.zenoh_endpoint import LibraryEndpoint
from msbot_agent.space.zenoh.zenoh_library import load
from msbot_agent.space.zenoh.zenoh_reader import LibraryReader, Peer, ZenohReader
from msbot_agent.space.zenoh.zenoh_writer import LibraryWriter, ZenohWriter

logger = logging.getLogger(__name__)


class ZenohSpace:
    """Satisfies `Space`. Must be made on a running event loop, and closed; can be used with `with`."""

    def __init__(
        self,
        routers: Sequence[str],
        *,
        tls: TlsFiles | None = None,
        partition: str = "",
        dds_topics_of: DdsTopicsOf = as_it_is,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Begin to connect to a router.

        Args:
            routers: endpoints, of which the first that answers is used.
            tls: certificates, for endpoints with TLS.
            partition: the partition of endpoints that name none themselves.
            dds_topics_of: the names of a topic; verbatim if absent.
            clock: seconds, for lifespans, deadlines and time-based filters.

        Raises:
            ConfigError: the library is missing, or a certificate cannot be used; the text says what to do.
        """
        self._library = load()
        if tls is not None:
            check_files(tls)
        self._partitions = (partition,)
        self._dds_topics_of = dds_topics_of
        self._clock = clock
        self._memory = MemorySpace(clock=clock)
        self._loop = asyncio.get_running_loop()
        self._own: dict[Guid, Guid] = {}
        self._own_of: dict[Guid, Guid] = {}
        self._listeners: list[Callable[[], object]] = []
        self._connection = RouterConnection(routers, tls, self._changed)
        in_partition = f", as {partition}" if partition else ""
        self.words: str | None = f"Zenoh by way of {self._connection.words}{in_partition}"

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        self.close()

    @property
    def is_up(self) -> bool:
        """Whether a router is connected now."""
        return self._connection.is_up

    def on_change(self, listener: Callable[[], object]) -> None:
        """Call the listener whenever `is_up` changes."""
        self._listeners.append(listener)

    def writer(self, topic: Topic, qos: Qos, guid: Guid, owner: Owner = THIS_PROGRAM) -> Writer:  # noqa: ARG002
        """Make a writer and match it with every compatible reader, here and elsewhere."""
        memory = self._memory.writer(topic, qos, guid)
        if qos.service and not service_names.crosses(topic.name):
            return memory
        outlets, notes = [], []
        is_request = qos.service and service_names.is_request(topic.name)
        known_as = self._known_as(guid)
        for dds_topic in self._dds_topics_of(topic):
            for partition in self._partitions_of(qos, dds_topic):
                if has_wildcards(partition):
                    notes.append(f"{topic.name}: PARTITION: a writer in {partition!r} is not heard over Zenoh")
                    continue
                outlets.append(
                    LibraryWriter(
                        self._loop,
                        partition,
                        topic.domain,
                        dds_topic.name,
                        dds_topic.type_name,
                        qos,
                        known_as,
                        outward=dds_topic.outward,
                        is_request=is_request,
                    )
                )
        if is_request:
            self._own[guid], self._own_of[known_as] = known_as, guid
        writer = ZenohWriter(memory, tuple(outlets), tuple(notes), self._own, self._close_writer)
        self._declare(outlets)
        return writer

    def reader(self, topic: Topic, qos: Qos, deliver: Deliver, owner: Owner = THIS_PROGRAM) -> Reader:  # noqa: ARG002
        """Make a reader; kept samples of writers here are delivered at once, those of writers elsewhere soon."""
        memory = self._memory.reader(topic, qos, deliver)
        if qos.service and not service_names.crosses(topic.name):
            return memory
        known_as = self._known_as(os.urandom(16))
        peers: dict[Guid, Peer] = {}
        inlets = [
            LibraryReader(
                self._loop,
                partition,
                topic.domain,
                dds_topic.name,
                dds_topic.type_name,
                qos,
                known_as,
                inward=dds_topic.inward,
                reader=memory,
                peers=peers,
                own_of=self._own_of,
                clock=self._clock,
            )
            for dds_topic in self._dds_topics_of(topic)
            for partition in self._partitions_of(qos, dds_topic)
        ]
        reader = ZenohReader(memory, tuple(inlets), (), self._close_reader)
        self._declare(inlets)
        return reader

    def close(self) -> None:
        """Leave; the router is told. Closing twice does nothing."""
        self._connection.close()

    def _partitions_of(self, qos: Qos, dds_topic: DdsTopic) -> tuple[str, ...]:
        """The partitions that count: the client's, else the topic's, else the space's."""
        return qos.partitions or dds_topic.partitions or self._partitions

    @staticmethod
    def _known_as(guid: Guid) -> Guid:
        """By which others know an endpoint: two agents, or one at two times, may have given the same identity."""
        return blake2b(guid, digest_size=16, key=os.urandom(16)).digest()

    def _declare(self, crossings: Sequence[LibraryEndpoint]) -> None:
        for crossing in crossings:
            self._connection.do(partial(crossing.declare, self._library))

    def _close_writer(self, writer: ZenohWriter) -> None:
        known_as = self._own.pop(writer.guid, None)
        if known_as is not None:
            del self._own_of[known_as]
        for outlet in writer.outlets:
            outlet.close()
            self._connection.do(outlet.undeclare)

    def _close_reader(self, reader: ZenohReader) -> None:
        for inlet in reader.inlets:
            inlet.close()
            self._connection.do(inlet.undeclare)

    def _changed(self) -> None:
        for listener in self._listeners:
            listener()
