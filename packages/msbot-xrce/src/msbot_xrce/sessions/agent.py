"""The agent's end of a session: requests come in, statuses and samples go out (XRCE 1.0 §8.4).

The agent sends no padding behind the last submessage, as the genuine agent does. The owner must book the answers
to an event before it takes the next event; they then precede the ACKNACK.

DEVIATION: the genuine agent sends one submessage per message. Where the settings say so, samples and statuses of one
stream that are booked in one turn share messages up to the client's MTU, and nothing waits for another. Stock clients
get only what they take as they would take several messages (`msbot_xrce.streams.waiting_messages`).

DEVIATION: the genuine agent loses a STATUS when 16 messages are unacknowledged; here further ones wait, up to
`SessionSettings.backlog` of them.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import ClassVar

from msbot_xrce.messages.data import FORMAT_MASK
from msbot_xrce.messages.ids import (
    KIND_MASK,
    OBJECT_CLIENT,
    REQUEST_NONE,
    SESSION_NONE,
    STREAM_BEST_EFFORT,
    STREAM_NONE,
    STREAM_RELIABLE,
    ObjectKind,
    SubmessageId,
)
from msbot_xrce.messages.message import GetInfo, Info, ReadData, Timestamp, TimestampReply
from msbot_xrce.messages.objects import REPLACE, REUSE, read_create, write_status
from msbot_xrce.messages.submessage import LITTLE_ENDIAN, MTU_MIN, Envelope, kept_data_head, need
from msbot_xrce.sessions.events import (
    AgentEvent,
    CreateRequested,
    DataWritten,
    DeleteRequested,
    InfoRequested,
    MessagesGivenUp,
    ReadRequested,
    SessionDeleteRequested,
    SessionReset,
)
from msbot_xrce.sessions.session import OTHER_SESSION, Session, Take
from msbot_xrce.streams.settings import AgentSessionSettings, Memory

_IDS = struct.Struct(">HH")
# Plain ints: comparing with a member of an IntEnum costs several times as much, for every request.
_DATA_ID = SubmessageId.DATA.value
_CLIENT = ObjectKind.CLIENT.value
_MASK_CONFIGURATION = 1

NOT_DATA = "WRITE_DATA without ids, or in another format than DATA"
LOGIN_INSIDE = "CREATE_CLIENT inside of a session"
BACKLOG_FULL = "status: too many wait for the client's acknowledgement"


DataHandler = Callable[[int, int, bytes], None]
"""`(object_id, request_id, payload)`."""


class AgentSession(Session[AgentEvent]):
    """One client's session, sans I/O (see the module's docstring)."""

    __slots__ = ("_epoch_ns", "_on_data")

    _DATA_ID = SubmessageId.WRITE_DATA.value

    def __init__(
        self,
        client_key: int,
        session_id: int,
        mtu: int,
        *,
        epoch_ns: Callable[[], int],
        settings: AgentSessionSettings | None = None,
        memory: Memory | None = None,
        unacked: Memory | None = None,
        on_data: DataHandler | None = None,
    ) -> None:
        """Open the session that a CREATE_CLIENT asked for.

        Args:
            client_key: the one in the CREATE_CLIENT, not 0.
            session_id: the one in the CREATE_CLIENT; below 0x80 every header carries the key.
            mtu: largest message that the client accepts; below 24 it counts as 24 (such a client should be refused).
            epoch_ns: wall clock in nanoseconds since 1970, for time synchronisation.
            settings: windows, periods and limits.
            memory: bounds the incomplete messages that all sessions sharing it hold; call `release` at the end.
            unacked: the same for messages kept until they are acknowledged; when it is full, each stream goes on with
                one message at a time.
            on_data: called with `(object_id, request_id, payload)` for a sample that no undelivered event precedes,
                instead of the event DataWritten. It must not call `receive_packet`.
        """
        options = settings or AgentSessionSettings()
        super().__init__(client_key, session_id, mtu, options, pads=False, memory=memory, unacked=unacked)
        # The packet's owner was found by its address or its key; among ids from 0x80 up, the id itself is not compared
        # (seen on the wire).
        self._unquestioned = session_id if session_id >= SESSION_NONE else -1
        self._epoch_ns = epoch_ns
        self._on_data = on_data

    @property
    def is_stock(self) -> bool:
        """Whether the client reads as stock C clients do."""
        return self._settings.peer_is_stock

    def is_at_rest(self) -> bool:
        """Whether `packets_to_send` would give nothing now, and `timer` None."""
        sender = self._sender
        # As `SessionOutput.is_at_rest`, without a call: it is asked for every packet.
        if sender.outbox.items or sender.owed or self._asking.questions:
            return False
        for stream in sender.reliables.values():
            if stream.moved or stream.missed or stream.heartbeat_at is not None:
                return False
        return True

    def release(self) -> None:
        """The session is over: give back the memory that it shares with others, and forget the owner."""
        super().release()
        self._on_data = None

    def send_status(self, request_id: int, object_id: int, status: int, stream_id: int) -> None:
        """Answer a CREATE or DELETE that came on `stream_id`, or refuse a read (then use stream 0x80).

        Requests on a reliable stream are answered on 0x80, others on 0x01, and the deletion of the session on stream
        NONE (seen on the wire). While the window is full the status waits.
        """
        body = write_status(request_id, object_id, status)
        if object_id & KIND_MASK == _CLIENT:
            self._sender.answer(body)
        elif stream_id < STREAM_RELIABLE:
            self._sender.send_unacknowledged(body, STREAM_BEST_EFFORT)
        else:
            sender = self._sender
            stream = sender.reliables.get(STREAM_RELIABLE) or sender.reliable(STREAM_RELIABLE)
            if stream is None or not stream.send(body, self._settings.backlog):
                self.counters.dropped.count(BACKLOG_FULL)

    def send_info(self, request_id: int, object_id: int) -> None:
        """Answer a GET_INFO: the agent is here and knows the client."""
        self._sender.answer(Info(request_id, object_id, implementation_status=1).encode())

    def send_data(self, request_id: int, object_id: int, payload: bytes, stream_id: int) -> bool:
        """Book a sample for the READ_DATA `request_id`; False when the window is full: try again after `WindowOpened`.

        On a reliable stream, a sample that does not fit into one message is cut into fragments. On other streams it is
        dropped and counted, and the result is True: trying again would not help.
        """
        body = kept_data_head(_DATA_ID, request_id, object_id, len(payload)) + payload
        if stream_id < STREAM_RELIABLE:
            best_effort = self._sender.best_efforts.get(stream_id)
            if best_effort is not None:
                best_effort.send(body)
            else:
                self._sender.send_unacknowledged(body, stream_id)
            return True
        stream = self._sender.reliables.get(stream_id) or self._sender.reliable(stream_id)
        return True if stream is None else stream.offer(body)

    def probe(self) -> None:
        """Ask the client for a sign of life; any packet is one.

        The request id must be 0. C clients answer without a submessage header, so the request id is read as the kind of
        a submessage; 0 is a CREATE_CLIENT, which has no effect inside a session (seen on the wire).
        """
        self._sender.answer(GetInfo(REQUEST_NONE, OBJECT_CLIENT, _MASK_CONFIGURATION).encode())

    def relogin(self, mtu: int | None = None) -> None:
        """The client has logged in again with the same session id: all streams start over.

        DEVIATION: the genuine agent ignores the new `mtu`; a client that was rebuilt may accept less than before.
        """
        if mtu is None:
            self._restart_streams()
        else:
            self.mtu = max(mtu, MTU_MIN)
            self._restart_streams(Envelope(self.session_id, self.client_key, self.mtu, pads=False))

    def reset(self) -> None:
        """Start all streams over, as on RESET."""
        self._restart_streams()

    def _refusal(self, packet: bytes, stream_id: int) -> str | None:  # noqa: ARG002 - the client's end looks at it
        if self.session_id >= SESSION_NONE:
            return None if packet[0] >= SESSION_NONE else OTHER_SESSION
        return None if packet[0] < SESSION_NONE and packet[4:8] == self._key_octets else OTHER_SESSION

    def _take_data(self, packet: bytes, start: int, end: int, flags: int, stream_id: int) -> bool:  # noqa: ARG002
        if flags & FORMAT_MASK or end - start < 4:
            self.counters.dropped.count(NOT_DATA)
            return False
        request_id, object_id = _IDS.unpack_from(packet, start)
        if self._on_data is None or self.events:
            self.events.append(DataWritten(object_id, request_id, packet[start + 4 : end]))
        else:
            self._on_data(object_id, request_id, packet[start + 4 : end])
        return True

    def _given_up(self, stream_id: int, count: int) -> None:
        self.events.append(MessagesGivenUp(stream_id, count))

    # Each takes a submessage (`_OTHERS`).

    def _create(self, packet: bytes, start: int, end: int, flags: int, stream_id: int) -> bool:
        request_id, object_id, variant = read_create(packet, start, end, flags)
        self.events.append(
            CreateRequested(
                request_id,
                object_id,
                variant,
                flags & REUSE != 0,
                flags & REPLACE != 0,
                stream_id,
                flags & LITTLE_ENDIAN != 0,
            )
        )
        return True

    def _delete(self, packet: bytes, start: int, end: int, flags: int, stream_id: int) -> bool:  # noqa: ARG002
        need(start, end, 4)
        request_id, object_id = _IDS.unpack_from(packet, start)
        if object_id & KIND_MASK != _CLIENT:
            self.events.append(DeleteRequested(request_id, object_id, stream_id))
            return True
        if stream_id == STREAM_NONE:
            # After its end, an ACKNACK could be mistaken for one of the client's next session.
            self._sender.queue_due_acknacks(self.last_heard)
        self.events.append(SessionDeleteRequested(request_id, object_id))
        return True

    def _read(self, packet: bytes, start: int, end: int, flags: int, stream_id: int) -> bool:  # noqa: ARG002
        read = ReadData.decode(packet, start, end, flags)
        self.events.append(ReadRequested(read.request_id, read.object_id, read))
        return True

    def _get_info(self, packet: bytes, start: int, end: int, flags: int, stream_id: int) -> bool:  # noqa: ARG002
        info = GetInfo.decode(packet, start, end, flags)
        self.events.append(InfoRequested(info.request_id, info.object_id, info.mask))
        return True

    def _timestamp(self, packet: bytes, start: int, end: int, flags: int, stream_id: int) -> bool:  # noqa: ARG002
        receive_ns = self._epoch_ns()
        originate_ns = Timestamp.decode(packet, start, end, flags).transmit_ns
        reply = TimestampReply(self._epoch_ns(), receive_ns, originate_ns)
        self._sender.send_unacknowledged(reply.encode(), STREAM_NONE)
        return True

    def _reset_all(self, packet: bytes, start: int, end: int, flags: int, stream_id: int) -> bool:  # noqa: ARG002
        self._restart_streams()
        self.events.append(SessionReset())
        return True

    def _login_inside(self, packet: bytes, start: int, end: int, flags: int, stream_id: int) -> bool:  # noqa: ARG002
        if end > start:
            self.counters.dropped.count(LOGIN_INSIDE)
        return False

    _OTHERS: ClassVar[dict[int, Take]] = {
        SubmessageId.CREATE_CLIENT.value: _login_inside,
        SubmessageId.CREATE.value: _create,
        SubmessageId.GET_INFO.value: _get_info,
        SubmessageId.DELETE.value: _delete,
        SubmessageId.READ_DATA.value: _read,
        SubmessageId.RESET.value: _reset_all,
        SubmessageId.TIMESTAMP.value: _timestamp,
    }
    """What a client may ask for."""
