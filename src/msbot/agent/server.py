"""The pump: carries packets between links and clients. The only file of the agent that knows asyncio.

Theory of operation: a packet comes in by a call of its link and runs through to the booked samples of all readers
in plain calls; every client that then has something to send is marked. At the end of the turn of the loop `_flush`
sends for all marked clients, as much as each link takes, and arms the one timer of the agent. What a link has no
room for waits in the client's outbox, and with a packet in the outbox the client takes no more samples: they wait
in the bounded histories of its readers until the link calls for more.
"""

from __future__ import annotations

import asyncio
import logging
import os
import time
from collections.abc import Callable, Iterator
from functools import partial

from msbot.agent.clients import ClientTable, Port
from msbot.agent.gate import ClientInfo, Gate, OpenGate
from msbot.agent.handshake import Handshake, dead_after_s, wants_echo
from msbot.agent.objects import ObjectBudget
from msbot.agent.proxy import Proxy, Surroundings
from msbot.agent.replies import ReplyExchange
from msbot.agent.settings import AgentSettings
from msbot.agent.stats import ClientView, TopicTable
from msbot.agent.timers import TimerHeap
from msbot.errors import LinkDown, LinkFull
from msbot.link import BurstLink, Link, Peer, Signal, Tap
from msbot.space import Space
from msbot.xrce import AgentSession, AgentSessionSettings, CreateClient, Memory, References

logger = logging.getLogger(__name__)

AgentSignalHandler = Callable[[Link, Signal, Peer | None, str, float], None]
"""`(link, signal, peer or None, reason in words, now)`."""


