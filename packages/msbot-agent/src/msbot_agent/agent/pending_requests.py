"""Requests and replies: who asked, and which request a reply answers.

A requester writes its request into the request topic. The replier sees it with the request's identity in front
(24 octets: the writer's GUID and its sequence number) and puts the same identity in front of its reply; the agent
takes it off and writes the reply with the identity beside it. Every requester then sees every reply of the service
and takes those that answer a request of its own that is still open (XRCE of eProsima; `SampleIdentity` of DDS-RPC).
"""

from __future__ import annotations

from struct import Struct

from msbot_agent.space import Guid

IDENTITY_SIZE = 24
"""Octets of a sample identity: 16 GUID, int32 high and uint32 low part of the sequence number."""

UNASKED = 0
"""Not the number of any request: a reply with it goes to the requester although it answers nothing."""

_IDENTITY = Struct("<16siI")
_GUID = Struct(">8sIHH")
_KEY = Struct(">I")


def make_guid(agent_id: bytes, client_key: int, object_id: int, incarnation: int) -> Guid:
    """The GUID of a client's writer: 8 octets of the agent, 4 client key, 2 object id, 2 incarnation.

    The incarnation distinguishes a writer from its predecessor with the same object id, so that a late reply to a
    request of the old one never answers a request of the new one.
    """
    return _GUID.pack(agent_id, client_key, object_id, incarnation & 0xFFFF)


def client_key_of(guid: Guid) -> int:
    """The key of the client that owns the writer; meaningful only for writers that an agent made."""
    key: int = _KEY.unpack_from(guid, 8)[0]
    return key


def encode_identity(guid: Guid, sequence_nr: int) -> bytes:
    """The 24 octets that precede a request for a replier."""
    return _IDENTITY.pack(guid, sequence_nr >> 32, sequence_nr & 0xFFFFFFFF)


def decode_identity(data: bytes) -> tuple[Guid, int] | None:
    """The writer and sequence number in front of a reply, or None when there are fewer than 24 octets."""
    if len(data) < IDENTITY_SIZE:
        return None
    guid, high, low = _IDENTITY.unpack_from(data)
    return guid, (high << 32) | low


class PendingRequests:
    """The requests of one requester that have no reply yet: at most `limit`, each answered once."""

    __slots__ = ("_limit", "_open", "forgotten")

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._open: dict[int, int] = {}
        self.forgotten = 0
        """Requests given up because `limit` newer ones came."""

    def __len__(self) -> int:
        return len(self._open)

    def add(self, sequence_nr: int, request_id: int) -> None:
        """Remember that the sample with this number carried the client's request."""
        if len(self._open) >= self._limit:
            del self._open[next(iter(self._open))]
            self.forgotten += 1
        self._open[sequence_nr] = request_id

    def request_id(self, sequence_nr: int) -> int | None:
        """The client's request id of an open request, or None."""
        return self._open.get(sequence_nr)

    def answered(self, sequence_nr: int) -> None:
        """Close a request: later replies to it are dropped."""
        self._open.pop(sequence_nr, None)

    def clear(self) -> None:
        """Forget all requests; their replies are dropped."""
        self._open.clear()
