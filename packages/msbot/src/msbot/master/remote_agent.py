"""An agent whose gate is fed by a master elsewhere: `msbot agent ... --master ADDRESS`.

Sessions of parts end here: what is lost on their links is sent again from here, and parts of one agent hear each other
without the network between them. Who is let in, and to which topics, the master says (`msbot.pnp.remote_agents`); the
topics themselves are carried by `TopicBridge`. For the parts nothing is different: profile and inventory answer here
as they do at the master.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import os
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from typing import Final, NamedTuple

from msbot.master.master import INVENTORY_KEY, MASTER_KEY, StoppableLink
from msbot.master.service_bridge import ServiceBridge
from msbot.part import Client, ClientSettings, ConnectionState, Entity, ServiceNames
from msbot.part.join import pnp_messages, thesis_messages
from msbot.pnp import Profile
from msbot.pnp.inventory_service import LONGEST_BEST_EFFORT, MOST_ASKERS
from msbot.pnp.master_service import MasterService
from msbot.pnp.remote_agents.agent_messages import FromAgent, OpenTopic, is_sendable
from msbot.pnp.remote_agents.agents_service import NAMES, ReliableSendQueue, goes_at_once
from msbot.pnp.remote_agents.remote_gate import RemoteGate
from msbot.service_types import service_type
from msbot_agent.agent import Agent, AgentSettings, AgentSignalHandler, client_key_of
from msbot_agent.link import InprocHub, Link, Peer, Signal
from msbot_agent.process.end_signals import ungrouped
from msbot_agent.space import MemorySpace, Qos, Reader, Sample, Space, Topic, Writer
from msbot_agent.text.sentence import printable
from msbot_xrce import References
from msbot_xrce.counting import Tally
from msbot_xrce.errors import LinkDown, LinkFull, LocalProtocolError
from msbot_xrce.messages import STREAM_BEST_EFFORT, STREAM_RELIABLE
from msbot_xrce.objects import EndpointQos

# The topics of an agent's parts, carried to its master and back: one copy of each sample, however many read it.
#
# What a part here writes goes to the master if the master has said that the part may write it; what a part here reads
# comes from the master. Parts at the same agent hear each other directly, not by this way: the master sends an agent
# nothing that came from it, and what came from the master is not sent back.


_GUID_OCTETS: Final = 16


class _TopicDirection(NamedTuple):
    topic: str
    type_name: str
    reliable: bool
    up: bool
    """Whether it leads to the master."""

    @property
    def stream_id(self) -> int:
        return STREAM_RELIABLE if self.reliable else STREAM_BEST_EFFORT


class TopicBridge:
    """Carries topics between an agent's space and the master.

    Args:
        space: where the agent acts for its parts.
        client: the agent's own client at the master, which gets none of its own samples back.
    """

    def __init__(self, space: Space, client: Client) -> None:
        self.lost = Tally()
        """Samples that could not be passed on to the master, by topic."""
        self._space = space
        self._client = client
        self._participant = client.create_participant("msbot_agent")
        self.services = ServiceBridge(space, client, self._participant)
        self._publisher = client.create_publisher(self._participant)
        self._subscriber = client.create_subscriber(self._participant)
        self._up: dict[_TopicDirection, tuple[Reader, tuple[Entity, Entity]]] = {}
        self._down: dict[_TopicDirection, tuple[Writer, tuple[Entity, Entity]]] = {}
        self._into: dict[int, Writer] = {}
        """Object id of a reader at the master -> the writer here that gets its samples."""
        self._own: set[bytes] = set()
        """GUIDs of these writers."""
        self._next_guid = int.from_bytes(os.urandom(_GUID_OCTETS - 1), "big")

    def set_topics(self, topics: Iterable[OpenTopic]) -> None:
        """Carry these topics from now on, each in the direction in which parts here use it, and no others."""
        topics = list(topics)
        self.services.set_services(topics)
        wanted = {
            _TopicDirection(topic.topic, topic.topic_type, bool(topic.reliable), bool(topic.publishes)): None
            for topic in topics
            if service_type(topic.topic_type) is None
        }
        for way in [*self._up, *self._down]:
            if way not in wanted:
                self._end(way)
        for way in wanted:
            if way not in self._up and way not in self._down:
                self._begin(way)

    def arrived(self, object_id: int, payload: bytes) -> None:
        """The master has sent a sample."""
        writer = self._into.get(object_id)
        if writer is not None:
            writer.write(payload)

    def room_gained(self) -> None:
        """The client has room again: what waits goes on."""
        for way, (reader, (writer, _)) in self._up.items():
            while (sample := reader.take()) is not None:
                self._pass_on(way, writer, sample)

    def _begin(self, way: _TopicDirection) -> None:
        topic, qos = Topic(way.topic, way.type_name), Qos(reliable=way.reliable)
        far_topic = self._client.create_topic(self._participant, way.topic, way.type_name)
        far_qos = EndpointQos(reliable=way.reliable)
        if way.up:
            entity = self._client.create_writer(self._publisher, far_topic, far_qos)
            self._up[way] = self._space.reader(topic, qos, partial(self._leaves, way, entity)), (entity, far_topic)
            return
        entity = self._client.create_reader(self._subscriber, far_topic, far_qos)
        self._client.read(entity, stream_id=way.stream_id)
        self._next_guid = (self._next_guid + 1) % (1 << 8 * _GUID_OCTETS)
        writer = self._space.writer(topic, qos, self._next_guid.to_bytes(_GUID_OCTETS, "big"))
        self._own.add(writer.guid)
        self._into[entity.object_id] = writer
        self._down[way] = writer, (entity, far_topic)

    def _end(self, way: _TopicDirection) -> None:
        entities: tuple[Entity, Entity]
        if way.up:
            reader, entities = self._up.pop(way)
            reader.close()
        else:
            writer, entities = self._down.pop(way)
            writer.close()
            self._own.discard(writer.guid)
            del self._into[entities[0].object_id]
        for entity in entities:
            self._client.delete(entity)

    def _leaves(self, way: _TopicDirection, entity: Entity, sample: Sample) -> bool:
        """A sample was written here; False: it waits until there is room."""
        if sample.writer in self._own:
            return True
        if way.reliable and not self._client.has_room(STREAM_RELIABLE):
            return False
        self._pass_on(way, entity, sample)
        return True

    def _pass_on(self, way: _TopicDirection, entity: Entity, sample: Sample) -> None:
        if sample.writer in self._own:
            return
        try:
            self._client.write(entity, sample.payload, stream_id=way.stream_id)
        except (LinkFull, LocalProtocolError):
            self.lost.count(way.topic)


AGAIN_S: Final = 2.0
"""Pause before a way to the master that failed is tried again."""

GOODBYE_S: Final = 1.0
"""Longest time that the master has to confirm the end."""

_GUID_BYTES: Final = 16
_NOBODYS_REQUEST: Final = bytes(8)


class _InventoryProxy:
    """Takes what parts here ask the inventory, and hands them its answers."""

    def __init__(self, hub: InprocHub, gate: RemoteGate) -> None:
        self._gate = gate
        self._client = Client(hub.connect(), key=INVENTORY_KEY, on_request=self._asked)
        participant = self._client.create_participant(pnp_messages.INVENTORY_SERVICE)
        self._compact = self._client.create_replier(
            participant,
            ServiceNames(
                pnp_messages.INVENTORY_SERVICE, pnp_messages.INVENTORY_REQUEST_TYPE, pnp_messages.INVENTORY_REPLY_TYPE
            ),
        )
        self._compat = self._client.create_replier(
            participant, ServiceNames(thesis_messages.SERVICE, thesis_messages.REQUEST_TYPE, thesis_messages.REPLY_TYPE)
        )
        for replier in (self._compact, self._compat):
            self._client.read(replier, stream_id=STREAM_BEST_EFFORT)
        self._askers: dict[int, bytes] = {}
        """Key of a client -> GUID of its requests."""
        self.dropped = Tally()

    async def run(self) -> None:
        """Serve until cancelled."""
        await self._client.run()

    def answer(self, in_compat: bool, identity: bytes, body: bytes) -> None:
        """The inventory says something to a part."""
        self._say(self._compat if in_compat else self._compact, identity, body)

    def order(self, kind: pnp_messages.NoticeKind, number: int) -> None:
        """STOP or GO to all parts here."""
        notice = pnp_messages.Notice(number=number & 0xFFFFFFFF, binding=pnp_messages.NO_BINDING, kind=kind).encode()
        for guid in list(self._askers.values()):
            self._say(self._compact, guid + _NOBODYS_REQUEST, notice)

    def forget(self, client_key: int) -> None:
        """The client's session has ended."""
        self._askers.pop(client_key, None)

    def _asked(self, object_id: int, request_id: int, identity: bytes, body: bytes) -> None:  # noqa: ARG002
        guid = identity[:_GUID_BYTES]
        client_key = client_key_of(guid)
        in_compat = object_id != self._compact.object_id
        if not in_compat and (client_key in self._askers or len(self._askers) < MOST_ASKERS):
            self._askers[client_key] = guid
        self._gate.ask(client_key, in_compat=in_compat, identity=identity, body=body)

    def _say(self, replier: Entity, identity: bytes, body: bytes) -> None:
        stream_id = STREAM_BEST_EFFORT if len(body) <= LONGEST_BEST_EFFORT else STREAM_RELIABLE
        try:
            self._client.reply(replier, identity, body, stream_id=stream_id)
        except (LinkFull, LocalProtocolError) as error:
            self.dropped.count(f"answer: {error}")  # the part asks again by itself


