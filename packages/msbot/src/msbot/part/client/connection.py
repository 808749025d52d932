"""One DDS-XRCE session that keeps itself open: log in, watch the agent, log in again.

Theory of operation. `run` serves the link. Everything else is plain calls in the loop's thread: they queue messages in
the session, and one flush per loop turn sends what was queued, as far as the link has room. One timer serves the
session, the watch over the agent, the retries and the owner. When the agent forgets us, falls silent or the link
breaks, the connection says so and logs in again, each time with the other of two session ids: the agent then starts
afresh (seen on the wire), and no late packet of the old session can be mistaken for a new one.

::

    connecting ──answered──> connected ──silent, forgotten, link down──> lost ──answered──> connected
        └──no answer, refused──────────────────────────────────────────────┘      any ──close──> closed
"""

from __future__ import annotations

import asyncio
import logging
import os
from collections.abc import Callable
from enum import Enum
from random import Random

from msbot.part.client.client_settings import (
    ChangeNotifier,
    ClientCounters,
    ClientSettings,
    ConnectionState,
    PingAnswer,
    WorkScheduler,
)
from msbot_agent.link import Link, Peer, Signal, SignalHandler
from msbot_xrce import ClientSession, ClientSessionSettings, Status
from msbot_xrce.errors import LinkDown, LinkError, RemoteProtocolError
from msbot_xrce.messages import STREAM_NONE, LoginProperty, status_words
from msbot_xrce.sessions import (
    ClientEvent,
    Connected,
    ConnectFailed,
    DataReceived,
    Pong,
    SessionClosed,
    SessionRestarted,
    TimeSynchronised,
)

# Is the agent still there? Pure: the client says what it heard, the watch says when to ping and when to give up.
#
# An agent that was restarted, or that sees us under a new address, says nothing at all to our messages (DDS-XRCE has
# no "unknown session" error; seen on the wire). Only a GET_INFO reveals it.


class WatchStep(Enum):
    """What the client has to do now."""

    PING = "send a GET_INFO"
    GIVE_UP = "the agent is gone"


class Watch:
    """Watches one session; off until `start`."""

    def __init__(self, *, quiet_s: float, ping_s: float, pings: int) -> None:
        """Make a watch.

        Args:
            quiet_s: silence of the agent after which it is pinged.
            ping_s: time for the answer to a ping.
            pings: pings without an answer after which the agent is gone, at least 1.
        """
        self._quiet_s = quiet_s
        self._ping_s = ping_s
        self._pings = pings
        self._sent = 0
        self._due_at: float | None = None

    def start(self, now: float) -> None:
        """A session was opened."""
        self._sent = 0
        self._due_at = now + self._quiet_s

    def cancel(self) -> None:
        """There is no session to watch."""
        self._due_at = None

    def agent_heard(self, now: float) -> None:
        """The agent sent something in this session; does nothing while off."""
        if self._due_at is not None:
            self.start(now)

    def check(self, now: float) -> None:
        """Somebody suspects that the agent is gone: ping at once, unless a ping is already under way."""
        if self._due_at is not None and self._sent == 0:
            self._due_at = now

    def timer(self) -> float | None:
        """When to call `step` next, or None while off."""
        return self._due_at

    def step(self, now: float) -> WatchStep | None:
        """What is due now, or None."""
        if self._due_at is None or now < self._due_at:
            return None
        if self._sent == self._pings:
            self.cancel()
            return WatchStep.GIVE_UP
        self._sent += 1
        self._due_at = now + self._ping_s
        return WatchStep.PING


class Stall:
    """Notices that the agent is there but takes nothing: the streams of the two ends are out of step.

    That happens when a late packet of an earlier session arrives in the new one. No acknowledgement can repair it, only
    a new session can.
    """

    def __init__(self, stall_s: float) -> None:
        """Make it; `stall_s` seconds of waiting without any progress are a stall."""
        self._stall_s = stall_s
        self._since: float | None = None

    def progress(self) -> None:
        """A request was answered, or there is room again, or there is nothing to wait for."""
        self._since = None

    def waits(self, now: float) -> float:
        """Something waits for the agent; returns when this becomes a stall: a time in the past = it is one already."""
        if self._since is None:
            self._since = now
        return self._since + self._stall_s


_GOES_DOWN = (Signal.LINK_DOWN, Signal.PEER_GONE)
_COMES_UP = (Signal.LINK_UP, Signal.PEER_JOINED, Signal.PEER_BACK)

