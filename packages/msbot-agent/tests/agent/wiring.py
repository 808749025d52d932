"""A real `ClientSession` wired to an `Agent` through a link in memory, for tests in virtual time.

    async with serving(Agent(MemorySpace())) as link:
        client = WiredClient(link, key=1)
        await client.connect()
        writer = await client.add_writer("light")
        client.session.write(writer, b"1234", STREAM_RELIABLE)
        await client.settle()

Everything runs on the loop's clock, so inside `run_virtual` nothing waits.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

from msbot_agent.agent import Agent
from msbot_agent.link import BaseLink, LinkInfo, Peer, Signal
from msbot_xrce import ClientSession, ClientSessionSettings, ClientState, Status
from msbot_xrce.errors import LinkFull
from msbot_xrce.messages import STREAM_RELIABLE, DeliveryControl, ObjectKind, ObjectVariant, make_object_id
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
from msbot_xrce.sessions import ClientEvent, DataReceived, StatusReceived

PARTICIPANT = make_object_id(1, ObjectKind.PARTICIPANT)
PUBLISHER = make_object_id(1, ObjectKind.PUBLISHER)
SUBSCRIBER = make_object_id(1, ObjectKind.SUBSCRIBER)
UNLIMITED = DeliveryControl()


class FakeLink(BaseLink):
    """A link to peers that are plain functions; it can be told to be full and to break."""

    def __init__(
        self,
        name: str = "fake:",
        mtu: int = 65535,
        bits_per_second: int | None = None,
        *,
        in_bursts: bool = False,
        keeps_order: bool = True,
    ) -> None:
        super().__init__(LinkInfo(name, mtu, bits_per_second, keeps_order=keeps_order, in_bursts=in_bursts))
        self.sent: list[tuple[Peer, bytes]] = []
        """Everything the agent sent, oldest first."""
        self.room: int | None = None
        """Packets that may still be sent; None = any number."""
        self.unread_at = float("-inf")
        """See `BacklogLink`."""
        self.failure: Exception | None = None
        """What `run` raises at once."""
        self._peers: dict[Peer, Callable[[bytes], None]] = {}
        self._broken = asyncio.Event()

    # The link's protocol.

    def has_room(self, peer: Peer) -> bool:
        return self.room is None or self.room > 0

    def send(self, packet: bytes, peer: Peer) -> None:
        if self.room is not None:
            if self.room <= 0:
                raise LinkFull("the fake link is full")
            self.room -= 1
        self.sent.append((peer, packet))
        receive = self._peers.get(peer)
        if receive is not None:
            asyncio.get_running_loop().call_soon(receive, packet)

    def describe(self, peer: Peer) -> str:
        return f"peer {peer}"

    async def run(self) -> None:
        if self.failure is not None:
            raise self.failure
        self.signal(Signal.LINK_UP)
        await self._broken.wait()
        if self.failure is not None:
            raise self.failure

    # For tests.

    def plug(self, peer: Peer, receive: Callable[[bytes], None]) -> None:
        """Call `receive` with every packet for that peer."""
        self._peers[peer] = receive

    def inject(self, packet: bytes, peer: Peer = "client") -> None:
        """A packet arrives from that peer, now and in this call."""
        self._packet_handler(packet, peer, asyncio.get_running_loop().time())

    def end_burst(self) -> None:
        """The packets that are there have all been injected."""
        self._burst_end_handler()

    def signal(self, signal: Signal, peer: Peer | None = None, reason: str = "") -> None:
        """The link says something."""
        self._signal_handler(signal, peer, reason, asyncio.get_running_loop().time())

    def make_room(self, packets: int | None, peer: Peer | None = None) -> None:
        """The link takes that many packets from now on."""
        self.room = packets
        self._room_handler(peer)

    def break_down(self, failure: Exception | None = None) -> None:
        """`run` ends, with that error."""
        self.failure = failure
        self._broken.set()

    def take_sent(self, peer: Peer = "client") -> list[bytes]:
        """What was sent to that peer since the last call; the rest of the record is forgotten, too."""
        packets = [packet for to, packet in self.sent if to == peer]
        self.sent.clear()
        return packets


@asynccontextmanager
async def serving(agent: Agent, *links: FakeLink) -> AsyncIterator[FakeLink]:
    """Run the agent on those links (or a new one); yields the first."""
    used = links or (FakeLink(),)
    for link in used:
        agent.add_link(link)
    task = asyncio.create_task(agent.run())
    await asyncio.sleep(0)
    await asyncio.sleep(0)
    try:
        yield used[0]
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


class WiredClient:
    """A client session whose packets go to the agent and whose timers run in the loop."""

    def __init__(
        self,
        link: FakeLink,
        *,
        key: int,
        peer: Peer | None = None,
        session_id: int = 0x81,
        mtu: int = 512,
        settings: ClientSessionSettings | None = None,
        lose: Callable[[bytes], bool] | None = None,
    ) -> None:
        """`lose` decides for every packet in either direction whether it is lost."""
        self.session = ClientSession(
            key, session_id=session_id, mtu=mtu, settings=settings or ClientSessionSettings(), epoch_ns=lambda: 0
        )
        self.peer: Peer = key if peer is None else peer
        self.events: list[ClientEvent] = []
        self.unplugged = False
        self._link = link
        self._lose = lose or (lambda _: False)
        self._loop = asyncio.get_running_loop()
        self._alarm: asyncio.TimerHandle | None = None
        link.plug(self.peer, self._receive)

    async def connect(self) -> None:
        """Open the session; fails the test when the agent does not."""
        self.session.connect(self._loop.time())
        await self.settle()
        assert self.session.state is ClientState.CONNECTED, self.events

    def transmit(self) -> None:
        """Send what the session has booked."""
        if not self.unplugged:
            for packet in self.session.packets_to_send(self._loop.time()):
                if not self._lose(packet):
                    self._link.inject(packet, self.peer)
        self._arm()

    async def settle(self, turns: int = 12) -> None:
        """Send, and let the answers and the answers to them come; no time passes."""
        for _ in range(turns):
            self.transmit()
            await asyncio.sleep(0)

    async def create(self, object_id: int, variant: ObjectVariant, *, reuse: bool = True, replace: bool = True) -> int:
        """Create an object; returns the status."""
        request_id = self.session.create(object_id, variant, reuse=reuse, replace=replace)
        return await self.status_of(request_id)

    async def delete(self, object_id: int) -> int:
        """Delete an object; returns the status."""
        return await self.status_of(self.session.delete(object_id))

    async def status_of(self, request_id: int) -> int:
        """Wait (no time passes) for the answer to a request."""
        await self.settle()
        statuses = [
            event.status
            for event in self.events
            if isinstance(event, StatusReceived) and event.request_id == request_id
        ]
        assert len(statuses) == 1, self.events
        return statuses[0]

    async def add_writer(
        self, topic: str, *, number: int = 1, type_name: str = "T", qos: EndpointQos = RELIABLE_QOS
    ) -> int:
        """Create a writer of that topic and what it needs; returns its object id."""
        topic_id = make_object_id(number, ObjectKind.TOPIC)
        object_id = make_object_id(number, ObjectKind.DATAWRITER)
        await self._create_all(
            {
                PARTICIPANT: participant_variant("test"),
                topic_id: topic_variant(topic, type_name, PARTICIPANT),
                PUBLISHER: publisher_variant(PARTICIPANT),
                object_id: writer_variant(topic_id, PUBLISHER, qos),
            }
        )
        return object_id

    async def add_reader(
        self,
        topic: str,
        *,
        number: int = 1,
        type_name: str = "T",
        qos: EndpointQos = RELIABLE_QOS,
        stream_id: int | None = STREAM_RELIABLE,
        control: DeliveryControl = UNLIMITED,
    ) -> int:
        """Create a reader of that topic and what it needs, and read on that stream; returns its object id."""
        topic_id = make_object_id(number, ObjectKind.TOPIC)
        object_id = make_object_id(number, ObjectKind.DATAREADER)
        await self._create_all(
            {
                PARTICIPANT: participant_variant("test"),
                topic_id: topic_variant(topic, type_name, PARTICIPANT),
                SUBSCRIBER: subscriber_variant(PARTICIPANT),
                object_id: reader_variant(topic_id, SUBSCRIBER, qos),
            }
        )
        if stream_id is not None:
            await self.read(object_id, stream_id, control)
        return object_id

    async def add_requester(self, service: str, *, number: int = 1, stream_id: int | None = STREAM_RELIABLE) -> int:
        """Create a requester of that service and read its replies; returns its object id."""
        object_id = make_object_id(number, ObjectKind.REQUESTER)
        names = (service, "Q", "A", f"{service}_Request", f"{service}_Reply")
        await self._create_all(
            {PARTICIPANT: participant_variant("test"), object_id: requester_variant(*names, PARTICIPANT)}
        )
        if stream_id is not None:
            await self.read(object_id, stream_id)
        return object_id

    async def add_replier(self, service: str, *, number: int = 1, stream_id: int | None = STREAM_RELIABLE) -> int:
        """Create a replier of that service and read its requests; returns its object id."""
        object_id = make_object_id(number, ObjectKind.REPLIER)
        names = (service, "Q", "A", f"{service}_Request", f"{service}_Reply")
        await self._create_all(
            {PARTICIPANT: participant_variant("test"), object_id: replier_variant(*names, PARTICIPANT)}
        )
        if stream_id is not None:
            await self.read(object_id, stream_id)
        return object_id

    def book_writer(self, topic: str, *, number: int = 1, type_name: str = "T", qos: EndpointQos = RELIABLE_QOS) -> int:
        """Ask for a writer and what it needs without waiting for the statuses; returns its object id."""
        topic_id = make_object_id(number, ObjectKind.TOPIC)
        object_id = make_object_id(number, ObjectKind.DATAWRITER)
        self.session.create(PARTICIPANT, participant_variant("test"))
        self.session.create(topic_id, topic_variant(topic, type_name, PARTICIPANT))
        self.session.create(PUBLISHER, publisher_variant(PARTICIPANT))
        self.session.create(object_id, writer_variant(topic_id, PUBLISHER, qos))
        self.transmit()
        return object_id

    def book_reader(self, topic: str, *, number: int = 1, type_name: str = "T", qos: EndpointQos = RELIABLE_QOS) -> int:
        """Ask for a reader, what it needs and its samples without waiting for the statuses; returns its object id."""
        topic_id = make_object_id(number, ObjectKind.TOPIC)
        object_id = make_object_id(number, ObjectKind.DATAREADER)
        self.session.create(PARTICIPANT, participant_variant("test"))
        self.session.create(topic_id, topic_variant(topic, type_name, PARTICIPANT))
        self.session.create(SUBSCRIBER, subscriber_variant(PARTICIPANT))
        self.session.create(object_id, reader_variant(topic_id, SUBSCRIBER, qos))
        self.session.read(object_id, STREAM_RELIABLE, UNLIMITED)
        self.transmit()
        return object_id

    async def read(self, object_id: int, stream_id: int, control: DeliveryControl | None = UNLIMITED) -> int:
        """Start reading; returns the request id that the samples carry."""
        request_id = self.session.read(object_id, stream_id, control)
        await self.settle()
        return request_id

    async def write(self, object_id: int, *payloads: bytes, stream_id: int = STREAM_RELIABLE) -> int:
        """Write samples and let them arrive; returns the request id of the last one."""
        request_id = 0
        for payload in payloads:
            request_id = self.session.write(object_id, payload, stream_id)
            await self.settle()
        return request_id

    def received(self, object_id: int | None = None) -> list[bytes]:
        """The payloads that came for that object (or all) since the last call."""
        found = [event for event in self.events if isinstance(event, DataReceived)]
        found = [event for event in found if object_id in (None, event.object_id)]
        self.events = [event for event in self.events if event not in found]
        return [event.payload for event in found]

    async def _create_all(self, variants: dict[int, ObjectVariant]) -> None:
        for object_id, variant in variants.items():
            status = await self.create(object_id, variant)
            assert status in (Status.OK, Status.OK_MATCHED), f"object {object_id:04X}: status 0x{status:02X}"

    def take(self, kind: type[ClientEvent]) -> list[ClientEvent]:
        """The events of that class so far, which are taken out."""
        found = [event for event in self.events if isinstance(event, kind)]
        self.events = [event for event in self.events if not isinstance(event, kind)]
        return found

    def _receive(self, packet: bytes) -> None:
        if self.unplugged or self._lose(packet):
            return
        self.session.receive_packet(packet, self._loop.time())
        self._drain()

    def _drain(self) -> None:
        while (event := self.session.next_event()) is not None:
            self.events.append(event)
        self.transmit()

    def _arm(self) -> None:
        if self._alarm is not None:
            self._alarm.cancel()
        when = self.session.timer()
        self._alarm = None if when is None else self._loop.call_at(when, self._ring)

    def _ring(self) -> None:
        self._alarm = None
        self.session.handle_timer(self._loop.time())
        self._drain()
