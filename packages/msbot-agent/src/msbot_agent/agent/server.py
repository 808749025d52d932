"""The agent: links, clients, and which packet belongs to whom.

Theory of operation: the link calls in with a packet, and plain calls carry it through until the samples are booked for
all readers. Every client that then has something to send is marked, and the flusher sends for it.
"""

from __future__ import annotations

import asyncio
import logging
import os
import time
from collections.abc import Callable, Iterator
from functools import cache, partial

from msbot_agent.agent.agent_settings import AgentSettings, session_settings
from msbot_agent.agent.client_table import ClientTable, ServedLink
from msbot_agent.agent.fair_share import FairShare
from msbot_agent.agent.flushing import Flusher
from msbot_agent.agent.gate import ClientInfo, Gate, OpenGate
from msbot_agent.agent.handshake import Handshake, dead_after_s, login_number, wants_echo
from msbot_agent.agent.join_queue import JoinQueue
from msbot_agent.agent.object_creation import Creator
from msbot_agent.agent.object_tree import ObjectBudget
from msbot_agent.agent.proxy import Proxy
from msbot_agent.agent.relays import Relays, put_known_peers_first
from msbot_agent.agent.reply_routing import ReplyExchange
from msbot_agent.agent.shared_state import SharedAgentState
from msbot_agent.agent.stale_sessions import KeyConflicts, StaleSessionProbe, StrangerBudget
from msbot_agent.agent.statistics import ClientView, Latency, SessionFaultCounts, TopicTable
from msbot_agent.link import BacklogLink, Link, Peer, Signal, Tap
from msbot_agent.link.relay import MARK, RelayGreeting
from msbot_agent.space import Space
from msbot_agent.text.sentence import said
from msbot_xrce import AgentSession, References
from msbot_xrce.counting import Tally
from msbot_xrce.errors import BusTaken, LinkDown
from msbot_xrce.messages import CreateClient
from msbot_xrce.sessions import Memory

logger = logging.getLogger(__name__)

_DELETED = said("session deleted")

AgentSignalHandler = Callable[[Link, Signal, Peer | None, str, float], None]
"""`(link, signal, peer or None, reason in words, now)`."""


