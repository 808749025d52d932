"""The client's end of a session: log in, create objects, write, read, ask whether the agent is there (XRCE 1.0 §8.4).

Theory of operation. A login or logout is repeated until it is answered or the tries are used up. Requests and samples
booked in one turn of the owner are packed into as few messages as possible, which `packets_to_send` finishes.

Several answers to a repeated login: see `DuplicateLoginCheck`.

::

    IDLE ──connect──> CONNECTING ──answered──> CONNECTED ──close──> CLOSING ──answered, or not──> CLOSED
                          │  └──close──────────────────────────────────┘
                          └──refused, or not answered──> FAILED        any state ──connect──> CONNECTING
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from enum import Enum
from typing import ClassVar

from msbot_xrce.errors import LinkFull, LocalProtocolError
from msbot_xrce.messages.data import FORMAT_MASK
from msbot_xrce.messages.ids import (
    FIRST_REQUEST,
    FIRST_RULED_REQUEST,
    OBJECT_AGENT,
    OBJECT_CLIENT,
    REQUEST_LOGOUT,
    REQUEST_PING,
    SESSION_DEFAULT,
    SESSION_NONE,
    SESSION_NONE_KEYED,
    STREAM_NONE,
    STREAM_RELIABLE,
    Status,
    SubmessageId,
    read_request_id,
    write_request_id,
)
from msbot_xrce.messages.message import (
    Create,
    CreateClient,
    Delete,
    DeliveryControl,
    GetInfo,
    Header,
    Heartbeat,
    Info,
    ObjectVariant,
    ReadData,
    StatusAgent,
    StatusReply,
    TimestampReply,
    encode_message,
)
from msbot_xrce.messages.submessage import data_submessage
from msbot_xrce.sessions.duplicate_login_check import DuplicateLoginCheck
from msbot_xrce.sessions.events import (
    ClientEvent,
    Connected,
    ConnectFailed,
    DataReceived,
    Pong,
    SessionClosed,
    SessionRestarted,
    StatusReceived,
)
from msbot_xrce.sessions.session import OTHER_SESSION, Session, Take
from msbot_xrce.sessions.time_sync import ClockComparison
from msbot_xrce.streams.round_trip import Retries
from msbot_xrce.streams.settings import ClientSessionSettings

# The states of a client's session; the docstring of `client.py` draws the transitions.


class ClientState(Enum):
    """The state of a client's session."""

    IDLE = "not connected yet"
    CONNECTING = "waiting for the agent's answer to the login"
    CONNECTED = "open"
    CLOSING = "waiting for the agent's answer to the logout"
    CLOSED = "closed"
    FAILED = "the agent refused, or did not answer"


OPEN_STATES = (ClientState.CONNECTED, ClientState.CLOSING)
"""States in which the agent has a session for the client."""


_IDS = struct.Struct(">HH")
_WRITE_DATA_ID = SubmessageId.WRITE_DATA.value
_MASK_ACTIVITY = 2
_MTU_RESERVE = 4
"""C clients announce, and themselves use, 4 bytes less than the transport allows (seen on the wire: 508 of 512)."""

NOT_DATA = "DATA without ids, or in another format than DATA"
NOT_OPEN = "message while the session is not open"
NOT_ASKED = "answer that nobody asked for"


