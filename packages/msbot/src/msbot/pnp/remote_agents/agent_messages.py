"""What an agent and the master that feeds its gate say to each other. Pure.

The agent is a client of the master: what it says are requests of the service `msbot_agents`, what the master says are
replies, asked for or not. One octet tells which message follows, in CDR. Everything may be said twice and may be lost:
either side repeats what the other has not confirmed.

==================  ==========================================  =====================================================
from the agent      means                                       answered by
==================  ==========================================  =====================================================
`AgentHello`             it introduces itself, until it is welcome   `AgentWelcome`, `AgentRefused`
`SessionOpen`       a client has opened a session               `Rights`, again with each change of them
`SessionOver`       a session has ended                         `Forgotten`
`Ask`               a part asks the inventory something         `Answer`, or silence
`AgentBeat`         it is alive; STOP said on its links         `MasterHeard`, and the `Rights` of one session in turn;
                                                                `WhoIsThat` to a stranger
`Sign`              how long ago a client was heard             nothing
`Remark`            something about a part for the journal      nothing
==================  ==========================================  =====================================================

Unasked the master also says `Sought` (is that client alive?), `Close` (end its session), `Held` (why a part may use
nothing now) before `Rights` without topics, and `MasterHeard` with each STOP.
"""

from __future__ import annotations

from typing import Annotated, Final

from msbot.part import Message
from msbot.part.messages.wire_types import AtMost, Octets, uint8, uint16, uint32, uint64
from msbot_xrce.errors import LocalProtocolError, RemoteProtocolError

SERVICE: Final = "msbot_agents"
REQUEST_TYPE: Final = "msbot_agents_request"
REPLY_TYPE: Final = "msbot_agents_reply"

VERSION: Final = 1
IDENTITY_OCTETS: Final = 24
MOST_OCTETS: Final = 65_536
"""Longest request or answer of a part that is passed on."""
MOST_TOPICS: Final = 240
MOST_TEXT: Final = 200
"""Octets of a text; longer ones are cut off."""

Text = Annotated[str, AtMost(254)]


class AgentHello(Message):
    """The agent introduces itself, with every beat until it is welcome."""

    boot: uint64
    """Drawn at its start."""
    name: Text
    version: uint16 = VERSION


class SessionOpen(Message):
    """A client has opened a session, or opened it again; said until the master's `Rights` show that it has heard."""

    number: uint32
    """The agent's number for the session, never used again."""
    times: uint32
    """How often it was opened."""
    client_key: uint32
    """The key that the client shows."""
    reads_profile: uint8
    """1 once it has asked for the robot's profile (step 1)."""
    address: Text
    """Where the client is, in words."""


class SessionOver(Message):
    """A session has ended; said until the master has forgotten it."""

    number: uint32
    reason: Text


class Ask(Message):
    """A part asks the inventory."""

    number: uint32
    compat: uint8
    """1 = in the layout of the thesis' own programs."""
    identity: Annotated[bytes, Octets(IDENTITY_OCTETS)]
    body: Annotated[bytes, AtMost(MOST_OCTETS)]


class AgentBeat(Message):
    """The agent is alive."""

    count: uint32
    stops_said: uint32
    """Which STOP somebody said on its links, counted from 1; 0 = none that the master has not confirmed."""
    words: Text
    """Why, for the latest."""


class Sign(Message):
    """The answer to `Sought`: how long ago the client was heard."""

    number: uint32
    silent_ms: uint32


class Remark(Message):
    """Something about the part behind a session, for its history and the journal."""

    number: uint32
    words: Text


class AgentWelcome(Message):
    """The master takes the agent, and says which robot this is."""

    boot: uint64
    robot: Text
    version: Text
    serial_number: Text
    released: Text
    manufacturer: Text


class AgentRefused(Message):
    """The master does not take the agent."""

    reason: Text


class OpenTopic(Message):
    """A topic or a service that a client may use."""

    topic: Text
    topic_type: Text
    """Of a service `Request -> Reply`."""
    publishes: uint8
    """1 = it may write there, 0 = it may read; of a service 1 = it serves, 0 = it calls."""
    reliable: uint8


