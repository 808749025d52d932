"""One client inside the agent: its session, its objects, and what the gate lets it do."""

from __future__ import annotations

import logging
import math
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

from msbot_agent.agent.client_views import LARGEST_TO_STOCK, drop_too_large, tell_of_lost, view_of
from msbot_agent.agent.endpoints import NoEchoShape
from msbot_agent.agent.fair_share import Limit
from msbot_agent.agent.gate import ClientInfo, ReplyIfUnserved, SampleGuard
from msbot_agent.agent.object_tree import ObjectTree
from msbot_agent.agent.reply_routing import client_key_of, make_guid
from msbot_agent.agent.shared_state import SharedAgentState
from msbot_agent.agent.statistics import PUSHED_OUT, ClientView, SessionFaultCounts, TopicTraffic
from msbot_agent.agent.topic_attachment import ReadSide, Shape
from msbot_agent.link import Peer
from msbot_agent.space import Guid
from msbot_xrce import AgentSession, Status
from msbot_xrce.counting import Tally
from msbot_xrce.errors import RemoteProtocolError
from msbot_xrce.messages import STREAM_RELIABLE, ObjectKind, kind_of
from msbot_xrce.sessions import (
    AgentEvent,
    CreateRequested,
    DataHandler,
    DataWritten,
    DeleteRequested,
    InfoRequested,
    MessagesGivenUp,
    ReadRequested,
    SessionDeleteRequested,
    SessionReset,
    WindowOpened,
)

if TYPE_CHECKING:
    from msbot_agent.agent.client_table import ServedLink

logger = logging.getLogger(__name__)

# Names of the module: to read a member of an IntEnum from its class takes ten times as long.
_OK = Status.OK
_DATA = (ObjectKind.DATAREADER.value, ObjectKind.DATAWRITER.value)

PUT_OFF_S, LONGEST_PUT_OFF_S, NEW_S = 0.02, 0.5, 10.0
"""For so long at a time, and in all, a client is asked for nothing while its answer may lie unread in a socket; and for
so long after its login. Later, a flood must not make it wait for what it lacks."""


class OpenSession(Protocol):
    """Opens the session that the client asked for."""

    def __call__(self, *, on_data: DataHandler) -> AgentSession: ...


