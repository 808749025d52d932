"""The sending half of a stream: numbering, the window, what is unacknowledged, and when to send it again.

Theory of operation. A submessage is booked (accepted for sending), becomes the body of a message (with others, if the
stream packs and the peer can read it, see `sharing_messages`), and that message gets its number when the window has
room. From then on the finished message is kept until an ACKNACK covers it, and is sent again, byte for byte, when an
ACKNACK reports it missing (XRCE 1.0 §8.4).

A submessage larger than a message is cut into FRAGMENTs as the window moves. The genuine agent puts all pieces on the
wire at once; here at most a window (16) of them is unacknowledged at any time. That is what one ACKNACK bitmap covers,
and C clients (history 4 to 16 and more) acknowledge every piece when they store it, so the rest follows at once. A
client whose history is smaller than the number of pieces cannot receive the submessage from any agent.

Storms. A receiver with a gap says so with every message that arrives, so one lost message causes many equal ACKNACKs.
The message is sent again only once for all of them: later requests count only after two round trips, or once a
HEARTBEAT has asked.

Statuses. A stock client that lacks a message takes the ones behind it in one go as soon as it comes, as if they were
one message. So once a client has lacked something, nothing is sent behind a STATUS before the client has it (see
`sharing_messages`).
"""

from __future__ import annotations

from msbot_xrce.messages.ids import KIND_MASK
from msbot_xrce.messages.message import Fragment, Heartbeat
from msbot_xrce.messages.submessage import HEADER_SIZE, Envelope, append_submessage
from msbot_xrce.streams.round_trip import RoundTrip
from msbot_xrce.streams.sequence_numbers import StreamState, last_number
from msbot_xrce.streams.settings import SPARSE_EVERY, SPARSE_HEARTBEAT_S, Memory, SessionCounters
from msbot_xrce.streams.waiting_messages import DATA, OBJECT_AT, PACKED_MAX, PADDING, REQUESTER, STATUS, Outbox

LONELY, LONELY_STEP, RAREST = 25, 8, 4
"""After so many HEARTBEATs without an answer they become rarer, by half with each step, and that so often at most.

Nobody may be there: who forged an address once would otherwise have them sent there without end.
"""

GUARD_MIN_S = 0.001
"""A message is not resent twice within this time because of ACKNACKs for the same gap."""

SLOT_HEAD = 4
"""In C clients, a reliable message lies in a buffer slot of the MTU's size that begins with 4 octets of its own."""

_NEVER_YET = float("-inf")

STALE_ACKNACK = "ACKNACK outside of what was sent"


