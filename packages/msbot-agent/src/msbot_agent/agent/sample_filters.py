"""Which of a topic's samples concern a client, and what precedes them (eProsima's `SampleIdentity`)."""

from __future__ import annotations

from collections.abc import Callable

from msbot_agent.agent.pending_requests import UNASKED, PendingRequests, encode_identity
from msbot_agent.space import Guid, Sample


class RequestShape:
    """For repliers: the request's identity in front of its body."""

    is_filter = False

    def wants(self, sample: Sample) -> bool:  # noqa: ARG002 - the protocol's signature
        """Every request."""
        return True

    def payload(self, sample: Sample) -> bytes:
        """24 octets identity, then the body."""
        return encode_identity(sample.writer, sample.sequence_nr) + sample.payload

    def sent(self, sample: Sample) -> None:
        """Nothing to remember: the replier gives the identity back."""


class ReplyShape:
    """For requesters: replies to own open requests only, with the client's request id in front.

    A replier may also speak unasked to a requester it knows (the inventory tells a part that its configuration has
    changed); such a message has request id 0, which no request has.
    """

    is_filter = True

    def __init__(self, object_id: int, pending: PendingRequests) -> None:
        self._object_octets = object_id.to_bytes(2, "big")
        self._pending = pending
        self.guid: Guid | None = None
        """GUID of the writer that carries the requests now."""

    def wants(self, sample: Sample) -> bool:
        """Whether the sample answers an open request of this requester, or is an unsolicited message to it."""
        related = sample.related
        if related is None or related[0] != self.guid:
            return False
        return related[1] == UNASKED or self._pending.request_id(related[1]) is not None

    def payload(self, sample: Sample) -> bytes:
        """Request id and object id (a BaseObjectRequest), then the body; only for a wanted sample."""
        request_id = self._pending.request_id(sample.related[1]) if sample.related is not None else None
        return (request_id or 0).to_bytes(2, "big") + self._object_octets + sample.payload

    def sent(self, sample: Sample) -> None:
        """Close the request."""
        if sample.related is not None:
            self._pending.answered(sample.related[1])


class NoEchoShape:
    """For clients that see their own samples by other means (`uxr_sm`): only the samples of others."""

    is_filter = True

    def __init__(self, is_own: Callable[[Guid], bool]) -> None:
        self._is_own = is_own

    def wants(self, sample: Sample) -> bool:
        """Whether somebody else wrote it."""
        return not self._is_own(sample.writer)

    def payload(self, sample: Sample) -> bytes:
        """The payload as it is."""
        return sample.payload

    def sent(self, sample: Sample) -> None:
        """Nothing to remember."""