_log = logging.getLogger(__name__)


class Connection:
    """Keeps a session open; `session` may be used while `state` is CONNECTED.

    Link, key, settings, clock and random generator are those of `Client`.

    Args:
        on_state: (state, reason in words) at every change.
        on_signal: a signal of the link, after the connection has handled it.
        on_event: (event, now) of everything that arrives in the session, except what keeps it open.
        on_session_over: everything queued or answered in the session is void.
        before_sending: (now): queues what is due in the open session; returns when more will be due, or None.
    """

    def __init__(
        self,
        link: Link,
        *,
        key: int,
        settings: ClientSettings,
        epoch_ns: Callable[[], int],
        random: Random,
        on_state: Callable[[ConnectionState, str], None],
        on_signal: SignalHandler,
        on_event: Callable[[ClientEvent, float], None],
        on_session_over: Callable[[], None],
        before_sending: Callable[[float], float | None],
    ) -> None:
        self.state = ConnectionState.CONNECTING
        self.reason = "not started"
        self.key = key
        self.settings = settings
        self.counters = ClientCounters()
        self.was_heard = False
        """Whether the agent had acknowledged everything when the session was deleted."""
        self.news = ChangeNotifier()
        self.link = link
        self._on_state = on_state
        self._on_signal = on_signal
        self._on_event = on_event
        self._on_session_over = on_session_over
        self._before_sending = before_sending
        self._epoch_ns = epoch_ns
        self._random = random
        self._watch = Watch(quiet_s=settings.quiet_s, ping_s=settings.ping_s, pings=settings.pings)
        self._turn = WorkScheduler(self._flush)
        self._scope: asyncio.Timeout | None = None
        self._heard = False
        self._gone: str | None = None
        self._login_at: float | None = None
        self._lost_at: float | None = None
        self._goodbye_at: float | None = None
        """When to delete the session even if not everything has been acknowledged; None: nothing is waited for."""
        self._close_at: float | None = None
        self._pong: PingAnswer | None = None
        self._offset: TimeSynchronised | None = None
        self.session = self._new_session()

    @property
    def is_open(self) -> bool:
        """Whether objects and samples may be queued in the session now."""
        return self.state is ConnectionState.CONNECTED and self._close_at is None

    async def run(self) -> None:
        """Serve link and session until `close` or cancellation.

        Raises:
            LinkDown: the link broke before it ever carried anything; later failures are retried.
        """
        loop = asyncio.get_running_loop()
        self._turn.start(loop)
        self.link.attach(
            packet=self._packet_received, signal=self._signal_received, room=lambda _peer: self._turn.schedule()
        )
        self._login(loop.time())
        try:
            # A time limit that `_finish` sets to "now": ends the link without a task of its own.
            async with asyncio.timeout(None) as self._scope:
                await self._serve(loop)
        except TimeoutError:
            if self._close_at is None:
                raise
        finally:
            self._turn.cancel()
            self._set_state(ConnectionState.CLOSED, "closed")

    async def connect(self, timeout_s: float | None) -> None:
        """Wait until the session is open."""
        words = f"no session on {self.link.info.name}"
        await self.news.until(lambda: self.state is ConnectionState.CONNECTED, timeout_s, words)

    async def close(self) -> None:
        """Delete the session at the agent and end `run`; waits until both are done."""
        self.close_soon()
        await self.news.until(lambda: not self._turn.is_running, None, "not closed")

    def close_soon(self, *, deliver_s: float = 0.0) -> None:
        """Start closing; `close` waits until it is done.

        The goodbye overtakes what has to be sent again. It is held back until the agent has acknowledged everything,
        but no longer than `deliver_s`.
        """
        if self._close_at is not None or not self._turn.is_running:
            return
        now = self._turn.now()
        self._close_at = now
        if self.state is ConnectionState.CONNECTED:
            self._close_at = now + deliver_s + self.settings.close_s
            self._goodbye_at = now + deliver_s
            if not deliver_s:
                self._say_goodbye(now)
        self._turn.schedule()

    def _say_goodbye(self, now: float) -> None:
        self._goodbye_at = None
        self._close_at = now + self.settings.close_s
        self.was_heard = self.session.is_delivered
        self.session.close(now)

    async def ping(self, timeout_s: float) -> PingAnswer:
        """Ask the agent whether it is there and knows us."""
        self._pong = None
        self._send_ping(self._turn.now())
        await self.news.until(lambda: self._pong is not None, timeout_s, "no answer to a ping")
        assert self._pong is not None
        return self._pong

    async def sync_time(self, timeout_s: float) -> TimeSynchronised:
        """Compare clocks with the agent."""
        self._offset = None
        self.session.sync_time()
        self._turn.schedule()
        await self.news.until(lambda: self._offset is not None, timeout_s, "no answer to a time request")
        assert self._offset is not None
        return self._offset

    def check_agent(self) -> None:
        """Ping at once, and log in again if the agent does not know us or does not answer."""
        self._watch.check(self._turn.now())
        self._turn.schedule()

    def lose(self, reason: str, now: float) -> None:
        """Give up the session and log in again."""
        self._lost_at = None
        self._watch.cancel()
        self._on_session_over()
        self._set_state(ConnectionState.LOST, reason)
        if self._goodbye_at is None:
            self._login(now)
            return
        self._goodbye_at, self._close_at = None, now  # there is nobody left to say goodbye to
        self._turn.schedule()

    def now(self) -> float:
        """The loop's time."""
        return self._turn.now()

    def schedule_send(self) -> None:
        """Something was queued in the session: send it in the next loop turn."""
        self._turn.schedule()

    async def _serve(self, loop: asyncio.AbstractEventLoop) -> None:
        while True:
            try:
                await self.link.run()
                reason = f"{self.link.info.name} has ended"
            except LinkDown as error:
                if not self._heard:
                    raise
                reason = str(error)
            self.lose(reason, loop.time())
            await asyncio.sleep(self.settings.reopen_s)

    def _new_session(self) -> ClientSession:
        settings = self.settings
        return ClientSession(
            self.key,
            session_id=settings.session_id + (self.counters.logins & 1),
            mtu=min(settings.mtu, self.link.info.mtu),
            settings=ClientSessionSettings(
                login_period_s=settings.login_period_s,
                login_tries=None,
                heartbeat_s=settings.heartbeat_s,
                heartbeat_min_s=settings.heartbeat_min_s,
                ids_by_rule=self.link.info.compresses,
                sparse_acknacks=self.link.info.sparse_acknacks,
                login_properties=_properties(settings) or None,
            ),
            epoch_ns=self._epoch_ns,
        )

    def _login(self, now: float) -> None:
        self._login_at = self._gone = None
        if self.state is ConnectionState.CONNECTING and self._lost_at is None:
            self._lost_at = now + self.settings.lost_after_s
        self.session = self._new_session()
        self.session.connect(now)
        self._turn.schedule()

    def _set_state(self, state: ConnectionState, reason: str) -> None:
        changed = state is not self.state
        self.state, self.reason = state, reason
        self.news.tell()
        if changed:
            _log.debug("client %08X is %s: %s", self.key, state.value, reason)
            self._on_state(state, reason)

    def _finish(self) -> None:
        if self._scope is not None:
            self._scope.reschedule(self._turn.now())
            self._scope = None

    def _packet_received(self, packet: bytes, _peer: Peer, now: float) -> None:
        self._heard = True
        try:
            self.session.receive_packet(packet, now)
        except RemoteProtocolError as error:
            self.counters.dropped += 1
            _log.debug("client %08X dropped a packet: %s", self.key, error)
            return
        if self.session.last_heard == now:
            # Also an ACKNACK or a HEARTBEAT: an agent that does not know the session answers nothing but pings.
            self._watch.agent_heard(now)
        is_data = self._take_events(now)
        if not is_data or packet[1] == STREAM_NONE or self.session.has_to_answer:
            # A sample asks for no other answer than an ACKNACK; whoever has something else to send says so.
            self._turn.schedule()

    def _take_events(self, now: float) -> bool:
        """Handle what has come; False: there was something else than samples."""
        session, is_data = self.session, True
        while session is self.session and (event := session.next_event()) is not None:
            match event:
                case DataReceived():
                    self._on_event(event, now)
                    self.news.tell()
                    continue
                case Pong():
                    self._pong_received(event, now)
                case TimeSynchronised():
                    self._offset = event
                case Connected():
                    self._connected(now)
                case SessionRestarted():
                    self.lose("the agent has started the session over: a late login has reached it", now)
                case ConnectFailed():
                    self._connect_failed(event, now)
                case SessionClosed():
                    self._close_at = now
                case _:
                    self._on_event(event, now)
            self.news.tell()
            is_data = False
        return is_data

    def _connected(self, now: float) -> None:
        self.counters.logins += 1
        self._lost_at = None
        self._watch.start(now)
        self._set_state(ConnectionState.CONNECTED, f"session open on {self.link.info.name}")

    def _pong_received(self, pong: Pong, now: float) -> None:
        self._pong = PingAnswer(pong.round_trip_s, pong.agent_knows_us)
        if not pong.agent_knows_us and self.state is ConnectionState.CONNECTED:
            self.lose("the agent does not know this session any more", now)

    def _connect_failed(self, failed: ConnectFailed, now: float) -> None:
        self._lost_at = None
        wait_s = failed.implementation_status / 10
        if failed.status == Status.ERR_RESOURCES and wait_s:
            # The agent is there, but many clients are joining at once: it says when our turn may be.
            self.reason = f"many join {self.link.info.name} at once: this one is asked to wait {wait_s:.1f} s"
            self._login_at = now + wait_s * self._random.uniform(1.0, 1.25)
            return
        words = "no answer" if failed.status is None else status_words(failed.status)
        self._set_state(ConnectionState.LOST, f"the agent refused the session: {words}")
        self._login_at = now + self.settings.reopen_s * self._random.uniform(0.75, 1.25)

    def _signal_received(self, signal: Signal, peer: Peer | None, reason: str, now: float) -> None:
        if signal in _GOES_DOWN:
            # Acted on in the next turn: a link that is closed because we are ending says so, too, and then there is no
            # next turn.
            self._gone = reason
            self._turn.schedule()
        elif signal in _COMES_UP and self.state is not ConnectionState.CONNECTED:
            self._login(now)
        self._on_signal(signal, peer, reason, now)

    def _send_ping(self, now: float) -> None:
        self.session.ping(now)
        self._turn.schedule()

    def _flush(self, now: float) -> None:
        """Once per loop turn, and when the timer says so: do what is due, send what is queued."""
        if self._close_at is not None and now >= self._close_at:
            self._finish()
            return
        if self._login_at is not None and now >= self._login_at:
            self._login(now)
        if self._lost_at is not None and now >= self._lost_at:
            self._lost_at = None
            self._set_state(ConnectionState.LOST, f"no agent answers on {self.link.info.name}")
        gone, self._gone = self._gone, None  # what was lost before there was a session says nothing of the next one
        if gone is not None and self.state is ConnectionState.CONNECTED:
            self.lose(gone, now)
        match self._watch.step(now):
            case WatchStep.PING:
                self._send_ping(now)
            case WatchStep.GIVE_UP:
                self.lose("the agent does not answer any more", now)
        if self._goodbye_at is not None and (now >= self._goodbye_at or self.session.is_delivered):
            self._say_goodbye(now)
        self.session.handle_timer(now)
        self._take_events(now)
        more_at = self._before_sending(now) if self.is_open else None
        self._send(now)
        if self._goodbye_at is not None and self.session.ask_for_delivery(now):
            self._send(now)
        self._turn.set_timer(
            self.session.timer(),
            more_at,
            self._watch.timer(),
            self._login_at,
            self._lost_at,
            self._goodbye_at,
            self._close_at,
        )

    def _send(self, now: float) -> None:
        # One packet at a time: what the link has no room for waits in the session, where it stays fresh.
        link = self.link
        peer = link.remote
        while peer is not None and link.has_room(peer):
            packets = self.session.packets_to_send(now, 1)
            if not packets:
                return
            try:
                link.send(packets[0], peer)
            except LinkError as error:
                self.counters.dropped += 1
                _log.debug("client %08X could not send: %s", self.key, error)
                return


def _properties(settings: ClientSettings) -> tuple[tuple[str, str], ...]:
    """What a login says of the client; nothing by default, as C clients do."""
    properties: list[tuple[str, str]] = []
    if settings.asks_again:
        properties.append((LoginProperty.ASKS_AGAIN, "1"))
    if settings.numbers_logins:  # no other login has it, now or before the program was restarted
        properties.append((LoginProperty.NUMBER, os.urandom(4).hex()))
    if not settings.echo:
        properties.append((LoginProperty.SHARED_MEMORY, "1"))
    return tuple(properties)
