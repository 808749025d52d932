"""The data space over DDS: endpoints meet in this process' memory as usual, and also in DDS.

Theory of operation. Every writer and reader exists in memory, with the same rules, speed and order as in a
`MemorySpace`, and once more in the library for each name that the topic has in DDS. Readers in the library do not hear
writers of the same participant, so nothing arrives twice. A sample goes out only while another program reads it (or if
it is kept for late readers); a sample that comes in is handed to the reader in memory. So the robot keeps working when
the network fails. One thread waits (`waiter`), everything else happens on the event loop. Services have a participant
of their own (`dds_services`).
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from types import TracebackType
from typing import Any, Self

from msbot_agent.space import service_names
from msbot_agent.space.contract import THIS_PROGRAM, Deliver, Guid, OwnEndpoint, Owner, Qos, Reader, Topic, Writer
from msbot_agent.space.dds import dds_network, dds_services, libddsc
from msbot_agent.space.dds.dds_domain import Domain
from msbot_agent.space.dds.dds_reader import REQUESTED_STATUSES, DdsReader, LibraryReader
from msbot_agent.space.dds.dds_writer import OFFERED_STATUSES, DdsWriter, LibraryWriter
from msbot_agent.space.dds.libddsc import ANY_STATE
from msbot_agent.space.dds.native_qos import reader_qos, writer_qos
from msbot_agent.space.dds.raw_type import Serialiser
from msbot_agent.space.dds.remote_endpoints import RemoteEndpoint, RemoteEndpoints, obstacle
from msbot_agent.space.dds.ros_type_hashes import user_data_of
from msbot_agent.space.dds.waiter import Waiter
from msbot_agent.space.dds_topics import DdsTopic, DdsTopicsOf, as_it_is
from msbot_agent.space.memory import MemorySpace, MemoryWriter
from msbot_agent.space.readers import MemoryReader
from msbot_agent.space.rtps.rtps_driver import RtpsDriver
from msbot_xrce.errors import ConfigError

RETRY_S = 0.005
"""How soon a write is retried for which a slow peer had no room."""

SERVICE_DEPTH = 64
"""Requests or replies of one writer that wait for peers at most."""

logger = logging.getLogger(__name__)


class DdsSpace:
    """Satisfies `Space`. Must be made on a running event loop, and closed; can be used with `with`."""

    def __init__(
        self,
        domain: int = 0,
        *,
        partition: str = "",
        dds_topics_of: DdsTopicsOf = as_it_is,
        interface: str | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Join DDS.

        Args:
            domain: the DDS domain for endpoints of domain 0, which is the default of clients.
            partition: the partition of endpoints that name none themselves.
            dds_topics_of: the names of a topic in DDS; verbatim if absent.
            interface: the network interface to use; if absent, the network there is.
            clock: seconds, for lifespans, deadlines and time-based filters.

        Raises:
            ConfigError: libddsc is missing or unusable, or the domain cannot be joined; the text says what to do.
        """
        self._domain = domain
        self._partitions = (partition,) if partition else ()
        self._dds_topics_of = dds_topics_of
        self._memory = MemorySpace(clock=clock)
        self._library = libddsc.load()
        self._network = dds_network.choose(interface)
        in_partition = f", partition {partition}" if partition else ""
        self.words: str | None = f"DDS domain {domain}{in_partition} ({self._network.words})"
        self._loop = asyncio.get_running_loop()
        self._serialiser = Serialiser(self._library)
        self._domains: dict[int, Domain] = {domain: Domain(self._library, self._network, domain)}
        self._waiter = Waiter(self._library)
        self._neighbours: dict[int, RemoteEndpoints] = {}
        self._outlets: dict[LibraryWriter, DdsWriter] = {}
        self._inlets: dict[LibraryReader, DdsReader] = {}
        self._by_name: dict[tuple[int, str], dict[LibraryWriter | LibraryReader, None]] = {}
        self._rtps: dict[int, RtpsDriver] = {}
        self._requesters: dict[int, dds_services.Requesters] = {}
        self._service_ends: dict[dds_services.ServiceEnd, None] = {}
        self._late: dict[LibraryWriter, None] = {}
        self._retry: asyncio.TimerHandle | None = None
        self._told: set[str] = set()
        self._endpoint_listeners: list[Callable[[], object]] = []
        self._neighbours_in(self._domains[domain])

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        self.close()

    @property
    def neighbours(self) -> int:
        """Number of writers and readers of other programs known now."""
        return sum(len(neighbours) for neighbours in self._neighbours.values())

    def participants(self) -> Mapping[int, Guid]:
        """See `SharedSpace.participants`."""
        return {number: domain.guid for number, domain in self._domains.items()}

    def endpoints(self) -> Iterator[OwnEndpoint]:
        """See `SharedSpace.endpoints`."""
        for crossing in (*self._outlets, *self._inlets):
            yield crossing.as_endpoint()
        for end in self._service_ends:
            yield end.as_endpoint()

    def on_endpoints(self, listener: Callable[[], object]) -> None:
        """See `SharedSpace.on_endpoints`."""
        self._endpoint_listeners.append(listener)

    def writer(self, topic: Topic, qos: Qos, guid: Guid, owner: Owner = THIS_PROGRAM) -> Writer:
        """Make a writer and match it with every compatible reader, here and elsewhere."""
        topic = self._place(topic)
        memory = self._memory.writer(topic, qos, guid)
        if qos.service:
            return self._service_writer(topic, qos, memory, owner)
        outlets, notes = [], []
        for dds_topic in self._dds_topics_of(topic):
            try:
                outlets.append((self._open_outlet(topic, dds_topic, qos), dds_topic.outward))
            except ConfigError as error:
                notes.append(self._tell(str(error)))
        writer = DdsWriter(memory, tuple(outlets), tuple(notes), self._close_writer)
        for outlet in writer.outlets:
            outlet.owner = owner
            self._outlets[outlet] = writer
            self._by_name.setdefault((outlet.domain, outlet.name), {})[outlet] = None
            outlet.token = self._waiter.attach(outlet.entity, outlet.update_matches)
        self._endpoints_changed()
        return writer

    def reader(self, topic: Topic, qos: Qos, deliver: Deliver, owner: Owner = THIS_PROGRAM) -> Reader:
        """Make a reader; kept samples of writers here are delivered at once, those of writers elsewhere soon."""
        topic = self._place(topic)
        memory = self._memory.reader(topic, qos, deliver)
        if qos.service:
            return self._service_reader(topic, qos, memory, owner)
        inlets, notes = [], []
        for dds_topic in self._dds_topics_of(topic):
            try:
                inlets.append(self._open_inlet(topic, dds_topic, qos, memory))
            except ConfigError as error:
                notes.append(self._tell(str(error)))
        reader = DdsReader(memory, tuple(inlets), tuple(notes), self._waiter, self._close_reader)
        for inlet in inlets:
            inlet.owner = owner
            self._inlets[inlet] = reader
            self._by_name.setdefault((inlet.domain, inlet.name), {})[inlet] = None
            statuses = self._waiter.attach(inlet.entity, inlet.update_matches)
            inlet.tokens = (self._waiter.attach(inlet.condition, partial(reader.arrived, inlet)), statuses)
        self._endpoints_changed()
        return reader

    def close(self) -> None:
        """Leave DDS; peers are told at once. Closing twice does nothing."""
        if not self._domains:
            return
        if self._retry is not None:
            self._retry.cancel()
        self._waiter.close()
        for outlet in self._outlets:
            outlet.end()
        for driver in self._rtps.values():
            driver.close()
        for domain in self._domains.values():
            domain.close()
        self._domains.clear()

    # Endpoints.

    def _place(self, topic: Topic) -> Topic:
        return replace(topic, domain=self._domain) if topic.domain == 0 and self._domain else topic

    def _domain_of(self, topic: Topic) -> Domain:
        if not self._domains:
            raise ConfigError(f"topic {topic.name}: the program has left DDS")
        return self._domains.get(topic.domain) or self._join(topic.domain)

    def _join(self, number: int) -> Domain:
        domain = self._domains[number] = Domain(self._library, self._network, number)
        self._neighbours_in(domain)
        return domain

    def _in_dds(self, qos: Qos, dds_topic: DdsTopic) -> Qos:
        """The same with the partitions that count in DDS: the client's, else the topic's, else the space's."""
        return replace(
            qos,
            partitions=qos.partitions or (self._partitions if dds_topic.partitions is None else dds_topic.partitions),
        )

    def _open_outlet(self, topic: Topic, dds_topic: DdsTopic, qos: Qos) -> LibraryWriter:
        domain, qos = self._domain_of(topic), self._in_dds(qos, dds_topic)
        native = domain.topic(dds_topic.name, dds_topic.type_name)
        calls = self._library.calls
        with writer_qos(
            self._library, qos, qos.partitions, user_data_of(dds_topic.type_name, dds_topic.type_hash)
        ) as made:
            entity = calls.dds_create_writer(domain.participant, native.entity, made, None)
        if entity < 0:
            domain.release(dds_topic.name, dds_topic.type_name)
            raise ConfigError(f"topic {dds_topic.name}: DDS makes no writer for it ({self._library.describe(entity)})")
        calls.dds_set_status_mask(entity, OFFERED_STATUSES)
        return LibraryWriter(
            self._library,
            self._serialiser,
            entity,
            native.sample_type,
            dds_topic.name,
            dds_topic.type_name,
            qos,
            self._neighbours[domain.number],
            self._try_again,
            domain.number,
        )

    def _open_inlet(self, topic: Topic, dds_topic: DdsTopic, qos: Qos, memory: MemoryReader) -> LibraryReader:
        domain, qos = self._domain_of(topic), self._in_dds(qos, dds_topic)
        native = domain.topic(dds_topic.name, dds_topic.type_name)
        calls = self._library.calls
        with reader_qos(
            self._library, qos, qos.partitions, user_data_of(dds_topic.type_name, dds_topic.type_hash)
        ) as made:
            entity = calls.dds_create_reader(domain.participant, native.entity, made, None)
        if entity < 0:
            domain.release(dds_topic.name, dds_topic.type_name)
            raise ConfigError(f"topic {dds_topic.name}: DDS makes no reader for it ({self._library.describe(entity)})")
        calls.dds_set_status_mask(entity, REQUESTED_STATUSES)
        condition = calls.dds_create_readcondition(entity, ANY_STATE)
        return LibraryReader(
            self._library,
            self._serialiser,
            entity,
            condition,
            dds_topic.name,
            dds_topic.type_name,
            qos,
            self._neighbours[domain.number],
            memory,
            dds_topic.inward,
            domain.number,
        )

    def _close_writer(self, writer: DdsWriter) -> None:
        for outlet in writer.outlets:
            outlet.close()
            self._late.pop(outlet, None)
            if self._outlets.pop(outlet, None) is not None and self._domains:
                self._forget_name(outlet)
                self._waiter.detach(outlet.entity, outlet.token)
                self._library.calls.dds_delete(outlet.entity)
                self._domains[outlet.domain].release(outlet.name, outlet.type_name)
        self._endpoints_changed()

    def _close_reader(self, reader: DdsReader) -> None:
        for inlet in reader.inlets:
            if self._inlets.pop(inlet, None) is not None and self._domains:
                self._forget_name(inlet)
                self._waiter.detach(inlet.condition, inlet.tokens[0])
                self._waiter.detach(inlet.entity, inlet.tokens[1])
                self._library.calls.dds_delete(inlet.entity)
                self._domains[inlet.domain].release(inlet.name, inlet.type_name)
        self._endpoints_changed()

    def _endpoints_changed(self) -> None:
        for listener in self._endpoint_listeners:
            listener()

    def _forget_name(self, endpoint: LibraryWriter | LibraryReader) -> None:
        namesakes = self._by_name[endpoint.domain, endpoint.name]
        del namesakes[endpoint]
        if not namesakes:
            del self._by_name[endpoint.domain, endpoint.name]

    # Services.

    def _service_writer(self, topic: Topic, qos: Qos, memory: MemoryWriter, owner: Owner) -> Writer:
        if not service_names.crosses(topic.name):
            return memory  # nobody in DDS could tell whom it is for
        ends: list[dds_services.RequestsOut | dds_services.RepliesOut] = []
        for dds_topic in self._dds_topics_of(topic):
            common = self._service_in(topic.domain, owner)
            told = self._told_of_service(dds_topic, qos)
            if service_names.is_request(topic.name):
                ends.append(dds_services.RequestsOut(*common, guid=memory.guid, **told))
            else:
                ends.append(dds_services.RepliesOut(*common, **told))
        self._service_opened(ends)
        return dds_services.ServiceWriter(memory, tuple(ends), self._close_service)

    def _service_reader(self, topic: Topic, qos: Qos, memory: MemoryReader, owner: Owner) -> Reader:
        if not service_names.crosses(topic.name):
            return memory
        make = dds_services.RequestReader if service_names.is_request(topic.name) else dds_services.ReplyReader
        ends = [
            make(*self._service_in(topic.domain, owner), reader=memory, **self._told_of_service(dds_topic, qos))
            for dds_topic in self._dds_topics_of(topic)
        ]
        self._service_opened(ends)
        return dds_services.ServiceReader(memory, tuple(ends), self._close_service)

    def _service_in(
        self, domain: int, owner: Owner
    ) -> tuple[RtpsDriver, RemoteEndpoints, dds_services.Requesters, Owner, int]:
        """What every end of a service needs; the domain's participant for them is made when the first one is."""
        joined = self._domains.get(domain) or self._join(domain)
        driver = self._rtps.get(domain)
        if driver is None:
            driver = self._rtps[domain] = RtpsDriver(
                domain,
                self._network.addresses,
                is_local=self._network.is_local,
                peers=self._network.peers,
                strangers=[joined.guid[:12]],
            )
            self._requesters[domain] = dds_services.Requesters()
            self._neighbours[domain].leave_out(driver.participant.prefix)
            driver.participant.changed = partial(self._services_changed, domain)
        return driver, self._neighbours[domain], self._requesters[domain], owner, domain

    def _told_of_service(self, dds_topic: DdsTopic, qos: Qos) -> dict[str, Any]:
        in_dds = self._in_dds(qos, dds_topic)
        reliable = replace(in_dds, reliable=True, transient_local=False, depth=max(qos.depth, SERVICE_DEPTH))
        return {
            "name": dds_topic.name,
            "type_name": dds_topic.type_name,
            "qos": reliable,
            "user_data": user_data_of(dds_topic.type_name, dds_topic.type_hash),
        }

    def _service_opened(self, ends: Iterable[dds_services.ServiceEnd]) -> None:
        self._service_ends.update(dict.fromkeys(ends))
        self._endpoints_changed()

    def _close_service(self, ends: tuple[dds_services.ServiceEnd, ...]) -> None:
        for end in ends:
            if end in self._service_ends:
                del self._service_ends[end]
                if self._domains:
                    end.close()
        self._endpoints_changed()

    def _services_changed(self, domain: int) -> None:
        for end in self._service_ends:
            if end.domain == domain:
                end.changed()

    # Slow peers.

    def _try_again(self, outlet: LibraryWriter) -> None:
        self._late[outlet] = None
        if self._retry is None:
            self._retry = self._loop.call_later(RETRY_S, self._flush)

    def _flush(self) -> None:
        self._retry = None
        for outlet in list(self._late):
            if outlet.flush():
                del self._late[outlet]
        if self._late:
            self._retry = self._loop.call_later(RETRY_S, self._flush)

    # Others.

    def _neighbours_in(self, domain: Domain) -> None:
        self._neighbours[domain.number] = RemoteEndpoints(
            self._library, domain, self._waiter, partial(self._appeared, domain.number)
        )

    def _appeared(self, domain: int, other: RemoteEndpoint) -> None:
        """Report once why a newcomer and an endpoint of ours do not match."""
        for mine in tuple(self._by_name.get((domain, other.topic), ())):
            if isinstance(mine, LibraryReader) is other.is_writer:
                reason = obstacle(mine.type_name, mine.qos, other, writes=not other.is_writer)
                if reason is not None:
                    self._tell(f"{mine.name}: {reason}")

    def _tell(self, words: str) -> str:
        if words not in self._told and len(self._told) < 256:
            self._told.add(words)
            logger.warning("%s", words)
        return words
