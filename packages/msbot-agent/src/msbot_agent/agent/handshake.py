"""Messages outside a session: logging in, asking for an agent, deleting a session that is gone.

Only the first submessage of such a message counts, and only these three are answered (seen on the wire). A
CREATE_CLIENT inside a session is ignored.

DEVIATION: a network may copy a login, and the copy come when the session is in use. Between stock peers it starts the
streams over. A part in Python numbers its logins (`LoginProperty.NUMBER`), so that a copy is known for one.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Hashable
from dataclasses import replace
from functools import lru_cache

from msbot_agent.agent.agent_settings import MIN_MTU, AgentSettings
from msbot_agent.agent.client_table import ClientTable, ServedLink
from msbot_agent.agent.fair_share import BEYOND_OUTSIDE, SessionlessLimiter
from msbot_agent.agent.gate import ClientInfo, Gate
from msbot_agent.agent.join_queue import JoinQueue
from msbot_agent.agent.proxy import Proxy
from msbot_agent.agent.stale_sessions import (
    DOUBLE_LOGIN_PATIENCE_S,
    PATIENCE_ON_A_BUS_S,
    KeyConflicts,
    StaleSessionProbe,
    StrangerBudget,
)
from msbot_agent.link import Link, Peer
from msbot_agent.text.sentence import said
from msbot_xrce import Status
from msbot_xrce.errors import RemoteProtocolError
from msbot_xrce.messages import (
    COOKIE,
    SESSION_NONE,
    SESSION_NONE_KEYED,
    STREAM_NONE,
    CreateClient,
    Delete,
    GetInfo,
    Header,
    Info,
    LoginProperty,
    ObjectKind,
    StatusAgent,
    StatusReply,
    decode_header,
    encode_message,
    first_submessage,
    kind_of,
)

logger = logging.getLogger(__name__)

RECENT_LOGINS = 4
"""How many logins of a client are remembered by their numbers."""
LONGEST_NUMBER = 8
"""In octets; a longer number is none."""
_OK = Status.OK  # a name of the module: to read the member from its class takes ten times as long
LATE_LOGIN = "login that came late: its client has logged in again since"

_MIN_DEAD_AFTER_S = 0.1
_MAX_DEAD_AFTER_S = 3600.0
"""A client silent for an hour is probed, whatever it asked for; C clients ask for at most 1000 s."""

OpenSession = Callable[[ClientInfo, ServedLink, CreateClient, float], Proxy]
EndSession = Callable[[Proxy, str], None]


class Handshake:
    """Answers messages outside of a session and applies the rules of logging in (XRCE 1.0 §8.4.3)."""

    def __init__(
        self,
        clients: ClientTable,
        gate: Gate,
        settings: AgentSettings,
        *,
        budget: StrangerBudget,
        rivals: KeyConflicts,
        predecessors: StaleSessionProbe,
        queue: JoinQueue,
        open_session: OpenSession,
        end_session: EndSession,
    ) -> None:
        self._clients = clients
        self._gate = gate
        self._settings = settings
        self._budget = budget
        self._rivals = rivals
        self._predecessors = predecessors
        self._queue = queue
        self._open_session = open_session
        self._end_session = end_session
        self._strangers = SessionlessLimiter(settings.max_outside_per_s)
        self._settled = SessionlessLimiter(settings.max_outside_per_s)

    def answer(self, port: ServedLink, packet: bytes, peer: Peer, now: float) -> bytes | None:
        """The one answer to a packet that belongs to no session, or None for silence."""
        port.outside += 1
        if self._gate.limits_strangers() and not self._takes(port, peer, now):
            return None
        try:
            header = decode_header(packet)
            submessage = first_submessage(packet, header.size)
        except RemoteProtocolError:
            port.dropped.count("packet that cannot be read")
            return None
        match submessage:
            case CreateClient() if header.session_id in (SESSION_NONE, SESSION_NONE_KEYED):
                number = login_number(submessage)
                known = self._heard_before(port, peer, submessage, number)
                if known is not None:
                    return self._answer_again(port, header, submessage, is_latest=known.logins[0] == number)
                status = _check(submessage)
                info = _info_of(port.link, peer, submessage.client_key)
                if status is _OK and (wait_s := self._wait_s(port, info, now)):
                    port.dropped.count("login put off: many join at once")
                    return _come_back(header, submessage, wait_s)
                status = self._log_in(port, info, submessage, status, now, number)
                return _status_agent(header, submessage, status)
            case GetInfo():
                # A client that asks with a session id other than its present one is unknown, so that it logs in again.
                is_outside = header.session_id in (SESSION_NONE, SESSION_NONE_KEYED)
                return _info(header, submessage, is_known=is_outside and peer in port.clients)
            case Delete() if kind_of(submessage.object_id) == ObjectKind.CLIENT:
                return _deleted(header, submessage)
        port.dropped.count("packet without a session")
        return None

    def _takes(self, port: ServedLink, peer: Peer, now: float) -> bool:
        """Whether there is time for a packet of that peer; what is thrown away is counted, and told now and then."""
        link, owner = port.link, port.clients.get(peer)
        is_settled = owner is not None and self._gate.is_settled(owner.info)
        share, origin = (self._settled, peer) if is_settled else (self._strangers, link.origin(peer))
        if share.takes((link.info.name, origin), peer, now):
            return True
        port.dropped.count(BEYOND_OUTSIDE)
        if share.is_news(now):
            logger.warning(
                "%s: more packets outside of sessions than %g a second, now from %s: the rest is not read",
                link.info.name,
                self._settings.max_outside_per_s,
                link.describe(peer),
            )
        return False

    def _wait_s(self, port: ServedLink, info: ClientInfo, now: float) -> float:
        """How long this login has to wait for its turn; 0 for a client that has a session, or needs no turn."""
        if port.batch is not None or self._clients.sharing(info.client_key) or self._gate.is_settled(info):
            return 0.0
        return self._queue.wait_s((info.link, info.peer), (info.link, port.link.origin(info.peer)), now)

    def _heard_before(self, port: ServedLink, peer: Peer, request: CreateClient, number: str) -> Proxy | None:
        """The session whose client has sent this very login before, told by its number; None: it is a new one."""
        known = port.clients.get(peer)
        if known is None or known.gone is not None or known.info.client_key != request.client_key:
            return None
        return known if number in known.logins else None

    def _answer_again(
        self, port: ServedLink, header: Header, request: CreateClient, *, is_latest: bool
    ) -> bytes | None:
        """The answer to a copy of a login. To start the streams over once more would lose what is on its way."""
        if is_latest:
            return _status_agent(header, request, Status.OK_MATCHED)
        port.dropped.count(LATE_LOGIN)
        return None

    def _log_in(  # noqa: PLR0917 - what is known of the login
        self, port: ServedLink, info: ClientInfo, request: CreateClient, status: Status, now: float, number: str
    ) -> Status:
        peer = info.peer
        owner = port.clients.get(peer)
        if owner is not None and owner.info.client_key != request.client_key:
            self._end_session(owner, said("another client logged in from its address"))
        if status is not _OK:
            return status
        link = port.link
        if not self._gate.may_join(info):
            return Status.ERR_DENIED
        sharing = self._clients.sharing(request.client_key)
        known = self._session_of(sharing, port, peer) if sharing else None
        others = sharing if known is None else ()
        key = self._clients.free_key(info.key) if known is None else known.info.key
        if key != info.key:
            info = replace(info, key=key)
        logins = () if known is None else known.logins
        if known is not None and known.session.session_id == request.session_id:
            known.log_in_again(info, min(request.mtu, link.info.mtu), now)
        else:
            if known is not None:
                self._end_session(known, said("replaced by a new session of the same key"))
            elif others:
                self._rivals.make_room(request.client_key)
            origin = (link.info.name, link.origin(peer))
            if not self._make_room(origin, now):
                return Status.ERR_RESOURCES
            known = self._open_session(info, port, request, now)
            self._budget.add(known, origin)
            if port.batch is None and not self._gate.is_settled(info):
                self._queue.enter(known, origin, now)
            if others:
                self._rivals.begin(known, others, origin, now)
        known.logins = (number, *logins[: RECENT_LOGINS - 1]) if number else ()
        self._clients.place(known, port, peer)
        self._predecessors.begin(known, port, peer, now)
        self._gate.joined(info)
        known.recheck()
        known.pull()
        logger.info("client %08X logged in from %s on %s", info.key, info.address, info.link)
        return _OK

    def _session_of(self, sharing: tuple[Proxy, ...], port: ServedLink, peer: Peer) -> Proxy | None:
        """The session that a login refers to: the one with its key at its address, one whose peer has gone, or any that
        may be moved; None: it begins a new one."""
        for proxy in sharing:
            if proxy.place == (port, peer):
                return proxy
        return next((proxy for proxy in sharing if proxy.gone is not None or not self._gate.keeps(proxy.info)), None)

    def _make_room(self, origin: Hashable, now: float) -> bool:
        """End the session that must go before another one is opened from there; False when none may go."""
        stranger = self._budget.who_makes_room(origin)
        if stranger is not None:
            self._end_session(stranger, said("made room for a newcomer: too many clients that hold no place"))
        if len(self._clients) < self._settings.max_clients:
            return True
        forgotten = self._budget.who_is_forgotten(self._clients, now)
        if forgotten is None:
            return False
        self._end_session(forgotten, said("made room for a newcomer: too many clients"))
        return True


def dead_after_s(request: CreateClient, default_s: float) -> float:
    """The silence after which the client is probed: its `uxr_hl`, or the default when that is absent or not a
    number."""
    if not request.properties:
        return default_s
    text = dict(request.properties).get(LoginProperty.HARD_LIVELINESS, "")
    if not (text.isascii() and text.isdigit() and len(text) <= 9):
        return default_s
    return min(max(int(text) / 1000, _MIN_DEAD_AFTER_S), _MAX_DEAD_AFTER_S)


def wants_echo(request: CreateClient) -> bool:
    """Whether the client wants to receive the samples it published itself."""
    return not request.properties or dict(request.properties).get(LoginProperty.SHARED_MEMORY) != "1"


def _info_of(link: Link, peer: Peer, client_key: int) -> ClientInfo:
    """The client that logs in, as long as nobody else has its key."""
    about = link.info
    patience_s = PATIENCE_ON_A_BUS_S if about.shared_bus else DOUBLE_LOGIN_PATIENCE_S
    return ClientInfo(client_key, about.name, peer, link.describe(peer), client_key, patience_s)


def _check(request: CreateClient) -> Status:
    if request.client_key == 0 or request.cookie != COOKIE:
        return Status.ERR_INVALID_DATA
    if request.version[0] != 1:
        return Status.ERR_INCOMPATIBLE
    if request.mtu < MIN_MTU:
        # DEVIATION: with 8 octets or less the genuine agent never finishes its first STATUS.
        return Status.ERR_INVALID_DATA
    return _OK


def login_number(request: CreateClient) -> str:
    """What tells this login from the client's others; empty: nothing, as in logins of C clients."""
    if not request.properties:
        return ""
    number = dict(request.properties).get(LoginProperty.NUMBER, "")
    return number if len(number) <= LONGEST_NUMBER else ""