class Agent:
    """Serves DDS-XRCE clients on any number of links and acts for them in one data space."""

    def __init__(
        self,
        space: Space,
        *,
        gate: Gate | None = None,
        settings: AgentSettings | None = None,
        references: References | None = None,
        epoch_ns: Callable[[], int] = time.time_ns,
        agent_id: bytes | None = None,
        signal: AgentSignalHandler | None = None,
        relay_greeting: RelayGreeting | None = None,
    ) -> None:
        """Put an agent together; it serves once `run` is awaited.

        Args:
            gate: says who may join, write and read; everybody if absent.
            references: profiles that clients may name instead of describing objects.
            epoch_ns: wall clock for time synchronisation, nanoseconds since 1970.
            agent_id: 8 octets that begin the GUIDs of all writers; drawn at random if absent.
            signal: called with every signal of every link.
            relay_greeting: what relays that bring parts are told of the robot.
        """
        self._settings = settings = settings or AgentSettings()
        self._epoch_ns = epoch_ns
        self._gate = gate or OpenGate()
        self._ports: list[ServedLink] = []
        self._clients = ClientTable()
        self._budget = StrangerBudget(self._gate, settings)
        self._rivals = KeyConflicts(self._clients, self._gate, self._call_at, self._end_session)
        predecessors = StaleSessionProbe(self._gate, self._call_at, self._end_session)
        self._queue = JoinQueue(self._gate, places=settings.max_joining, most_waiting=settings.max_unsettled)
        self._relays = Relays(self.add_link, relay_greeting or RelayGreeting(), settings.max_outside_per_s)
        self._handshake = Handshake(
            self._clients,
            self._gate,
            settings,
            budget=self._budget,
            rivals=self._rivals,
            predecessors=predecessors,
            queue=self._queue,
            open_session=self._open_session,
            end_session=self._end_session,
        )
        self._share = FairShare[Proxy](
            settings.max_packets_per_s,
            settings.max_packets_in_all_per_s,
            lambda proxy, rate, share: self._gate.limits(proxy.info, rate, share),
        )
        self.latency = Latency(self._now, self._clients)
        """How long messages take."""
        self._flusher = Flusher(self._now, self._end_session, self._compare, transit=self.latency.transit)
        self._surroundings = SharedAgentState(
            space=space,
            gate=self._gate,
            settings=settings,
            clock=self._now,
            agent_id=agent_id or os.urandom(8),
            mark=self._flusher.schedule,
            rest=self._flusher.rest,
            replies=ReplyExchange(space),
            transit=self.latency.transit,
            references=references,
            topics=TopicTable(settings.max_topics),
            budget=ObjectBudget(settings.max_objects_in_all),
            creator=Creator(settings),
        )
        self._session_settings = cache(partial(session_settings, settings))
        self._held = Memory(settings.max_held_in_all)
        self._unacked = Memory(settings.max_unacked_in_all)
        self._loop: asyncio.AbstractEventLoop | None = None
        self._tasks: dict[ServedLink, asyncio.Task[None]] = {}
        self._group: asyncio.TaskGroup | None = None
        self._ended = asyncio.Event()
        self._failure: LinkDown | None = None
        self._tap: Tap | None = None
        self._signal_handler = signal

    # Life.

    def add_link(self, link: Link) -> None:
        """Serve one more link; may be called before or during `run`."""
        # A fast link gets everything at once; a slow one takes packets one by one, so that waiting samples stay fresh.
        port = ServedLink(link, batch=None if link.info.bits_per_second is None else 1)
        self._ports.append(port)
        link.tap = self._tap
        put_known_peers_first(port, self._gate, self._relays)
        self._attach(port)
        if self._group is not None:
            self._tasks[port] = self._group.create_task(self._serve(port))

    def exchange_link(self, present: Link, other: Link) -> None:
        """Serve a link's clients through another one that carries its packets from now on; its own `run` goes on."""
        for port in self._ports:
            if port.link is present:
                port.link = other
                self._attach(port)

    def _attach(self, port: ServedLink) -> None:
        port.in_bursts = port.link.info.in_bursts
        port.backlog = port.link if isinstance(port.link, BacklogLink) else None
        port.link.attach(
            packet=partial(self._packet_received, port),
            signal=partial(self._signal_received, port),
            room=partial(self._room_gained, port),
            burst_end=self._flusher.flush,
        )

    async def run(self) -> None:
        """Serve all links until cancelled.

        Raises:
            LinkDown: a link could not be opened, or the last one has gone; or another master has its bus (BusTaken).
        """
        self._loop = asyncio.get_running_loop()
        self._flusher.begin(self._loop.time)
        try:
            async with asyncio.TaskGroup() as group:
                self._group = group
                for port in self._ports:
                    self._tasks[port] = group.create_task(self._serve(port))
                await self._ended.wait()
                for task in self._tasks.values():
                    task.cancel()
        finally:
            self._group = None
            self._flusher.stop()
        if self._failure is not None:
            raise self._failure

    # For the users of the agent.

    @property
    def tap(self) -> Tap | None:
        """Called with every packet of every link when set; None costs nothing."""
        return self._tap

    @tap.setter
    def tap(self, tap: Tap | None) -> None:
        self._tap = tap
        for port in self._ports:
            port.link.tap = tap

    def recheck(self, client_key: int) -> None:
        """Ask the gate again for that client: its endpoints enter or leave the space at once."""
        if (proxy := self._clients.by_key(client_key)) is not None:
            proxy.recheck()

    def disconnect(self, client_key: int, reason: str) -> bool:
        """End a session; False when there is none. The client finds out with its next ping or request."""
        if (proxy := self._clients.by_key(client_key)) is None:
            return False
        self._end_session(proxy, reason)
        return True

    def last_heard(self, client_key: int) -> float | None:
        """When the last packet from that client came, whatever it was; None: it has no session."""
        proxy = self._clients.by_key(client_key)
        return None if proxy is None else proxy.last_heard

    def probe(self, client_key: int) -> None:
        """Ask that client for a sign of life; any packet is one (`last_heard`)."""
        if (proxy := self._clients.by_key(client_key)) is not None:
            proxy.probe()

    def troubles(self, client_key: int) -> tuple[str, ...]:
        """Which endpoints should match that client's writers and readers now and cannot, one sentence each."""
        proxy = self._clients.by_key(client_key)
        return () if proxy is None else proxy.troubles()

    def place_of(self, client_key: int) -> tuple[Link, Peer] | None:
        """The link and the address of that client; None: it has no session, or its peer has gone."""
        if (proxy := self._clients.by_key(client_key)) is None or proxy.place is None:
            return None
        port, peer = proxy.place
        return port.link, peer

    def wear(self, client_key: int) -> SessionFaultCounts | None:
        """What went wrong between agent and client in its present session; None: it has none."""
        proxy = self._clients.by_key(client_key)
        return None if proxy is None else proxy.wear()

    @property
    def links(self) -> list[Link]:
        """The links it serves or has served."""
        return [port.link for port in self._ports]

    def clients(self) -> list[ClientView]:
        """All sessions, by key."""
        return sorted(self.iter_clients(), key=lambda view: view.key)

    def iter_clients(self) -> Iterator[ClientView]:
        """The sessions one by one, each as it is when yielded: with thousands, do other work in between."""
        return (proxy.view(self._now()) for proxy in self._clients)

    def topic_at(self, node: Peer, object_id: int) -> tuple[int, str] | None:
        """Client key and topic (of a service: the request topic) of an endpoint of the client at a node of a bus."""
        for port in self._ports:
            proxy = port.clients.get(node) if port.link.info.shared_bus else None
            if proxy is not None and (topic := proxy.topics().get(object_id)) is not None:
                return proxy.info.key, topic
        return None

    def bus_endpoints(self) -> Iterator[tuple[str, Peer, int, int, str]]:
        """Link, node, object id, client key and topic of every endpoint of the clients on buses."""
        for port in self._ports:
            for node, proxy in port.clients.items() if port.link.info.shared_bus else ():
                for object_id, topic in proxy.topics().items():
                    yield port.link.info.name, node, object_id, proxy.info.key, topic

    def sessions_by_link(self) -> list[tuple[Link, int]]:
        """How many sessions came in over each link; cheaper than `clients`."""
        return [(port.link, len(port.members)) for port in self._ports]

    def topics(self) -> list[tuple[str, int, int]]:
        """`(name, published, delivered)` of every topic that clients used since the agent was made."""
        return self._surroundings.topics.counts()

    def dropped(self) -> dict[str, int]:
        """Packets that belonged to no client, by reason in words."""
        total = Tally(self._relays.dropped)
        for port in self._ports:
            total.count_all(port.dropped)
        return total

    # What the links call.

    def _packet_received(self, port: ServedLink, packet: bytes, peer: Peer, now: float) -> None:
        port.opened = True
        flusher = self._flusher
        flusher.in_burst = port.in_bursts
        if now >= flusher.compare_at:
            flusher.compare(now)
        if len(packet) < 4:
            port.dropped.count("packet shorter than a header")
            return
        session_id = packet[0]
        if session_id > 0x80:
            proxy = port.clients.get(peer)
        else:
            proxy = self._keyed(int.from_bytes(packet[4:8], "big"), port, peer) if 0 < session_id < 0x80 else None
        if proxy is None or proxy.session.session_id != session_id:
            self._receive_outside(port, packet, peer, now)
            return
        if session_id < 0x80 and port.members.get(proxy) != peer:
            self._receive_from_elsewhere(proxy, port, packet, peer, now)
            return
        if proxy.limit is not None and not proxy.limit.takes(now):
            return
        proxy.receive(packet, now)
        if proxy.is_over:
            self._flusher.send(proxy, now)
            self._end_session(proxy, _DELETED)

    def _receive_outside(self, port: ServedLink, packet: bytes, peer: Peer, now: float) -> None:
        """A packet that belongs to no session: from a relay, or a client that wants one."""
        if packet.startswith(MARK):
            self._relays.receive(port.link, packet, peer, now)
        elif (answer := self._handshake.answer(port, packet, peer, now)) is not None:
            self._flusher.send_one(port, answer, peer)

    def _room_gained(self, port: ServedLink, peer: Peer | None) -> None:
        self._flusher.room_gained(port, peer)
        self._relays.room_gained(port.link)

    def _compare(self, now: float) -> float:
        """Check who sends too much; returns when to check again."""
        self._share.compare(sum(port.link.counters.packets_in for port in self._ports), self._clients, now)
        return self._share.next_at

    def _keyed(self, client_key: int, port: ServedLink, peer: Peer) -> Proxy | None:
        """The client whose key is in a header: at its own address, or from anywhere unless the gate keeps sessions."""
        here = self._clients.keyed(client_key, port, peer, anywhere=False)
        if here is not None:
            return here
        proxy = self._clients.keyed(client_key, port, peer, anywhere=True)
        return None if proxy is None or self._gate.keeps(proxy.info) else proxy

    def _receive_from_elsewhere(self, proxy: Proxy, port: ServedLink, packet: bytes, peer: Peer, now: float) -> None:
        """Send the answers to where the packet came from; everything else still goes to the address of the login."""
        self._flusher.send(proxy, now)
        proxy.receive(packet, now)
        for answer in proxy.session.packets_to_send(now):
            self._flusher.send_one(port, answer, peer)
        if proxy.is_over:
            self._end_session(proxy, _DELETED)

    def _signal_received(self, port: ServedLink, signal: Signal, peer: Peer | None, reason: str, now: float) -> None:
        if signal is Signal.LINK_UP:
            port.opened = True
        elif signal is Signal.PEER_GONE:
            for proxy in [proxy for proxy, place in port.members.items() if place == peer]:
                self._peer_gone(proxy, said("gone: {reason}", reason=reason), now)
        elif signal is Signal.PEER_BACK:
            for proxy in tuple(port.gone.get(peer, ())):
                self._peer_back(proxy, port, peer)
        if self._signal_handler is not None:
            self._signal_handler(port.link, signal, peer, reason, now)

    # Sessions begin, pause and end.

    def _open_session(self, info: ClientInfo, port: ServedLink, request: CreateClient, now: float) -> Proxy:
        settings = self._session_settings(port.link.info, is_stock=not login_number(request))
        open_session = partial(
            AgentSession,
            request.client_key,
            request.session_id,
            min(request.mtu, port.link.info.mtu),
            settings=settings,
            epoch_ns=self._epoch_ns,
            memory=self._held,
            unacked=self._unacked,
        )
        silence_s = dead_after_s(request, self._settings.dead_after_s)
        proxy = Proxy(info, open_session, self._surroundings, now, dead_after_s=silence_s, echo=wants_echo(request))
        self._flusher.watch_life(proxy, now + proxy.dead_after_s)
        return proxy

    def _peer_gone(self, proxy: Proxy, reason: str, now: float) -> None:
        """Tell the gate at once, and keep the objects for a while: a broken connection does not end a session.

        The client finds them again when it logs in with its key and session id, from any address (seen on the wire,
        TCP), or when the link says that the same peer is back.
        """
        logger.info("client %08X on %s is %s", proxy.info.key, proxy.info.link, reason)
        self._clients.set_gone(proxy)
        proxy.leave(reason, now)
        self._flusher.watch_life(proxy, proxy.next_life_check(now) or now)
        self._gate.session_ended(proxy.info, reason)
        proxy.recheck()

    def _peer_back(self, proxy: Proxy, port: ServedLink, peer: Peer) -> None:
        logger.info("client %08X on %s is back", proxy.info.key, proxy.info.link)
        self._clients.place(proxy, port, peer)
        proxy.come_back()
        self._gate.joined(proxy.info)
        proxy.recheck()
        proxy.pull()

    def _end_session(self, proxy: Proxy, reason: str) -> None:
        if not self._clients.remove(proxy):
            return
        proxy.is_over = True
        self._budget.remove(proxy)
        self._queue.leave(proxy)
        self._rivals.forget(proxy)
        self._flusher.forget(proxy)
        proxy.close()
        logger.info("client %08X on %s has left: %s", proxy.info.key, proxy.info.link, reason)
        if proxy.gone is None:  # otherwise the gate was told when it went
            self._gate.session_ended(proxy.info, reason)

    def _call_at(self, when: float, function: Callable[[], None]) -> object:
        return asyncio.get_running_loop().call_at(when, function)

    def _now(self) -> float:
        return self._loop.time() if self._loop is not None else 0.0

    async def _serve(self, port: ServedLink) -> None:
        """Run one link to its end. The others go on without it, unless it could not be opened or another master has
        it."""
        failure: LinkDown | None = None
        try:
            await port.link.run()
        except LinkDown as error:
            failure = error
            # If it could not be opened, or is another master's, `run` raises: its caller tells the user, once.
            if port.opened and not isinstance(error, BusTaken):
                logger.warning("link %s has ended: %s", port.link.info.name, error)
        for proxy in list(port.members):
            self._end_session(proxy, said("link {link} has ended", link=port.link.info.name))
        del self._tasks[port]
        if self._relays.ended(port.link):
            self._ports.remove(port)
            return
        if not self._tasks or (failure is not None and (isinstance(failure, BusTaken) or not port.opened)):
            self._failure = failure
            self._ended.set()
