"""The one hook by which plug-and-play decides what a client may do; the agent itself knows no parts.

The agent asks once per endpoint and remembers the answer until `Agent.recheck(client_key)` is called, so the gate is
never in the path of a sample.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from msbot_agent.link import Peer
from msbot_xrce.errors import RemoteProtocolError
from msbot_xrce.lazy import dataclass
from msbot_xrce.messages import CreateClient, decode_header, first_submessage


@dataclass(frozen=True, slots=True)
class ClientInfo:
    """The client that is asking."""

    key: int
    """The agent's key for the session (never 0): the client key it presents, or one of the agent's own if that is in
    use."""
    link: str
    """Name of the link the client speaks on (`LinkInfo.name`)."""
    peer: Peer
    address: str
    """The peer in words."""
    shown_key: int = 0
    """The client key that the XRCE session presents, if it is not `key`."""
    patience_s: float = 0.12
    """How long another client on its link may take to answer a probe."""

    @property
    def client_key(self) -> int:
        """The client key that the XRCE session presents."""
        return self.shown_key or self.key


class SampleGuard(Protocol):
    """Opens sealed samples from one client, and seals samples for it."""

    def covers(self, topic: str) -> bool:
        """Whether the samples of a requester or replier are sealed, by the topic that it writes."""

    def open(self, object_id: int, sample: bytes) -> bytes | None:
        """The sample that the client gave to its object with that id; None: it is not from the client, or not
        new."""

    def seal(self, object_id: int, sample: bytes) -> bytes:
        """The sealed sample for the client's object with that id."""


ReplyIfUnserved = Callable[[int | None], bytes | None]
"""The reply to a request that reaches nobody now; None: the request goes its way. It is told how many would read the
request in the data space; None: nobody can know."""


class Gate(Protocol):
    """Who may join, write and read."""

    def may_join(self, client: ClientInfo) -> bool:
        """Whether a session may be opened; False answers STATUS_ERR_DENIED."""

    def keeps(self, client: ClientInfo) -> bool:
        """Whether a login with that client's key from another address leaves its session alone (`stale_sessions`). If
        not, the last login owns the key, wherever it came from, and packets with it are accepted from anywhere."""

    def is_settled(self, client: ClientInfo) -> bool:
        """Whether the client has a place that no stranger may take: its session is never ended to make room."""

    def limits(self, client: ClientInfo, packets_per_s: float, share: float) -> bool:
        """Whether to limit a client that sends more than its share of packets to that share; asked again while it does
        (`msbot_agent.agent.fair_share`)."""

    def limits_strangers(self) -> bool:
        """Whether packets outside of sessions get a bounded part of the agent's time
        (`msbot_agent.agent.fair_share`)."""

    def joined(self, client: ClientInfo) -> None:
        """A session was opened or opened again (also from another address): earlier grants are void."""

    def session_ended(self, client: ClientInfo, reason: str) -> None:
        """The session has ended; `reason` in words ("session deleted", "replaced", "silent", ...)."""

    def is_latched(self, topic: str) -> bool:
        """Whether readers get the topic's last sample at once, even if they ask for no durability."""

    def may_write(self, client: ClientInfo, topic: str) -> bool:
        """Whether samples of this client may enter the topic."""

    def may_read(self, client: ClientInfo, topic: str) -> bool:
        """Whether samples of the topic may go to this client."""

    def guard_of(self, client: ClientInfo) -> SampleGuard | None:
        """What seals and opens the samples of this client; None: they are not sealed."""

    def reply_if_unserved(self, client: ClientInfo, topic: str) -> ReplyIfUnserved | None:
        """What to ask, before each request of this client on the topic, for a reply in place of one that will not come.

        None: there is never one, so the requests wait for a reply of their own, as at a stock agent.
        """


class OpenGate:
    """Lets everybody do everything: an agent without a blueprint."""

    def may_join(self, client: ClientInfo) -> bool:  # noqa: ARG002 - the protocol's signature
        """Always True."""
        return True

    def keeps(self, client: ClientInfo) -> bool:  # noqa: ARG002 - the protocol's signature
        """Always False, as in eProsima's agent."""
        return False

    def is_settled(self, client: ClientInfo) -> bool:  # noqa: ARG002 - the protocol's signature
        """Always True: without a blueprint nobody is a stranger."""
        return True

    def limits(self, client: ClientInfo, packets_per_s: float, share: float) -> bool:  # noqa: ARG002 - the protocol's
        """Always False: clients may send as fast as they can."""
        return False

    def limits_strangers(self) -> bool:
        """Always False: as quick as it can."""
        return False

    def joined(self, client: ClientInfo) -> None:
        """Nothing to remember."""

    def session_ended(self, client: ClientInfo, reason: str) -> None:
        """Nothing to forget."""

    def is_latched(self, topic: str) -> bool:  # noqa: ARG002 - the protocol's signature
        """Always False: the rules of DDS."""
        return False

    def may_write(self, client: ClientInfo, topic: str) -> bool:  # noqa: ARG002 - the protocol's signature
        """Always True."""
        return True

    def may_read(self, client: ClientInfo, topic: str) -> bool:  # noqa: ARG002 - the protocol's signature
        """Always True."""
        return True

    def guard_of(self, client: ClientInfo) -> SampleGuard | None:  # noqa: ARG002 - the protocol's signature
        """Always None."""
        return None

    def reply_if_unserved(self, client: ClientInfo, topic: str) -> ReplyIfUnserved | None:  # noqa: ARG002 - the protocol's
        """Always None: replies come from repliers."""
        return None


# Whose a packet is that comes from an address nobody knows: a login, or a packet with the key in its header.


def client_key_in(packet: bytes) -> int | None:
    """The client key that a packet shows; None: it shows none, as packets inside most sessions, or is broken."""
    try:
        header = decode_header(packet)
        if header.client_key:
            return header.client_key
        first = first_submessage(packet, header.size)
    except RemoteProtocolError:
        return None
    return first.client_key if isinstance(first, CreateClient) else None
