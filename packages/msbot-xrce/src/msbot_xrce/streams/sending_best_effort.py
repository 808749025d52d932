"""The sending half of a stream without acknowledgement: numbering, and what shares a message."""

from __future__ import annotations

from msbot_xrce.messages.ids import KIND_MASK
from msbot_xrce.messages.submessage import Envelope, append_submessage
from msbot_xrce.streams.sequence_numbers import NOTHING_YET, StreamState, last_number
from msbot_xrce.streams.settings import SessionCounters
from msbot_xrce.streams.waiting_messages import (
    DATA,
    OBJECT_AT,
    PACKED_MAX,
    PADDING,
    REQUESTER,
    STATUS,
    Outbox,
    StreamQueue,
)

QUEUE_FULL = "best-effort message: queue full, oldest dropped"
TOO_LARGE = "unacknowledged message larger than the MTU"


class BestEffortOutput:
    """A stream without acknowledgement."""

    __slots__ = (
        "_capacity",
        "_counters",
        "_envelope",
        "_is_stock",
        "_lane",
        "_open",
        "_outbox",
        "_packed_max",
        "_sequence_nr",
        "_takes_more",
        "stream_id",
    )

    def __init__(
        self,
        stream_id: int,
        envelope: Envelope,
        outbox: Outbox,
        counters: SessionCounters,
        *,
        packs: bool = False,
        is_stock: bool = False,
    ) -> None:
        """`packs`: a submessage joins the message before it while that still waits; `is_stock`: as a stock client can
        read it."""
        self._packed_max = min(envelope.mtu, PACKED_MAX) if packs else 0
        self._is_stock = is_stock
        self._takes_more = True  # the newest message, if it waits
        self.stream_id = stream_id
        self._envelope = envelope
        self._capacity = envelope.capacity
        self._outbox = outbox
        self._counters = counters
        self._lane = StreamQueue(QUEUE_FULL)
        self._sequence_nr = NOTHING_YET
        self._open = b""

    @property
    def state(self) -> StreamState:
        """Its state, for people."""
        return StreamState(self.stream_id, outgoing=True, last=last_number(self._sequence_nr))

    @property
    def next_nr(self) -> int:
        """The sequence number of the message that is booked next."""
        return (self._sequence_nr + 1) & 0xFFFF

    def send(self, body: bytes) -> None:
        """Book one message; a body that does not fit is dropped and counted (XRCE has no fragments here)."""
        if len(body) > self._capacity:
            self._counters.dropped.count(TOO_LARGE)
            return
        items = self._outbox.items
        if self._packed_max:
            may_join = self._takes_more
            if self._is_stock:
                kind = body[0]
                if kind == DATA:
                    self._takes_more = body[OBJECT_AT] & KIND_MASK != REQUESTER
                else:
                    self._takes_more = kind != STATUS
                    may_join = may_join and kind != STATUS
            if may_join and items and items[-1] is self._lane:
                packets = self._lane.packets
                before = packets[-1]
                joined = before + PADDING[len(before) & 3] + body
                if len(joined) <= self._packed_max:
                    packets[-1] = joined
                    return
        nr = self._sequence_nr = (self._sequence_nr + 1) & 0xFFFF
        self._outbox.put_newest(self._envelope.seal(self.stream_id, nr, body), self._lane)

    def pack(self, body: bytes) -> None:
        """Add a submessage to the message that `flush` books; a full message is booked at once."""
        joined = append_submessage(self._open, body)
        if len(joined) <= self._capacity:
            self._open = joined
            return
        self.flush()
        self._open = body

    def flush(self) -> None:
        """Book what `pack` has collected."""
        if self._open:
            body, self._open = self._open, b""
            self.send(body)