class RemoteAgent:
    """An agent that brings parts to a master elsewhere. Must be made inside a running event loop.

    Args:
        open_parts: makes the link of the parts, given the hash of the robot's profile.
        way: the link to the master, or to several of which one serves.
        name: what the master calls this agent.
        say: tells people.
        space: where parts here meet; memory if absent.
        settings: limits and periods of the agent.
        references: profiles that clients may name.
        on_signal: called with every signal of the parts' link.
    """

    def __init__(
        self,
        open_parts: Callable[[int], Link],
        way: Link,
        *,
        name: str,
        say: Callable[[str], object],
        space: Space | None = None,
        settings: AgentSettings | None = None,
        references: References | None = None,
        on_signal: AgentSignalHandler | None = None,
    ) -> None:
        self._loop = asyncio.get_running_loop()
        self._open_parts = open_parts
        self._way = way
        self._say: Callable[[str], object] = lambda words: say(printable(words))  # the master's words are a stranger's
        self._name = name
        self._on_signal = on_signal
        self._profile: Profile | None = None
        self._welcomed = asyncio.Event()
        self._alarm: asyncio.TimerHandle | None = None
        self._links: list[Link] = []
        space = space or MemorySpace(clock=self._loop.time)
        self.gate = RemoteGate(boot=int.from_bytes(os.urandom(8), "big"), name=name, around=self, clock=self._loop.time)
        self.agent = Agent(space, gate=self.gate, settings=settings, references=references, signal=self._signalled)
        self._hub = InprocHub()
        self.agent.add_link(self._hub.server)
        self._deputy = _InventoryProxy(self._hub, self.gate)
        self._client = Client(
            way,
            key=int.from_bytes(os.urandom(4), "big") | 1,
            settings=replace(ClientSettings.for_link(way.info), echo=False, asks_again=True, numbers_logins=True),
            on_state=self._master_changed,
            on_topic=lambda object_id, _, payload: self.bridge.arrived(object_id, payload),
            on_reply=self._replied,
            on_request=lambda object_id, _, identity, octets: self.bridge.services.requested(
                object_id, identity, octets
            ),
            on_room=self._room_gained,
        )
        participant = self._client.create_participant("msbot_agents")
        self._at_once = self._client.create_requester(participant, NAMES)
        self._in_order = self._client.create_requester(participant, NAMES)
        self._client.read(self._at_once, stream_id=STREAM_BEST_EFFORT)
        self._client.read(self._in_order, stream_id=STREAM_RELIABLE)
        self._sayings = ReliableSendQueue(partial(self._client.write, self._in_order))
        self.bridge = TopicBridge(space, self._client)

    @property
    def links(self) -> tuple[Link, ...]:
        """The links of the parts; none before the master was heard."""
        return tuple(self._links)

    async def run(self) -> None:
        """Serve until cancelled.

        Raises:
            LinkDown: the link of the parts cannot be opened; the text names the remedy.
        """
        self.gate.start(self._loop.time())
        self._tick()
        try:
            with ungrouped(LinkDown):
                async with asyncio.TaskGroup() as tasks:
                    tasks.create_task(self.agent.run())
                    tasks.create_task(self._deputy.run())
                    tasks.create_task(self._keep_way())
                    tasks.create_task(self._serve_parts())
        finally:
            if self._alarm is not None:
                self._alarm.cancel()

    async def _keep_way(self) -> None:
        """A way that cannot be opened is no reason to end: an agent may start before its network is there."""
        told = ""
        while True:
            try:
                await self._speak()
            except LinkDown as error:
                if str(error) != told:
                    told = str(error)
                    self._say(f"no way to the master yet: {error}")
            await asyncio.sleep(AGAIN_S)

    async def _speak(self) -> None:
        """Have a session with the master; when the agent ends, the master hears it."""
        speaking = asyncio.ensure_future(self._client.run())
        try:
            await asyncio.shield(speaking)
        except asyncio.CancelledError:
            self._client.close_soon()
            await asyncio.wait({speaking}, timeout=GOODBYE_S)
            speaking.cancel()
            raise

    async def _serve_parts(self) -> None:
        """The parts' link is opened when the robot is known: its name is in the beacon of a CAN bus."""
        await self._welcomed.wait()
        assert self._profile is not None
        link = self._open_parts(self._profile.profile_hash())
        self._links.append(link)
        self._master_service = MasterService(partial(Client, self._hub.connect(), key=MASTER_KEY), self._profile)
        self.agent.add_link(link)
        await self._master_service.run()

    def _tick(self) -> None:
        self.gate.handle_timer(self._loop.time())
        at = self.gate.timer()
        self._alarm = None if at == math.inf else self._loop.call_at(at, self._tick)

    def _signalled(self, link: Link, signal: Signal, peer: Peer | None, reason: str, now: float) -> None:
        if self._on_signal is not None and link in self._links:
            self._on_signal(link, signal, peer, reason, now)
        if signal is Signal.STOP:
            for other in self._links:
                if other is not link:
                    _stop_on(other)
            self.gate.stop_said(f"{reason}, said on {link.info.name}")

    def _master_changed(self, state: ConnectionState, reason: str) -> None:  # noqa: ARG002
        if state is not ConnectionState.CONNECTED:
            self.gate.lost_master()
            self.bridge.services.session_lost()

    def _replied(self, object_id: int, number: int, octets: bytes) -> None:
        if object_id in (self._at_once.object_id, self._in_order.object_id):
            self.gate.receive(octets, self._loop.time())
        else:
            self.bridge.services.replied(object_id, number, octets)

    def _room_gained(self) -> None:
        self._sayings.go_on()
        self.bridge.room_gained()

    # What the gate needs of the agent (`around_agent.AgentHooks`).

    def send(self, message: FromAgent) -> None:
        """Say it to the master; what cannot be said now is lost."""
        octets = is_sendable(message)
        if octets is None:
            self.gate.dropped.count("message to the master that cannot be said")
        elif not goes_at_once(message):
            self._sayings.send(octets)
        else:
            try:
                self._client.write(self._at_once, octets, stream_id=STREAM_BEST_EFFORT)
            except (LinkFull, LocalProtocolError):
                self.gate.dropped.count("message while there is no way to the master")

    def rights_changed(self, client_key: int) -> None:
        """The verdict on that client has changed."""
        self.agent.recheck(client_key)

    def topics_changed(self) -> None:
        """Other topics than before are used by clients that are in."""
        self.bridge.set_topics(self.gate.topics())

    def answer(self, in_compat: bool, identity: bytes, body: bytes) -> None:
        """The inventory says something to a part."""
        self._deputy.answer(in_compat, identity, body)

    def order(self, kind: pnp_messages.NoticeKind, number: int) -> None:
        """STOP or GO to all."""
        self._say("the master says STOP" if kind is pnp_messages.NoticeKind.STOP else "the master says GO")
        if kind is pnp_messages.NoticeKind.STOP:
            for link in self._links:
                _stop_on(link)
        self._deputy.order(kind, number)

    def welcome(self, profile: Profile) -> None:
        """The master says which robot this is."""
        known, self._profile = self._profile, profile
        if known is None:
            self._say(f"the master of {profile.name} takes the parts of this agent, {self._name}")
        elif known != profile:
            self._say(
                f"the master serves another robot now, {profile.name}: start this agent again, so that its parts see it"
            )
        self._welcomed.set()

    def session_ended(self, client_key: int) -> None:
        """A client's session has ended."""
        self._deputy.forget(client_key)

    def close(self, client_key: int, reason: str) -> None:
        """End a client's session."""
        self.agent.disconnect(client_key, reason)

    def heard_at(self, client_key: int) -> float | None:
        """When a client was last heard."""
        return self.agent.last_heard(client_key)

    def probe(self, client_key: int) -> None:
        """Ask a client for a sign of life."""
        self.agent.probe(client_key)

    def say(self, words: str) -> None:
        """Tell people."""
        self._say(words)


def _stop_on(link: Link) -> None:
    if isinstance(link, StoppableLink):
        # A bus that is down now carries no orders to move either.
        with contextlib.suppress(LinkDown, LinkFull):
            link.send_stop()