class ClientSession(Session[ClientEvent]):
    """One session with an agent, sans I/O."""

    _DATA_ID = SubmessageId.DATA.value

    def __init__(
        self,
        client_key: int,
        *,
        session_id: int = SESSION_DEFAULT,
        mtu: int = 512,
        settings: ClientSessionSettings | None = None,
        epoch_ns: Callable[[], int],
    ) -> None:
        """Prepare a session; `connect` opens it.

        Args:
            client_key: 32 bits, unique among the clients of an agent, not 0.
            session_id: 0x81 as in all stock clients; below 0x80 every header carries the key.
            mtu: largest packet in bytes that the link accepts.
            epoch_ns: wall clock in nanoseconds since 1970, for time synchronisation.
            settings: windows, periods and limits.
        """
        self._options = options = settings or ClientSessionSettings()
        super().__init__(client_key, session_id, mtu - _MTU_RESERVE, options, pads=options.pads)
        self._clocks = ClockComparison(epoch_ns)
        self._state = ClientState.IDLE
        self._retries = Retries(options.login_period_s, options.login_tries)
        self._sent_before = 0
        self._doubt = DuplicateLoginCheck(self._sender)
        self._request_id = FIRST_REQUEST - 1
        self._pinged_at = 0.0
        self._outside = Header(
            SESSION_NONE if session_id >= SESSION_NONE else SESSION_NONE_KEYED, client_key=client_key
        )
        login = CreateClient(client_key, session_id, self.mtu, options.login_properties)
        self._login = encode_message(self._outside, [login], pad_end=False)
        self._logout = Delete(REQUEST_LOGOUT, OBJECT_CLIENT).encode()

    @property
    def state(self) -> ClientState:
        """Where the session stands."""
        return self._state

    def connect(self, now: float) -> None:
        """Log in, or log in again; ends with Connected or ConnectFailed.

        Everything that was booked or is unacknowledged is forgotten.
        """
        self._restart_streams()
        self._begin(ClientState.CONNECTING, now)

    def close(self, now: float) -> None:
        """Delete the session at the agent; ends with SessionClosed. What the window has room for is sent first.

        Raises:
            LocalProtocolError: there is no session to close.
        """
        if self._state not in (ClientState.CONNECTING, ClientState.CONNECTED):
            raise LocalProtocolError(f"close: the session is {self._state.name}, there is nothing to close")
        self._sender.flush()
        self._begin(ClientState.CLOSING, now)

    def create(
        self,
        object_id: int,
        variant: ObjectVariant,
        *,
        reuse: bool = True,
        replace: bool = True,
        stream_id: int = STREAM_RELIABLE,
    ) -> int:
        """Ask for an object; returns the request id that StatusReceived will carry.

        Raises:
            LocalProtocolError: the session is not open, or too many requests wait.
        """
        self._need_open("create")
        request_id = self._next_request_id()
        return self._ask(Create(request_id, object_id, variant, reuse, replace).encode(), stream_id, request_id)

    def delete(self, object_id: int, stream_id: int = STREAM_RELIABLE) -> int:
        """Ask to delete an object; returns the request id that StatusReceived will carry.

        Raises:
            LocalProtocolError: the session is not open, or too many requests wait.
        """
        self._need_open("delete")
        request_id = self._next_request_id()
        return self._ask(Delete(request_id, object_id).encode(), stream_id, request_id)

    def read(
        self,
        object_id: int,
        stream_id: int,
        control: DeliveryControl | None = None,
        *,
        request_stream: int = STREAM_RELIABLE,
    ) -> int:
        """Ask for samples on `stream_id`; returns the request id that DataReceived will carry.

        No control means one sample; `max_samples` 0 ends a read.

        Raises:
            LocalProtocolError: the session is not open, or too many requests wait.
        """
        self._need_open("read")
        request_id = read_request_id(object_id) if self._options.ids_by_rule else self._next_request_id()
        return self._ask(ReadData(request_id, object_id, stream_id, control).encode(), request_stream, request_id)

    def write(self, object_id: int, payload: bytes, stream_id: int) -> int:
        """Write a sample, a request or a reply; returns the request id.

        On a reliable stream, a payload too large for one message is cut.

        Raises:
            LinkFull: the window is full; try again after WindowOpened.
            LocalProtocolError: the session is not open, or the payload does not fit into one message of a best-effort
                stream.
        """
        self._need_open("write")
        if not self.has_room(stream_id):
            raise LinkFull(f"stream 0x{stream_id:02X} is full: try again when its window has opened")
        sequence_nr = self._sender.finish_message(stream_id) if self._options.ids_by_rule else None
        ruled = None if sequence_nr is None else write_request_id(stream_id, sequence_nr)
        request_id = self._next_request_id() if ruled is None else ruled
        self._sender.pack(data_submessage(_WRITE_DATA_ID, request_id, object_id, payload), stream_id)
        if ruled is not None:
            # Nothing may be packed behind it: the next submessage would need a longer form.
            self._sender.finish_message(stream_id)
        return request_id

    def ping(self, now: float) -> None:
        """Ask the agent whether it is there and knows us, in any state; answered by Pong."""
        self._pinged_at = now
        question = GetInfo(REQUEST_PING, OBJECT_AGENT, _MASK_ACTIVITY)
        if self._state in OPEN_STATES:
            self._sender.answer(question.encode())
        else:
            self._sender.put_answer(encode_message(self._outside, [question], pad_end=False))

    def sync_time(self) -> None:
        """Compare clocks with the agent; answered by TimeSynchronised.

        Raises:
            LocalProtocolError: the session is not open.
        """
        self._need_open("sync_time")
        self._sender.answer(self._clocks.ask().encode())

    def packets_to_send(self, now: float, limit: int | None = None) -> list[bytes]:
        """The next messages for the link, all or at most `limit`; they count as sent.

        Booked submessages are made into messages first. Pull no more than the link accepts now: the wait for
        acknowledgements begins when nothing is left, and samples that wait here can still be replaced by newer ones.
        """
        self._sender.flush()
        return self._sender.pull(now, limit)

    def timer(self) -> float | None:
        """When to call `handle_timer`; changes with every other call."""
        times = (super().timer(), self._retries.next_at, self._doubt.ask_at)
        return min((at for at in times if at is not None), default=None)

    def handle_timer(self, now: float) -> None:
        """Book what is due by now; afterwards call `next_event` until it returns None."""
        super().handle_timer(now)
        if self._doubt.ask_at is not None and now >= self._doubt.ask_at:
            self._doubt.ask(now)
        if self._retries.next_at is None or now < self._retries.next_at:
            return
        if not self._retries.take(now):
            self._give_up()
        elif self._sender.is_idle:
            # Otherwise the link has not even accepted the last one, and another would only wait behind it.
            self._ask_again()

    # Trying, until there is an answer.

    def _begin(self, state: ClientState, now: float) -> None:
        self._state = state
        self._doubt.end()
        self._retries.begin(now)
        self._ask_again()

    def _ask_again(self) -> None:
        if self._state is ClientState.CONNECTING:
            self._sender.put_answer(self._login)
        else:
            self._sender.answer(self._logout)

    def _give_up(self) -> None:
        if self._state is ClientState.CONNECTING:
            self._end(ClientState.FAILED, ConnectFailed())
        else:
            self._end(ClientState.CLOSED, SessionClosed(confirmed=False))

    def _end(self, state: ClientState, event: ClientEvent) -> None:
        self._state = state
        self._doubt.end()
        self._retries.end()
        self._restart_streams()
        self.events.append(event)

    # Booking.

    def _need_open(self, verb: str) -> None:
        if self._state is not ClientState.CONNECTED:
            raise LocalProtocolError(f"{verb}: the session is {self._state.name}, connect first")

    def _next_request_id(self) -> int:
        last = FIRST_RULED_REQUEST - 1 if self._options.ids_by_rule else 0xFFFF
        self._request_id = self._request_id + 1 if self._request_id < last else FIRST_REQUEST
        return self._request_id

    def _ask(self, body: bytes, stream_id: int, request_id: int) -> int:
        if self._sender.waiting(stream_id) >= self._options.backlog:
            raise LocalProtocolError(f"{self._options.backlog} messages wait for the agent's acknowledgement already")
        self._sender.pack(body, stream_id)
        return request_id

    # Receiving.

    def _refusal(self, packet: bytes, stream_id: int) -> str | None:
        is_outside = stream_id == STREAM_NONE and packet[0] == self._outside.session_id
        if packet[0] != self.session_id and not is_outside:
            return OTHER_SESSION
        if stream_id != STREAM_NONE and self._state not in OPEN_STATES:
            return NOT_OPEN
        return OTHER_SESSION if packet[0] < SESSION_NONE and packet[4:8] != self._key_octets else None

    def _take_acknack(self, first: int, bitmap: int, stream_id: int) -> None:
        if self._state not in OPEN_STATES:
            self.counters.dropped.count(NOT_OPEN)
            return
        if stream_id == STREAM_RELIABLE and self._doubt.has_restarted(first):
            self.events.append(SessionRestarted())
        super()._take_acknack(first, bitmap, stream_id)

    def _take_heartbeat(self, heartbeat: Heartbeat, carrier_id: int) -> None:
        if self._state in OPEN_STATES:
            super()._take_heartbeat(heartbeat, carrier_id)
        else:
            self.counters.dropped.count(NOT_OPEN)

    def _take_data(self, packet: bytes, start: int, end: int, flags: int, stream_id: int) -> bool:
        if flags & FORMAT_MASK or end - start < 4:
            self.counters.dropped.count(NOT_DATA)
            return False
        if stream_id == STREAM_NONE and self._state not in OPEN_STATES:
            self.counters.dropped.count(NOT_OPEN)
            return False
        request_id, object_id = _IDS.unpack_from(packet, start)
        self.events.append(DataReceived(request_id, object_id, packet[start + 4 : end], stream_id))
        return True

    # Each takes a submessage (`_OTHERS`).

    def _status(self, packet: bytes, start: int, end: int, flags: int, stream_id: int) -> bool:
        reply = StatusReply.decode(packet, start, end, flags)
        if stream_id != STREAM_NONE:
            self.events.append(StatusReceived(reply.request_id, reply.object_id, reply.status))
        elif self._state is ClientState.CLOSING and reply.request_id == REQUEST_LOGOUT:
            self._end(ClientState.CLOSED, SessionClosed())
        else:
            self.counters.dropped.count(NOT_ASKED)
        return True

    def _status_agent(self, packet: bytes, start: int, end: int, flags: int, stream_id: int) -> bool:
        if stream_id == STREAM_NONE:
            self._take_login_answer(StatusAgent.decode(packet, start, end, flags))
        return True

    def _info(self, packet: bytes, start: int, end: int, flags: int, stream_id: int) -> bool:  # noqa: ARG002
        info = Info.decode(packet, start, end, flags)
        if info.request_id != REQUEST_PING or info.availability is None or info.availability <= 0:
            self.counters.dropped.count(NOT_ASKED)
        else:
            self.events.append(Pong(info.implementation_status == 1, self.last_heard - self._pinged_at))
        return True

    def _get_info(self, packet: bytes, start: int, end: int, flags: int, stream_id: int) -> bool:  # noqa: ARG002
        question = GetInfo.decode(packet, start, end, flags)
        self._sender.answer(Info(question.request_id, question.object_id, has_agent=False, availability=None).encode())
        return True

    def _time(self, packet: bytes, start: int, end: int, flags: int, stream_id: int) -> bool:  # noqa: ARG002
        if (compared := self._clocks.take(TimestampReply.decode(packet, start, end, flags))) is None:
            self.counters.dropped.count(NOT_ASKED)
        else:
            self.events.append(compared)
        return True

    _OTHERS: ClassVar[dict[int, Take]] = {
        SubmessageId.STATUS.value: _status,
        SubmessageId.STATUS_AGENT.value: _status_agent,
        SubmessageId.INFO.value: _info,
        SubmessageId.GET_INFO.value: _get_info,
        SubmessageId.TIMESTAMP_REPLY.value: _time,
    }
    """What an agent may say."""

    def _take_login_answer(self, answer: StatusAgent) -> None:
        if self._state is ClientState.CONNECTING:
            if answer.status >= Status.ERR_DDS_ERROR:
                self._end(ClientState.FAILED, ConnectFailed(answer.status, answer.implementation_status))
                return
            self._state = ClientState.CONNECTED
            self._retries.end()
            self._doubt.begin(answer.status)
            self._sent_before = self.counters.packets_out
            self._request_id = FIRST_REQUEST - 1
            self._restart_streams()
            self.events.append(Connected())
        elif self._state is ClientState.CONNECTED and not self._doubt.is_ruled_out(answer.status):
            self._take_further_answer()
        else:
            self.counters.dropped.count(NOT_ASKED)

    def _take_further_answer(self) -> None:
        doubt = self._doubt
        is_explained = doubt.is_explained(self._retries.count)
        if not is_explained:
            self.counters.dropped.count(NOT_ASKED)
        elif not (doubt.has_sent and (doubt.has_arrived or self.has_taken_in_order)):
            self._restart_input()
        if doubt.has_sent:
            doubt.ask(self.last_heard)
        elif not is_explained and self.counters.packets_out > self._sent_before:
            self.events.append(SessionRestarted())