class Rights(Message):
    """The verdict on a session: what it may do from now on. It confirms `SessionOpen`."""

    number: uint32
    times: uint32
    reads_profile: uint8
    settled: uint8
    """1 = it holds a slot."""
    topics: Annotated[list[OpenTopic], AtMost(MOST_TOPICS)]


class Forgotten(Message):
    """Nobody at the master knows that session any more."""

    number: uint32


class Answer(Message):
    """What the inventory says to a part."""

    number: uint32
    compat: uint8
    identity: Annotated[bytes, Octets(IDENTITY_OCTETS)]
    body: Annotated[bytes, AtMost(MOST_OCTETS)]


class MasterHeard(Message):
    """The master is alive, and this is how STOP stands."""

    count: uint32
    """Of the beat that it answers; 0 = none."""
    stop: uint32
    """Number of the latest STOP; 0 = there was none."""
    holds: uint8
    """1 = nobody has said GO yet."""
    stops_confirmed: uint32
    """Which STOP of the agent's links the master has taken up."""


class WhoIsThat(Message):
    """The master does not know the agent: it has to introduce itself, and to say again which sessions there are."""

    version: uint16 = VERSION


class Sought(Message):
    """Is that client alive?"""

    number: uint32


class Close(Message):
    """End that session."""

    number: uint32
    reason: Text


class Held(Message):
    """Why that part may use nothing for a while, as its pupil is held; `Rights` with topics end it.

    An agent that does not know this message lets the calls of the part end with their timeouts.
    """

    number: uint32
    why: Text


FromAgent = AgentHello | SessionOpen | SessionOver | Ask | AgentBeat | Sign | Remark
FromMaster = AgentWelcome | AgentRefused | Rights | Forgotten | Answer | MasterHeard | WhoIsThat | Sought | Close | Held

_FROM_AGENT: Final[tuple[type[Message], ...]] = (AgentHello, SessionOpen, SessionOver, Ask, AgentBeat, Sign, Remark)
_FROM_MASTER: Final[tuple[type[Message], ...]] = (
    AgentWelcome, AgentRefused, Rights, Forgotten, Answer, MasterHeard, WhoIsThat, Sought, Close, Held
)  # fmt: skip
_FIRST_FROM_MASTER: Final = 16
_NUMBER: Final = {kind: number for number, kind in enumerate(_FROM_AGENT, 1)} | {
    kind: number for number, kind in enumerate(_FROM_MASTER, _FIRST_FROM_MASTER)
}
_KIND: Final = {number: kind for kind, number in _NUMBER.items()}


def encode(message: FromAgent | FromMaster) -> bytes:
    """The octets of a message.

    Raises:
        LocalProtocolError: a text or list in it is too long.
    """
    return bytes((_NUMBER[type(message)],)) + message.encode()


def decode_from_agent(octets: bytes) -> FromAgent:
    """What an agent says.

    Raises:
        RemoteProtocolError: it is no such message.
    """
    return _decode(octets, from_master=False)  # type: ignore[return-value] # its numbers are those of that side


def decode_from_master(octets: bytes) -> FromMaster:
    """What the master says.

    Raises:
        RemoteProtocolError: it is no such message.
    """
    return _decode(octets, from_master=True)  # type: ignore[return-value] # its numbers are those of that side


def _decode(octets: bytes, *, from_master: bool) -> Message:
    kind = _KIND.get(octets[0]) if octets else None
    if kind is None or (octets[0] >= _FIRST_FROM_MASTER) is not from_master:
        raise RemoteProtocolError(f"message {octets[:1].hex() or 'without octets'} between agent and master")
    return kind.decode(octets[1:])


def short(text: str) -> str:
    """A text that fits into a message: cut off where it is too long, without characters that CDR cannot carry."""
    octets = text.replace("\0", " ").encode(errors="replace")
    if len(octets) <= MOST_TEXT:
        return octets.decode()
    return octets[: MOST_TEXT - 3].decode(errors="ignore") + "…"


def is_sendable(message: FromAgent | FromMaster) -> bytes | None:
    """The octets of a message; None: a text or list in it is too long."""
    try:
        return encode(message)
    except LocalProtocolError:
        return None