class Proxy:
    """Acts for one client in the data space. Satisfies `EndpointHost`."""

    __slots__ = (
        "__weakref__",
        "_asks_at",
        "_dead_after_s",
        "_endpoints",
        "_gate",
        "_gone_at",
        "_guard",
        "_opened_at",
        "_probes",
        "_settings",
        "_surroundings",
        "_timed",
        "_tree",
        "_turn",
        "bytes_in",
        "bytes_out",
        "clock",
        "dropped",
        "gone",
        "info",
        "is_blocked",
        "is_marked",
        "is_over",
        "is_timed",
        "key",
        "limit",
        "logins",
        "max_requests",
        "outbox",
        "own_filter",
        "place",
        "refused",
        "replies",
        "session",
        "space",
        "transit",
    )

    def __init__(
        self,
        info: ClientInfo,
        open_session: OpenSession,
        surroundings: SharedAgentState,
        now: float,
        *,
        dead_after_s: float,
        echo: bool = True,
    ) -> None:
        """`echo=False` keeps the client's own samples from it (property `uxr_sm`)."""
        settings = surroundings.settings
        self.info = info
        self.key = info.key
        self.session = open_session(on_data=self._write)
        self.space = surroundings.space
        self.replies = surroundings.replies
        self.transit = surroundings.transit
        self.clock = surroundings.clock
        self.max_requests = settings.max_requests
        self.own_filter: Shape | None = None if echo else NoEchoShape(self._is_own)
        self.place: tuple[ServedLink, Peer] | None = None
        """Where its packets go, kept by the table of clients; None if it has gone or was removed."""
        self.outbox: list[bytes] = []
        """Packets pulled out of the session for which the link had no room."""
        self.is_blocked = False
        """Whether the link has no room: samples then wait in the readers' histories."""
        self.is_marked = False
        """Whether the server will flush this client at the end of the turn."""
        self.is_timed = False
        """Whether the server has a time at which it wakes this client; kept by the server."""
        self.is_over = False
        """Whether the session has ended: deleted by the client, or given up by the agent."""
        self.gone: str | None = None
        """Why the client has gone, in the link's words, while it may still come back."""
        self.logins: tuple[str, ...] = ()
        """The numbers of its latest logins, newest first; none for clients that number none."""
        self.limit: Limit | None = None
        """Its limit, while it sends more than its share; see `msbot_agent.agent.fair_share`."""
        self.bytes_in = self.bytes_out = 0
        self._surroundings = surroundings
        self._settings = settings
        self._gate = surroundings.gate
        self._guard: SampleGuard | None = None
        self._dead_after_s = dead_after_s
        self._probes = 0
        self._opened_at = self._gone_at = now
        self._timed: dict[ReadSide, float] = {}
        self._asks_at = 0.0  # until then the session asks for nothing
        self._turn = 0
        self.dropped = Tally()
        """What was not done for this client, by reason in words."""
        self.refused = Tally()
        """Samples that the gate kept out, by topic."""
        self._tree = ObjectTree(settings, surroundings.budget, surroundings.references, surroundings.creator)
        self._endpoints = self._tree.endpoints

    # What the server calls.

    def receive(self, packet: bytes, now: float) -> None:
        """Take one packet from the client; the answers are ready when this returns."""
        self.bytes_in += len(packet)
        session = self.session
        try:
            has_news = session.receive_packet(packet, now)
        except RemoteProtocolError:
            self.dropped.count("packet with a broken header")
            return
        if has_news:
            events, handlers = session.events, self._HANDLERS
            try:
                for event in events:
                    handlers[type(event)](self, event)
            finally:
                events.clear()
        # A packet that calls for no answer, such as an ACKNACK, is over here.
        if not self.is_marked:
            if self.is_over or not self.is_at_rest():
                self._surroundings.mark(self)
            elif self.is_timed:
                self._surroundings.rest(self)

    def is_at_rest(self) -> bool:
        """Whether there is nothing to send for it, and no time to wait for."""
        return not (self.outbox or self.is_blocked or self._timed) and self.session.is_at_rest()

    def timer(self) -> float | None:
        """When to call `handle_timer`, or None."""
        when = self.session.timer()
        if when is not None and when < self._asks_at:
            when = self._asks_at
        if not self._timed:
            return when
        limit = min(self._timed.values())
        return limit if when is None or limit < when else when

    def put_off_asking(self, now: float) -> float | None:
        """Ask a new client for nothing yet, because its answer may lie unread in a socket, unless that has been done
        for long; returns when to call `handle_timer`."""
        due = self.session.timer()
        if due is not None and due <= now < min(due + LONGEST_PUT_OFF_S, self._opened_at + NEW_S):
            self._asks_at = now + PUT_OFF_S
        return self.timer()

    def handle_timer(self, now: float) -> None:
        """Let the session resend what is due, and release samples that a byte rate or a pace held back."""
        if now >= self._asks_at:
            self.session.handle_timer(now)
        for side in [side for side, when in self._timed.items() if when <= now]:
            del self._timed[side]
            side.pull()
        self._surroundings.mark(self)

    @property
    def dead_after_s(self) -> float:
        """The silence after which the client is probed; infinite = never."""
        limit_s = math.inf if self.is_settled() else self._settings.unsettled_dead_after_s
        return min(self._dead_after_s, limit_s)

    @property
    def packets_in(self) -> int:
        """Packets that its session has taken."""
        return self.session.counters.packets_in

    @property
    def last_heard(self) -> float:
        """When the client was last heard, in its session or logging in."""
        return max(self.session.last_heard, self._opened_at)

    def next_life_check(self, now: float) -> float | None:
        """Probe a silent client; returns when to look again, or None when it is gone for good."""
        if self.gone is not None:
            kept_s = self.dead_after_s if self.dead_after_s < math.inf else self._settings.gone_after_s
            kept_until = self._gone_at + kept_s
            return kept_until if now < kept_until else None
        silent_until = self.last_heard + self.dead_after_s
        if now < silent_until:
            self._probes = 0
            return silent_until
        if self._probes >= self._settings.probes:
            return None
        self._probes += 1
        self.probe()
        return now + self._settings.probe_period_s

    def probe(self) -> None:
        """Ask the client for a sign of life."""
        self.session.probe()
        self._surroundings.mark(self)

    def log_in_again(self, info: ClientInfo, mtu: int, now: float) -> None:
        """Log the client in again: it has lost its streams, not its objects, and may have another address now."""
        self.info = info
        self.gone = None
        self.session.relogin(mtu)
        while self.session.next_event() is not None:
            # It tells which streams have room again; the server lets the samples go anyway, and nothing may pile up.
            continue
        self.outbox.clear()
        self._opened_at = now
        self._probes = 0

    def leave(self, reason: str, now: float) -> None:
        """Note that the link saw the client go: its objects are kept as long as those of a silent client."""
        self.gone = reason
        self._gone_at = now
        self.outbox.clear()

    def come_back(self) -> None:
        """Note that the link sees the client again at its old address: its session goes on."""
        self.gone = None
        self._probes = 0
        self._surroundings.mark(self)

    def recheck(self) -> None:
        """Ask the gate for every endpoint and attach or detach it."""
        self._guard = self._gate.guard_of(self.info)
        for endpoint in list(self._endpoints.values()):
            endpoint.recheck()

    def pull(self, limit: int | None = None) -> int:
        """Take samples that wait in the readers, in turns, as far as their streams have room; returns how many.

        The caller knows that the link has room, so this works even while `is_blocked`.
        """
        if not (sides := [one for end in self._endpoints.values() if (one := end.incoming) and one.is_waiting]):
            return 0
        blocked, self.is_blocked = self.is_blocked, False
        self._turn += 1
        first = self._turn % len(sides)
        queue = deque(sides[first:] + sides[:first])
        taken = 0
        while queue and taken != limit:
            side = queue.popleft()
            if side.pull_one():
                taken += 1
                queue.append(side)
        self.is_blocked = blocked
        return taken

    def topics(self) -> dict[int, str]:
        """The topics of the endpoints, by object id."""
        return {object_id: endpoint.topic for object_id, endpoint in self._endpoints.items()}

    def close(self) -> None:
        """Leave the space with all objects."""
        self._tree.clear()
        self._timed.clear()
        self.session.release()

    def troubles(self) -> tuple[str, ...]:
        """Why its endpoints do not match others in the space, each sentence once."""
        return tuple(dict.fromkeys(trouble for _, entity in self._tree.items() for trouble in entity.troubles))

    def wear(self) -> SessionFaultCounts:
        """See `Agent.wear`."""
        readers = (side.reader for end in self._endpoints.values() if (side := end.incoming) is not None)
        unread = self.dropped.get(PUSHED_OUT, 0) + sum(one.lost for one in readers if one is not None)
        return SessionFaultCounts(self.session.counters.repeated, self.session.counters.resent, unread)

    def view(self, now: float) -> ClientView:
        """A view of the client, for people."""
        return view_of(self, self._tree, self._opened_at, now)

    # What the endpoints call (`EndpointHost`).

    def is_settled(self) -> bool:
        """The gate's verdict."""
        return self._gate.is_settled(self.info)

    def is_latched(self, topic: str) -> bool:
        """The gate's verdict."""
        return self._gate.is_latched(topic)

    def may_write(self, topic: str) -> bool:
        """The gate's verdict."""
        return self._gate.may_write(self.info, topic)

    def may_read(self, topic: str) -> bool:
        """The gate's verdict."""
        return self._gate.may_read(self.info, topic)

    def reply_if_unserved(self, topic: str) -> ReplyIfUnserved | None:
        """The gate's replies."""
        return self._gate.reply_if_unserved(self.info, topic)

    def new_guid(self, object_id: int) -> Guid:
        """A GUID never used before by this agent (until 65,536 writers later)."""
        return make_guid(self._surroundings.agent_id, self.info.key, object_id, next(self._surroundings.incarnations))

    def send_data(self, request_id: int, object_id: int, payload: bytes, stream_id: int) -> bool:
        """Book a DATA; False while the link or the stream has no room."""
        if self.is_blocked:
            return False
        if self._guard is not None and self._is_guarded(object_id):
            payload = self._guard.seal(object_id, payload)
        if len(payload) > LARGEST_TO_STOCK and self.session.is_stock:
            drop_too_large(self.info, object_id, len(payload), self.dropped)
            return True
        if not self.session.send_data(request_id, object_id, payload, stream_id):
            return False
        if not self.is_marked:
            self._surroundings.mark(self)
        return True

    def call_at(self, side: ReadSide, when: float) -> None:
        """Pull that side at `when`."""
        self._timed[side] = when
        self._surroundings.mark(self)

    def traffic_of(self, topic: str) -> TopicTraffic:
        """The counters of that topic."""
        return self._surroundings.topics.of(topic)

    # The rest.

    def _write(self, object_id: int, request_id: int, payload: bytes) -> None:
        if (endpoint := self._endpoints.get(object_id)) is None:
            self.dropped.count("WRITE_DATA for an unknown object")
        elif self._guard is None or not self._is_guarded(object_id):
            endpoint.write(request_id, payload)
        elif (sample := self._guard.open(object_id, payload)) is None:
            self.dropped.count("sample without a good seal")
        else:
            endpoint.write(request_id, sample)

    def _is_guarded(self, object_id: int) -> bool:
        """Whether the samples of an object are sealed: all but those of services that seal for themselves."""
        assert self._guard is not None
        if kind_of(object_id) in _DATA:
            return True
        endpoint = self._endpoints.get(object_id)
        return endpoint is not None and self._guard.covers(endpoint.topic)

    def _take_late(self, event: DataWritten) -> None:
        self._write(event.object_id, event.request_id, event.payload)

    def _create(self, event: CreateRequested) -> None:
        status = self._tree.create(self, event)
        self.session.send_status(event.request_id, event.object_id, status, event.stream_id)

    def _delete(self, event: DeleteRequested) -> None:
        status = self._tree.delete(self, event.object_id)
        self.session.send_status(event.request_id, event.object_id, status, event.stream_id)

    def _answer_ping(self, event: InfoRequested) -> None:
        self.session.send_info(event.request_id, event.object_id)

    def _end(self, event: SessionDeleteRequested) -> None:
        self.session.send_status(event.request_id, event.object_id, _OK, event.stream_id)
        self._tree.clear()
        self.session.events.clear()
        self.is_over = True

    def _streams_begin_anew(self, event: SessionReset) -> None:
        # Packets that the link has not taken yet have numbers that the client will not expect.
        self.outbox.clear()
        self._go_on(event)

    def _go_on(self, event: WindowOpened | SessionReset) -> None:  # noqa: ARG002 - all streams take samples in turns
        if not self.is_blocked:
            self.pull()

    def _tell_of_lost(self, event: MessagesGivenUp) -> None:
        tell_of_lost(self.info, event.stream_id, event.count, self.session.dropped)

    def _read(self, event: ReadRequested) -> None:
        if (endpoint := self._endpoints.get(event.object_id)) is None or endpoint.incoming is None:
            self.session.send_status(event.request_id, event.object_id, Status.ERR_UNKNOWN_REFERENCE, STREAM_RELIABLE)
            return
        logger.debug(
            "client %08X reads %04X on stream %02X: %s",
            self.info.key,
            event.object_id,
            event.read.stream_id,
            endpoint.topic,
        )
        endpoint.incoming.start(event.request_id, event.read.stream_id, event.read.delivery)

    def _is_own(self, writer: Guid) -> bool:
        return writer[:8] == self._surroundings.agent_id and client_key_of(writer) == self.info.key

    _HANDLERS: ClassVar[dict[type[AgentEvent], Callable[[Any, Any], None]]] = {
        DataWritten: _take_late,
        CreateRequested: _create,
        DeleteRequested: _delete,
        ReadRequested: _read,
        InfoRequested: _answer_ping,
        SessionDeleteRequested: _end,
        SessionReset: _streams_begin_anew,
        WindowOpened: _go_on,
        MessagesGivenUp: _tell_of_lost,
    }
    """What is done about each event: `(proxy, event)`."""