class ReliableOutput:
    """A stream with acknowledgement, a window and retransmission."""

    __slots__ = (
        "_asked_before",
        "_capacity",
        "_counters",
        "_cut_at",
        "_envelope",
        "_first",
        "_has_lost",
        "_heartbeat_sent_at",
        "_is_sparse",
        "_is_stock",
        "_newest",
        "_next",
        "_octets",
        "_outbox",
        "_packed_max",
        "_pool",
        "_resent_at",
        "_round_trip",
        "_status_nr",
        "_timed",
        "_timed_at",
        "_unacked",
        "_unanswered",
        "_waiting",
        "_waiting_large",
        "_window",
        "heartbeat_at",
        "missed",
        "moved",
        "refused",
        "stream_id",
    )

    def __init__(
        self,
        stream_id: int,
        envelope: Envelope,
        outbox: Outbox,
        counters: SessionCounters,
        *,
        window: int,
        round_trip: RoundTrip,
        pool: Memory,
        packs: bool = False,
        is_stock: bool = False,
        is_sparse: bool = False,
    ) -> None:
        """`packs`: a submessage joins the message before it while that still waits; `is_stock`: as a stock client can
        read it; `is_sparse`: see `SessionSettings.sparse_acknacks`.

        `pool` counts the octets that all sessions of an agent keep until they are acknowledged.

        When it is full, a stream still gets one message at a time, once nothing of it is unacknowledged.
        """
        self.stream_id = stream_id
        self.heartbeat_at: float | None = None
        """When a HEARTBEAT is due; None while nothing is unacknowledged or messages wait for the link."""
        self.refused = False
        """Whether a caller was refused for lack of room, and must be told when there is room."""
        self.missed: list[int] = []
        """Numbers of the messages to be sent again."""
        self._envelope = envelope
        self._capacity = envelope.capacity
        self._outbox = outbox
        self._packed_max = min(envelope.mtu - SLOT_HEAD, PACKED_MAX) if packs else 0
        self._is_stock = is_stock
        self._is_sparse = is_sparse
        self._newest: bytes | None = None  # the message that others may join
        self._status_nr: int | None = None  # the latest message with a STATUS for a stock client
        self._has_lost = False  # whether the client has ever lacked a message
        self._counters = counters
        self._window = window
        self._round_trip = round_trip
        self._pool = pool
        self._octets = 0  # counted in the pool
        self._unanswered = 0  # HEARTBEATs since the last ACKNACK
        self._waiting: list[bytes] = []
        self._unacked: dict[int, bytes] = {}
        self._resent_at: dict[int, float] = {}
        self._waiting_large = 0
        self._cut_at = 0
        self._first = 0
        self._next = 0
        self.moved = False
        """Whether `link_drained` has something to do."""
        self._heartbeat_sent_at = _NEVER_YET
        self._asked_before: int | None = None  # HEARTBEATs have asked for all messages before this one
        self._timed: int | None = None
        self._timed_at = 0.0

    def has_room(self) -> bool:
        """Whether one more submessage of any size may be booked within the window."""
        kept = len(self._unacked) + len(self._waiting)
        return kept < self._window and not self._waiting_large and not (kept and self._pool.used >= self._pool.limit)

    @property
    def next_nr(self) -> int:
        """The sequence number of the message that gets one next."""
        return self._next

    @property
    def first_nr(self) -> int:
        """The number of the first message that is not acknowledged."""
        return self._first

    @property
    def waiting(self) -> int:
        """How many bodies wait for the window."""
        return len(self._waiting)

    @property
    def unacked(self) -> int:
        """How many messages are on their way or missing."""
        return len(self._unacked)

    @property
    def has_asked(self) -> bool:
        """Whether a HEARTBEAT has named the newest message."""
        return self._asked_before == self._next

    @property
    def state(self) -> StreamState:
        """Its state, for people."""
        last = last_number((self._next - 1) & 0xFFFF)
        return StreamState(self.stream_id, outgoing=True, last=last, unacked=self.unacked, waiting=self.waiting)

    def queue(self, body: bytes) -> None:
        """Queue a body, whatever its size; the caller has checked `has_room` or bounds `waiting`."""
        if len(body) > self._capacity:
            self._waiting_large += 1
            self._count(len(body))
        self._waiting.append(body)

    def pack(self, body: bytes) -> None:
        """Queue a submessage, in the same message as the previous one if that still waits and both fit."""
        waiting = self._waiting
        if waiting:
            joined = append_submessage(waiting[-1], body)
            if len(joined) <= self._capacity:
                waiting[-1] = joined
                return
        self.queue(body)

    def send(self, body: bytes, most_waiting: int | None = None) -> bool:
        """Book a body and send as much as the window allows; False: so many wait already, and it was not booked."""
        if (
            not self._waiting
            and len(self._unacked) < self._window
            and len(body) <= self._capacity
            and not (self._status_nr is not None and self._is_barred())
        ):
            self._emit(body)
        elif most_waiting is not None and len(self._waiting) >= most_waiting:
            return False
        else:
            self.queue(body)
            self.advance()
        return True

    def offer(self, body: bytes) -> bool:
        """Book a body if there is room for it; False: it was not booked, and the owner is told when there is room."""
        kept, pool = len(self._unacked) + len(self._waiting), self._pool
        if kept >= self._window or self._waiting_large or (kept and pool.used >= pool.limit):
            self.refused = True
            return False
        is_barred = self._status_nr is not None and self._is_barred()
        if self._waiting or len(body) > self._capacity or is_barred:
            self.queue(body)
            self.advance()
        else:
            self._emit(body)
        return True

    def advance(self) -> None:
        """Number the waiting messages, as far as the window allows."""
        waiting = self._waiting
        unacked, pool = self._unacked, self._pool
        while waiting and len(unacked) < self._window and (pool.used < pool.limit or not unacked):
            if self._status_nr is not None and self._is_barred():
                return
            if len(waiting[0]) <= self._capacity:
                self._emit(waiting.pop(0))
            else:
                self._emit_piece()

    def acknowledge(self, first: int, bitmap: int, now: float) -> bool:
        """Note an ACKNACK; True when it made progress.

        Numbers that were never sent (an old or foreign ACKNACK) are ignored; a C client loses its history that way.
        """
        unacked = self._unacked
        progress = (first - self._first) & 0xFFFF
        if progress > len(unacked):
            self._counters.dropped.count(STALE_ACKNACK)
            return False
        self._unanswered = 0
        if progress:
            is_all = progress == len(unacked)
            if is_all:
                octets = sum(map(len, unacked.values()))
                self._octets -= octets
                self._pool.used -= octets
                unacked.clear()
                self._resent_at.clear()
            else:
                self._forget(progress)
            self._first = first
            if self._timed is not None and self._timed not in unacked:
                asked_at = self._heartbeat_sent_at
                since_asked_s = now - asked_at if asked_at > self._timed_at else None
                self._round_trip.measure(now - self._timed_at, since_asked_s, now)
                self._timed = None
            self.heartbeat_at = None
            self.moved = not is_all
            if self._waiting:
                self.advance()
        if bitmap:
            self._note_missed(first, bitmap, now)
        return progress > 0

    def pull_missed(self, now: float, limit: int | None = None) -> list[bytes]:
        """The messages to send again, at most `limit`; those acknowledged since are left out."""
        packets: list[bytes] = []
        while self.missed and (limit is None or len(packets) < limit):
            nr = self.missed.pop(0)
            packet = self._unacked.get(nr)
            if packet is not None:
                packets.append(packet)
                self._resent_at[nr] = now
        self._counters.resent += len(packets)
        if packets:
            self.moved = True
            self.heartbeat_at = None
        return packets

    def link_drained(self, now: float, heartbeat_s: float, heartbeat_min_s: float) -> None:
        """Note that the link has pulled everything: the wait for an acknowledgement begins."""
        self.moved = False
        if not self._unacked:
            self.heartbeat_at = None
            return
        # Messages that follow do not put it off: a peer that lacks one for long must be asked while they flow.
        if self._is_sparse and heartbeat_s < SPARSE_HEARTBEAT_S and not self._has_lost:
            heartbeat_s = SPARSE_HEARTBEAT_S
        if self._unanswered > LONELY:
            heartbeat_s *= 1 << min((self._unanswered - LONELY) // LONELY_STEP, RAREST)
        due = now + self._round_trip.patience_s(now, heartbeat_s, heartbeat_min_s, self._unanswered)
        if self.heartbeat_at is None or due < self.heartbeat_at:
            self.heartbeat_at = due
        if self._timed is None and not (self._is_sparse and self._next % SPARSE_EVERY):
            self._timed = (self._next - 1) & 0xFFFF
            self._timed_at = now

    def heartbeat(self, now: float) -> Heartbeat:
        """The HEARTBEAT to be sent now; it names the first and the last unacknowledged message."""
        self._heartbeat_sent_at = now
        self._asked_before = self._next
        self._unanswered += 1
        self.heartbeat_at = None
        self.moved = True
        return Heartbeat(self._first, (self._next - 1) & 0xFFFF, self.stream_id)

    def release(self) -> None:
        """The stream is over: the pool gets its octets back."""
        self._count(-self._octets)

    def _count(self, octets: int) -> None:
        self._octets += octets
        self._pool.used += octets

    def _emit(self, body: bytes) -> None:
        items, newest = self._outbox.items, self._newest
        closes = False
        if self._is_stock:
            kind = body[0]
            if kind == DATA:
                closes = body[OBJECT_AT] & KIND_MASK == REQUESTER
            elif kind == STATUS:
                closes, newest = True, None  # a message of its own
                self._status_nr = self._next
        if newest is not None and items and items[-1] is newest:
            nr = (self._next - 1) & 0xFFFF
            joined = newest + PADDING[len(newest) & 3] + body
            size = len(joined)
            # A false ACKNACK may have acknowledged it before it was sent.
            if size <= self._packed_max and nr in self._unacked:
                items[-1] = self._unacked[nr] = joined
                self._newest = None if closes else joined
                size -= len(newest)
                self._octets += size
                self._pool.used += size
                return
        self._send_new(body)
        if self._packed_max:
            self._newest = None if closes else items[-1]  # type: ignore[assignment]  # it was put there

    def _is_barred(self) -> bool:
        """Whether the next message has to wait until the client has a STATUS."""
        if self._status_nr not in self._unacked:
            self._status_nr = None
            return False
        return self._has_lost

    def _send_new(self, body: bytes) -> None:
        nr = self._next
        packet = self._envelope.seal(self.stream_id, nr, body)
        self._unacked[nr] = packet
        size = len(packet)
        self._octets += size
        self._pool.used += size
        self._next = (nr + 1) & 0xFFFF
        self.moved = True
        self._outbox.items.append(packet)

    def _emit_piece(self) -> None:
        body = self._waiting[0]
        start = self._cut_at
        end = start + self._capacity - HEADER_SIZE
        is_last = end >= len(body)
        if is_last:
            del self._waiting[0]
            self._waiting_large -= 1
            self._count(-len(body))
            self._cut_at = 0
        else:
            self._cut_at = end
        self._newest = None  # a fragment stands alone
        self._send_new(Fragment(body[start:end], is_last).encode())

    def _forget(self, count: int) -> None:
        for index in range(count):
            nr = (self._first + index) & 0xFFFF
            self._count(-len(self._unacked.pop(nr)))
            self._resent_at.pop(nr, None)

    def _note_missed(self, first: int, bitmap: int, now: float) -> None:
        for index in range(bitmap.bit_length()):
            nr = (first + index) & 0xFFFF
            if bitmap >> index & 1 and nr in self._unacked and self._may_resend(nr, now):
                self.missed.append(nr)
                self._timed = None
                self._has_lost = True
                self._round_trip.note_loss(now)

    def _may_resend(self, nr: int, now: float) -> bool:
        if nr in self.missed or self._outbox.holds(self._unacked[nr]):
            return False
        resent_at = self._resent_at.get(nr)
        return resent_at is None or self._heartbeat_sent_at > resent_at or now - resent_at >= self._guard()

    def _guard(self) -> float:
        # Before the first measurement only a HEARTBEAT may ask again.
        round_trip_s = self._round_trip.smoothed_s
        return float("inf") if round_trip_s is None else max(2 * round_trip_s, GUARD_MIN_S)