class Agent:
    """Serves DDS-XRCE clients on any number of links and acts for them in one data space."""

    def __init__(
        self, space: Space, *, gate: Gate | None = None, settings: AgentSettings | None = None,
        references: References | None = None, epoch_ns: Callable[[], int] = time.time_ns,
        agent_id: bytes | None = None,
    ) -> None:  # fmt: skip
        """Put an agent together; it serves once `run` is awaited.

        Args:
            gate: who may join, write and read; everybody if absent.
            references: profiles that clients may name instead of describing objects.
            epoch_ns: wall clock for time synchronisation, nanoseconds since 1970.
            agent_id: 8 octets that begin the GUIDs of all writers; drawn at random if absent.
        """
        self._settings = settings or AgentSettings()
        self._epoch_ns = epoch_ns
        self._gate = gate or OpenGate()
        self._ports: list[Port] = []
        self._clients = ClientTable()
        self._handshake = Handshake(self._clients, self._gate, self._settings, self._open_session, self._end_session)
        self._surroundings = Surroundings(
            space=space,
            gate=self._gate,
            settings=self._settings,
            clock=self._now,
            agent_id=agent_id or os.urandom(8),
            mark=self._mark,
            replies=ReplyExchange(space),
            references=references,
            topics=TopicTable(self._settings.max_topics),
            budget=ObjectBudget(self._settings.max_objects_in_all),
        )
        self._session_settings = AgentSessionSettings(
            window=self._settings.window,
            heartbeat_s=self._settings.heartbeat_s,
            heartbeat_min_s=self._settings.heartbeat_min_s,
            max_message=self._settings.max_message,
            queue_limit=self._settings.max_burst,
        )
        self._held = Memory(self._settings.max_held_in_all)
        self._loop: asyncio.AbstractEventLoop | None = None
        self._tasks: dict[Port, asyncio.Task[None]] = {}
        self._group: asyncio.TaskGroup | None = None
        self._ended = asyncio.Event()
        self._failure: LinkDown | None = None
        self._marked: list[Proxy] = []
        self._in_burst = False
        self._timers: TimerHeap[Proxy] = TimerHeap()
        self._lives: TimerHeap[Proxy] = TimerHeap()
        self._alarm: asyncio.TimerHandle | None = None
        self._tap: Tap | None = None
        self.on_signal: AgentSignalHandler | None = None
        """Called with every signal of every link."""

    # Life.

    def add_link(self, link: Link) -> None:
        """Serve a link, too; may be called before or during `run`."""
        # A fast link is given all there is; a slow one takes packet by packet, so that what waits is still fresh.
        port = Port(link, batch=None if link.info.bits_per_second is None else 1)
        self._ports.append(port)
        link.tap = self._tap
        link.on_packet(partial(self._packet_received, port))
        link.on_signal(partial(self._signal_received, port))
        link.on_room(partial(self._room_gained, port))
        if isinstance(link, BurstLink):
            port.in_bursts = True
            link.on_burst_end(self._flush)
        if self._group is not None:
            self._tasks[port] = self._group.create_task(self._serve(port))

    async def run(self) -> None:
        """Serve all links until cancelled.

        Raises:
            LinkDown: a link could not be opened, or the last one has gone.
        """
        self._loop = asyncio.get_running_loop()
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
            if self._alarm is not None:
                self._alarm.cancel()
        if self._failure is not None:
            raise self._failure

    # For those who put it to use.

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
        proxy = self._clients.by_key(client_key)
        if proxy is not None:
            proxy.recheck()

    def disconnect(self, client_key: int, reason: str) -> bool:
        """End a session; False when there is none. The client learns it from its next ping or request."""
        proxy = self._clients.by_key(client_key)
        if proxy is None:
            return False
        self._end_session(proxy, reason)
        return True

    @property
    def links(self) -> list[Link]:
        """The links it serves or has served."""
        return [port.link for port in self._ports]

    def clients(self) -> list[ClientView]:
        """All sessions, by key."""
        return sorted(self.iter_clients(), key=lambda view: view.key)

    def iter_clients(self) -> Iterator[ClientView]:
        """The sessions one by one, each as it is when asked for: with thousands, do something else in between."""
        return (proxy.view(self._now()) for proxy in self._clients)

    def topics(self) -> list[tuple[str, int, int]]:
        """`(name, published, delivered)` of every topic that clients used since the agent was made."""
        return self._surroundings.topics.counts()

    def dropped(self) -> dict[str, int]:
        """Packets that belonged to no client, by reason in words."""
        total: dict[str, int] = {}
        for port in self._ports:
            for reason, count in port.dropped.as_dict().items():
                total[reason] = total.get(reason, 0) + count
        return total

    # What the links call.

    def _packet_received(self, port: Port, packet: bytes, peer: Peer, now: float) -> None:
        port.opened = True
        self._in_burst = port.in_bursts
        if len(packet) < 4:
            port.dropped.add("packet shorter than a header")
            return
        session_id = packet[0]
        proxy: Proxy | None = None
        if session_id > 0x80:
            proxy = port.clients.get(peer)
        elif 0 < session_id < 0x80:
            proxy = self._clients.keyed(int.from_bytes(packet[4:8], "big"))
            if proxy is not None and port.members.get(proxy) != peer:
                self._receive_from_elsewhere(proxy, port, packet, peer, now)
                return
        if proxy is None:
            answer = self._handshake.answer(port, packet, peer, now)
            if answer is not None:
                self._send_one(port, answer, peer)
            return
        proxy.receive(packet, now)
        if proxy.is_over:
            self._send(proxy, now)
            self._end_session(proxy, "session deleted")

    def _receive_from_elsewhere(self, proxy: Proxy, port: Port, packet: bytes, peer: Peer, now: float) -> None:
        """Answers go to where the packet came from; all else stays on the way to the address of the login."""
        self._send(proxy, now)
        proxy.receive(packet, now)
        for answer in proxy.session.packets_to_send(now):
            self._send_one(port, answer, peer)
        if proxy.is_over:
            self._end_session(proxy, "session deleted")

    def _signal_received(self, port: Port, signal: Signal, peer: Peer | None, reason: str, now: float) -> None:
        if signal is Signal.LINK_UP:
            port.opened = True
        elif signal is Signal.PEER_GONE:
            for proxy in [proxy for proxy, place in port.members.items() if place == peer]:
                self._peer_gone(proxy, f"gone: {reason}", now)
        elif signal is Signal.PEER_BACK:
            for proxy in tuple(port.gone.get(peer, ())):
                self._peer_back(proxy, port, peer)
        if self.on_signal is not None:
            self.on_signal(port.link, signal, peer, reason, now)

    def _room_gained(self, port: Port, peer: Peer | None) -> None:
        now = self._now()
        for proxy in list(port.blocked):
            if peer is None or port.members[proxy] == peer:
                self._attend(proxy, now)
        self._arm()

    # Sessions begin, pause and end.

    def _open_session(self, info: ClientInfo, port: Port, request: CreateClient, now: float) -> Proxy:
        session = AgentSession(
            request.client_key,
            request.session_id,
            min(request.mtu, port.link.info.mtu),
            settings=self._session_settings,
            epoch_ns=self._epoch_ns,
            memory=self._held,
        )
        silence_s = dead_after_s(request, self._settings.dead_after_s)
        proxy = Proxy(info, session, self._surroundings, now, dead_after_s=silence_s, echo=wants_echo(request))
        self._lives.schedule(proxy, now + silence_s)
        self._arm()
        return proxy

    def _peer_gone(self, proxy: Proxy, reason: str, now: float) -> None:
        """Tell the gate at once, and keep the objects for a while: a broken connection does not end a session.

        The client finds them when it logs in again with its key and session id, from wherever (seen on the wire, TCP),
        or when the link says that the very peer is back.
        """
        logger.info("client %08X on %s is %s", proxy.info.key, proxy.info.link, reason)
        self._clients.set_gone(proxy)
        proxy.leave(reason, now)
        self._lives.schedule(proxy, proxy.next_life_check(now) or now)
        self._gate.left(proxy.info, reason)
        proxy.recheck()
        self._arm()

    def _peer_back(self, proxy: Proxy, port: Port, peer: Peer) -> None:
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
        self._timers.forget(proxy)
        self._lives.forget(proxy)
        proxy.close()
        logger.info("client %08X on %s has left: %s", proxy.info.key, proxy.info.link, reason)
        if proxy.gone is None:  # else the gate was told when it went
            self._gate.left(proxy.info, reason)

    # One flush for each turn of the loop, one timer for all.

    def _mark(self, proxy: Proxy) -> None:
        if proxy.is_marked:
            return
        proxy.is_marked = True
        self._marked.append(proxy)
        if len(self._marked) == 1 and not self._in_burst:
            asyncio.get_running_loop().call_soon(self._flush)

    def _flush(self) -> None:
        self._in_burst = False
        if not self._marked:
            return
        now = self._now()
        marked, self._marked = self._marked, []
        for proxy in marked:
            proxy.is_marked = False
            if not proxy.is_over:
                self._attend(proxy, now)
        self._arm()

    def _attend(self, proxy: Proxy, now: float) -> None:
        """Send for a client; what was sent decides when to look again."""
        self._send(proxy, now)
        when = proxy.timer()
        if when is not None:
            self._timers.schedule(proxy, when)

    def _send(self, proxy: Proxy, now: float) -> None:
        """Send what the client's session has, as far as the link takes it."""
        place = self._clients.place_of(proxy)
        if place is None:
            return
        port, peer = place
        link = port.link
        outbox = proxy.outbox
        pulled_all = False
        while link.has_room(peer):
            if not outbox and not pulled_all:
                outbox.extend(proxy.session.packets_to_send(now, port.batch))
                pulled_all = port.batch is None or not outbox
            if not outbox:
                if not proxy.is_blocked:
                    return
                if not proxy.pull(port.batch):
                    proxy.is_blocked = False
                    del port.blocked[proxy]
                pulled_all = False
                continue
            packet = outbox[0]
            try:
                link.send(packet, peer)
            except LinkFull:
                break
            except LinkDown:
                proxy.drop("packet for a link that is down")
            else:
                proxy.bytes_out += len(packet)
            outbox.popleft()
        proxy.is_blocked = True
        port.blocked[proxy] = None

    def _send_one(self, port: Port, packet: bytes, peer: Peer) -> None:
        """Send a packet outside of a session; when it cannot go, the other side repeats its question."""
        try:
            port.link.send(packet, peer)
        except (LinkFull, LinkDown) as error:
            port.dropped.add(f"answer not sent: {type(error).__name__}")

    def _arm(self) -> None:
        times = [when for when in (self._timers.next_at(), self._lives.next_at()) if when is not None]
        if not times:
            return
        when = min(times)
        if self._alarm is not None:
            if self._alarm.when() <= when:
                return
            self._alarm.cancel()
        self._alarm = asyncio.get_running_loop().call_at(when, self._alarm_rang)

    def _alarm_rang(self) -> None:
        self._alarm = None
        now = self._now()
        for proxy in self._timers.pop_due(now):
            proxy.handle_timer(now)
        for proxy in self._lives.pop_due(now):
            when = proxy.next_life_check(now)
            if when is None:
                silence = f"silent for {now - proxy.last_heard:.1f} s, and did not answer"
                self._end_session(proxy, silence if proxy.gone is None else f"{proxy.gone}, and did not come back")
            else:
                self._lives.schedule(proxy, when)
        self._arm()

    def _now(self) -> float:
        return self._loop.time() if self._loop is not None else 0.0

    async def _serve(self, port: Port) -> None:
        """Run one link to its end; the others go on without it, unless it could not even be opened."""
        failure: LinkDown | None = None
        try:
            await port.link.run()
        except LinkDown as error:
            failure = error
            if port.opened:  # else `run` raises it, and who awaits that tells the user once
                logger.warning("link %s has ended: %s", port.link.info.name, error)
        for proxy in list(port.members):
            self._end_session(proxy, f"link {port.link.info.name} has ended")
        del self._tasks[port]
        if not self._tasks or (failure is not None and not port.opened):
            self._failure = failure
            self._ended.set()
