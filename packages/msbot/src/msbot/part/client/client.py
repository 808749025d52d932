"""An asyncio DDS-XRCE client for any agent: connects, stays connected, and keeps its objects alive.

`connection` keeps the session open. The client adds objects and data: whatever was created is created again in every
new session, parents first and as many as fit in one message, and what was being read is read again.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from random import Random

from msbot.part.client.client_settings import ClientCounters, ClientSettings, ConnectionState, PingAnswer
from msbot.part.client.connection import Connection, Stall
from msbot.part.client.entities import Entity, EntityTable, RunningRead
from msbot_agent.link import Link, SignalHandler
from msbot_xrce.errors import LinkFull, LocalProtocolError, RequestError
from msbot_xrce.lazy import dataclass
from msbot_xrce.messages import STREAM_RELIABLE, DeliveryControl, ObjectKind, ObjectVariant, status_words
from msbot_xrce.objects import (
    RELIABLE_QOS,
    EndpointQos,
    participant_variant,
    publisher_variant,
    reader_variant,
    replier_variant,
    requester_variant,
    subscriber_variant,
    topic_variant,
    writer_variant,
)
from msbot_xrce.sessions import ClientEvent, DataReceived, StatusReceived, TimeSynchronised, WindowOpened

ENDLESS = DeliveryControl(0xFFFF, 0, 0, 0)
"""Delivery control of a read that never ends."""

IDENTITY_OCTETS = 24
"""Precede each request to a replier, and its reply: who asked (SampleIdentity, seen on the wire)."""
RELATED_OCTETS = 4
"""Precede each reply to a requester: request id and object id of the request (seen on the wire)."""


@dataclass(frozen=True, slots=True)
class ServiceNames:
    """The names of a service: requesters and repliers with the same ones find each other."""

    name: str
    request_type: str
    reply_type: str
    request_topic: str = ""
    """"" = `<name>_Request`."""
    reply_topic: str = ""
    """"" = `<name>_Reply`."""

    def variant(self, make: ServiceVariant, participant: Entity) -> ObjectVariant:
        """Describe one side of the service."""
        topics = (self.request_topic or f"{self.name}_Request", self.reply_topic or f"{self.name}_Reply")
        return make(self.name, self.request_type, self.reply_type, *topics, participant.object_id)


ServiceVariant = Callable[[str, str, str, str, str, int], ObjectVariant]


def _unheard(*_: object) -> None:
    """Ignore the news: no callback was given."""


class Client:
    """One client of one agent over one link (see the module's docstring)."""

    def __init__(
        self,
        link: Link,
        *,
        key: int,
        settings: ClientSettings | None = None,
        epoch_ns: Callable[[], int] = time.time_ns,
        random: Random | None = None,
        on_state: Callable[[ConnectionState, str], None] = _unheard,
        on_signal: SignalHandler = _unheard,
        on_topic: Callable[[int, int, bytes], None] = _unheard,
        on_request: Callable[[int, int, bytes, bytes], None] = _unheard,
        on_reply: Callable[[int, int, bytes], None] = _unheard,
        on_status: Callable[[int, int, int], None] = _unheard,
        on_room: Callable[[], None] = _unheard,
    ) -> None:
        """Make a client; it connects when `run` is awaited.

        The callbacks run in the loop's thread, must not block and must not raise.

        Args:
            link: a link with one remote peer; the client takes over its handlers.
            key: client key, unique at the agent, 1 to 0xFFFFFFFF.
            settings: periods and limits; by default those that suit the link.
            epoch_ns: wall clock for time synchronisation, in ns since 1970.
            random: spreads out the retries of refused clients.
            on_state: (state, reason in words) at every change.
            on_signal: the link's signals, after the client took them in.
            on_topic: (object id of the reader, request id of the read, payload).
            on_request: (object id of the replier, request id of the read, identity for `reply`, payload).
            on_reply: (object id of the requester, request id that `write` returned, payload).
            on_status: (request id, object id, status octet) of every answer.
            on_room: there is room again after a LinkFull.

        Raises:
            LocalProtocolError: the key is out of range.
        """
        if not 0 < key <= 0xFFFFFFFF:
            raise LocalProtocolError(f"client key {key} is out of range: choose 1 to 0xFFFFFFFF")
        self.settings = settings or ClientSettings.for_link(link.info)
        self._on_topic = on_topic
        self._on_request = on_request
        self._on_reply = on_reply
        self._on_status = on_status
        self._on_room = on_room
        self._entities = EntityTable(answer_s=self.settings.answer_s)
        self._stall = Stall(self.settings.stall_s)
        self._connection = Connection(
            link,
            key=key,
            settings=self.settings,
            epoch_ns=epoch_ns,
            random=random or Random(key),
            on_state=on_state,
            on_signal=on_signal,
            on_event=self._event_received,
            on_session_over=self._session_over,
            before_sending=self._before_sending,
        )

    # The session

    @property
    def key(self) -> int:
        """The client key."""
        return self._connection.key

    @property
    def state(self) -> ConnectionState:
        """The state between the client and its agent."""
        return self._connection.state

    @property
    def reason(self) -> str:
        """Why it is in that state, in words."""
        return self._connection.reason

    @property
    def counters(self) -> ClientCounters:
        """Counts of what happened since the client was made."""
        return self._connection.counters

    async def run(self) -> None:
        """Serve link and session until `close` or cancellation (which does not tell the agent).

        Raises:
            LinkDown: the link broke before it ever carried anything; later failures are retried.
        """
        await self._connection.run()

    async def connect(self, timeout_s: float | None = None) -> None:
        """Wait until a session is open (`run` opens it, and does so again after every loss).

        Raises:
            RequestError: not within `timeout_s` seconds.
        """
        await self._connection.connect(timeout_s)

    async def close(self) -> None:
        """Delete the session at the agent and end `run`; waits until both are done, at most `settings.close_s`."""
        await self._connection.close()

    def close_soon(self, *, deliver_s: float = 0.0) -> None:
        """Start closing; `close` waits until it is done.

        Args:
            deliver_s: how long the goodbye may wait until the agent has acknowledged everything. It overtakes what has
                to be sent again, and what comes after it counts for nothing.
        """
        self._connection.close_soon(deliver_s=deliver_s)

    @property
    def was_heard(self) -> bool:
        """Whether the agent had acknowledged everything when the session was deleted."""
        return self._connection.was_heard

    async def ping(self, timeout_s: float = 1.0) -> PingAnswer:
        """Ask the agent whether it is there and knows us.

        Raises:
            RequestError: no answer within `timeout_s` seconds.
        """
        return await self._connection.ping(timeout_s)

    async def sync_time(self, timeout_s: float = 1.0) -> TimeSynchronised:
        """Compare clocks with the agent: agent time = local time - offset.

        Raises:
            RequestError: no answer within `timeout_s` seconds.
        """
        return await self._connection.sync_time(timeout_s)

    def check_agent(self) -> None:
        """Check now whether the agent is gone or has forgotten us, and log in again if so."""
        self._connection.check_agent()

    def reconnect(self, reason: str) -> None:
        """Give up the session, for a reason in words, and open another one; does nothing without a session."""
        if self._connection.is_open:
            self._connection.lose(reason, self._connection.now())

    # Objects

    def create(self, variant: ObjectVariant, *, number: int | None = None) -> Entity:
        """Have an object exist at the agent, now and in every later session; its status comes later.

        Everything created in one turn of the loop travels together.

        Args:
            variant: the object's description, as REF, XML or BIN; the `create_...` calls below make BIN ones.
            number: object number, 0 to 0xFFE; None = the next free one of its kind.
        """
        entity = self._entities.add(variant, number)
        self._connection.schedule_send()
        return entity

    def create_participant(self, name: str = "", *, domain: int = 0) -> Entity:
        """Create a participant, the parent of everything else."""
        return self.create(participant_variant(name, domain))

    def create_topic(self, participant: Entity, name: str, type_name: str) -> Entity:
        """Create a topic."""
        return self.create(topic_variant(name, type_name, participant.object_id))

    def create_publisher(self, participant: Entity) -> Entity:
        """Create a publisher, the parent of data writers."""
        return self.create(publisher_variant(participant.object_id))

    def create_subscriber(self, participant: Entity) -> Entity:
        """Create a subscriber, the parent of data readers."""
        return self.create(subscriber_variant(participant.object_id))

    def create_writer(self, publisher: Entity, topic: Entity, qos: EndpointQos = RELIABLE_QOS) -> Entity:
        """Create a data writer."""
        return self.create(writer_variant(topic.object_id, publisher.object_id, qos))

    def create_reader(self, subscriber: Entity, topic: Entity, qos: EndpointQos = RELIABLE_QOS) -> Entity:
        """Create a data reader; `read` starts the samples."""
        return self.create(reader_variant(topic.object_id, subscriber.object_id, qos))

    def create_requester(self, participant: Entity, service: ServiceNames) -> Entity:
        """Create a requester; `read` starts the replies."""
        return self.create(service.variant(requester_variant, participant))

    def create_replier(self, participant: Entity, service: ServiceNames) -> Entity:
        """Create a replier; `read` starts the requests."""
        return self.create(service.variant(replier_variant, participant))

    def delete(self, entity: Entity) -> None:
        """Delete an object, now and in every later session."""
        known = self._entities.remove(entity)
        if known and self._connection.is_open and entity.request_id:
            self._connection.session.delete(entity.object_id, STREAM_RELIABLE)
            self._connection.schedule_send()

    def read(
        self, entity: Entity, *, stream_id: int = STREAM_RELIABLE, control: DeliveryControl | None = ENDLESS
    ) -> None:
        """Start the samples of a data reader, requester or replier, now and in every later session.

        A later read of the same object replaces the running one.

        Args:
            entity: the object to read from.
            stream_id: stream on which they should come.
            control: how many samples, for how long and how fast; None = exactly one sample.
        """
        self._entities.want_read(entity, RunningRead(stream_id, control))
        self._connection.schedule_send()

    @property
    def entities(self) -> list[Entity]:
        """All objects, in the order of their creation."""
        return list(self._entities)

    async def until_all_statuses(self, timeout_s: float = 1.0) -> None:
        """Wait until every object has its status and all are OK or OK_MATCHED (thesis 4.2.5.1).

        Raises:
            RequestError: one was refused (with its status), or not all were answered within `timeout_s` seconds.
        """
        words = "not every creation was answered"
        await self._connection.news.until(lambda: self._entities.all_answered, timeout_s, words)
        for entity in self._entities:
            if entity.refused and entity.status is not None:
                words = f"the agent did not create {entity.describe}: {status_words(entity.status)}"
                raise RequestError(words, entity.status)

    # Data

    def has_room(self, stream_id: int = STREAM_RELIABLE) -> bool:
        """Whether `write` on that stream would be accepted now; also False while there is no session."""
        return self._connection.is_open and self._connection.session.has_room(stream_id)

    def write(self, entity: Entity, payload: bytes, *, stream_id: int = STREAM_RELIABLE) -> int:
        """Send one sample to a data writer, or a request to a requester; returns the request id.

        Raises:
            LinkFull: the reliable stream is waiting for acknowledgements: try again after `on_room`. Best effort never
                waits: when the link cannot keep up, its oldest samples are dropped (and counted).
            LocalProtocolError: there is no session.
        """
        if not self._connection.is_open:
            raise LocalProtocolError(f"no session with an agent ({self.reason}): wait for the state `connected`")
        if not entity.request_id:
            # Created in this turn: the creation must go out before the samples that use it.
            self._before_sending(self._connection.now())
            if not entity.request_id:
                raise LinkFull(f"{entity.describe} is not created yet: try again after `on_room`")
        request_id = self._connection.session.write(entity.object_id, payload, stream_id)
        self.counters.samples_out += 1
        self._connection.schedule_send()
        return request_id

    def reply(self, entity: Entity, identity: bytes, payload: bytes, *, stream_id: int = STREAM_RELIABLE) -> int:
        """Answer, through a replier, the request that came with that identity; raises the same errors as `write`."""
        return self.write(entity, identity + payload, stream_id=stream_id)

    def _session_over(self) -> None:
        self._entities.restart()
        self._stall.progress()

    def _event_received(self, event: ClientEvent, now: float) -> None:  # noqa: ARG002 - the callback's signature
        match event:
            case DataReceived():
                self._sample_received(event)
            case StatusReceived():
                self._stall.progress()
                self._entities.answered(event.request_id, event.status)
                self._on_status(event.request_id, event.object_id, event.status)
            case WindowOpened():
                self._stall.progress()
                self._on_room()

    def _sample_received(self, event: DataReceived) -> None:
        entity = self._entities.get(event.object_id)
        kind = entity.variant.kind if entity is not None else None
        payload = event.payload
        if kind == ObjectKind.DATAREADER:
            self._on_topic(event.object_id, event.request_id, payload)
        elif kind == ObjectKind.REQUESTER and len(payload) >= RELATED_OCTETS:
            self._on_reply(event.object_id, int.from_bytes(payload[:2], "big"), payload[RELATED_OCTETS:])
        elif kind == ObjectKind.REPLIER and len(payload) >= IDENTITY_OCTETS:
            self._on_request(event.object_id, event.request_id, payload[:IDENTITY_OCTETS], payload[IDENTITY_OCTETS:])
        else:
            self.counters.dropped += 1
            return
        self.counters.samples_in += 1

    def _before_sending(self, now: float) -> float | None:
        session, entities = self._connection.session, self._entities
        has_room = session.has_room(STREAM_RELIABLE)
        while has_room and (entity := entities.next_to_ask(now)) is not None:
            entities.asked(entity, session.create(entity.object_id, entity.variant), now)
            has_room = session.has_room(STREAM_RELIABLE)
        while has_room and (wanted := entities.next_to_read()) is not None:
            entity, reading = wanted
            reading.request_id = session.read(entity.object_id, reading.stream_id, reading.control)
            has_room = session.has_room(STREAM_RELIABLE)
        if has_room and entities.timer() is None:
            self._stall.progress()
            return None
        stalled_at = self._stall.waits(now)
        if now >= stalled_at:
            self._connection.lose("the agent is there but takes nothing: streams out of step", now)
            return None
        # Without room nothing more can be asked for: WindowOpened comes first.
        asked_again_at = entities.timer() if has_room else None
        return stalled_at if asked_again_at is None else min(stalled_at, asked_again_at)


ClientMaker = Callable[..., Client]
"""Called with the callbacks, makes a client that has them: `partial(Client, link, key=1)`."""
