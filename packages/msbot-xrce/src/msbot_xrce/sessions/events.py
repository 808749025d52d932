"""The events that a session reports to its owner, in the order in which they happened.

There is one event for every message, so events are plain classes with slots. They are never changed once handed over.
"""

from __future__ import annotations

from msbot_xrce.lazy import dataclass
from msbot_xrce.messages.ids import OBJECT_CLIENT, STREAM_NONE
from msbot_xrce.messages.message import ObjectVariant, ReadData


@dataclass(slots=True)
class CreateRequested:
    """The client wants an object (XRCE 1.0 §8.3.5.2); answer with `send_status` on the same stream."""

    request_id: int
    object_id: int
    variant: ObjectVariant
    reuse: bool
    replace: bool
    stream_id: int
    little_endian: bool
    """Byte order of the variant's binary representation."""


@dataclass(slots=True)
class DeleteRequested:
    """The client wants an object gone; answer with `send_status` on the same stream."""

    request_id: int
    object_id: int
    stream_id: int


@dataclass(slots=True)
class SessionDeleteRequested:
    """The client leaves; answer with `send_status(request_id, object_id, ...)`, which uses stream NONE by itself."""

    request_id: int
    object_id: int = OBJECT_CLIENT
    stream_id: int = STREAM_NONE


@dataclass(slots=True)
class ReadRequested:
    """The client wants samples of a reader, requester or replier: answer with DATA, or with a status on stream 0x80."""

    request_id: int
    object_id: int
    read: ReadData
    """The whole request: the stream for the samples, the delivery control, the filter."""


@dataclass(slots=True)
class DataWritten:
    """The client has written a sample; never answered."""

    object_id: int
    request_id: int
    payload: bytes


@dataclass(slots=True)
class InfoRequested:
    """The client asks who we are (a ping); answer with `send_info`."""

    request_id: int
    object_id: int
    mask: int


@dataclass(slots=True)
class SessionReset:
    """The client has started its streams over (RESET); objects and reads stay."""


@dataclass(slots=True)
class WindowOpened:
    """A stream that had no room has room again."""

    stream_id: int


@dataclass(slots=True)
class MessagesGivenUp:
    """Messages of a reliable stream will never come: the client has lost them, and goes on without."""

    stream_id: int
    count: int


AgentEvent = (
    CreateRequested
    | MessagesGivenUp
    | DeleteRequested
    | SessionDeleteRequested
    | ReadRequested
    | DataWritten
    | InfoRequested
    | SessionReset
    | WindowOpened
)


@dataclass(slots=True)
class Connected:
    """The agent has opened the session. Objects from an earlier one may still be there: create them with REUSE."""


@dataclass(slots=True)
class SessionRestarted:
    """The agent has restarted the open session although it was not asked to: connect again.

    A late or duplicated login has reached it. Its streams now begin at 0 and ours do not, so samples would be mistaken
    for repetitions and lost without a trace.
    """


@dataclass(slots=True)
class ConnectFailed:
    """There is no session: the agent refused, or did not answer any try."""

    status: int | None = None
    """The agent's status octet; None = no answer."""
    implementation_status: int = 0
    """The octet after the status; each agent gives it a meaning of its own."""


@dataclass(slots=True)
class StatusReceived:
    """The agent's answer to CREATE or DELETE, or its refusal of a read."""

    request_id: int
    object_id: int
    status: int
    """Status octet; below 0x80 is success."""


@dataclass(slots=True)
class DataReceived:
    """A sample for a read request."""

    request_id: int
    """The request id of the read."""
    object_id: int
    payload: bytes
    stream_id: int


@dataclass(slots=True)
class Pong:
    """The agent answers a ping."""

    agent_knows_us: bool
    """Whether it has a session for this client; if not, the client must connect again."""
    round_trip_s: float = 0.0
    """Time since the last ping was booked."""


@dataclass(slots=True)
class TimeSynchronised:
    """The agent's clock was measured; agent time = own time - offset."""

    offset_ns: int
    round_trip_ns: int


@dataclass(slots=True)
class SessionClosed:
    """The session has ended on this side."""

    confirmed: bool = True
    """Whether the agent said so; False: it did not answer any try."""


ClientEvent = (
    Connected
    | SessionRestarted
    | ConnectFailed
    | StatusReceived
    | DataReceived
    | Pong
    | TimeSynchronised
    | SessionClosed
    | WindowOpened
)