def _come_back(header: Header, request: CreateClient, wait_s: float) -> bytes | None:
    """Stock clients give up when they are refused. So they get no answer, and repeat the login."""
    if dict(request.properties or ()).get(LoginProperty.ASKS_AGAIN) != "1":
        return None
    tenths = min(255, math.ceil(wait_s * 10))
    return _status_agent(header, request, Status.ERR_RESOURCES, tenths)


def _status_agent(header: Header, request: CreateClient, status: Status, tenths: int = 0) -> bytes:
    answer = Header(request.session_id, header.stream_id, header.sequence_nr, request.client_key)
    return answer.encode() + _agent_says(status, tenths)


@lru_cache(64)
def _agent_says(status: Status, tenths: int) -> bytes:
    return StatusAgent(status, tenths).encode()


def _info(header: Header, request: GetInfo, *, is_known: bool) -> bytes:
    answer = Header(header.session_id, STREAM_NONE, 0, header.client_key)
    info = Info(request.request_id, request.object_id, implementation_status=int(is_known))
    return encode_message(answer, [info], pad_end=False)


def _deleted(header: Header, request: Delete) -> bytes:
    answer = Header(header.session_id, STREAM_NONE, 0, header.client_key)
    status = StatusReply(request.request_id, request.object_id, Status.OK)
    return encode_message(answer, [status], pad_end=False)
