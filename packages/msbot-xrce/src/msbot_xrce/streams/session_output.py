"""Everything a session sends: its output streams, answers outside them, and HEARTBEATs.

Outgoing messages are pulled by the owner of the link. A message counts as sent once it is pulled; only then does the
wait for its acknowledgement begin. No HEARTBEAT is made while anything waits to be pulled, so HEARTBEATs never fill up
a slow link. Messages to be sent again go first: they unblock the peer.
"""

from __future__ import annotations

import sys
from typing import TypeVar

from msbot_xrce.errors import LocalProtocolError
from msbot_xrce.messages.ids import STREAM_BEST_EFFORT, STREAM_NONE, STREAM_RELIABLE
from msbot_xrce.messages.streams import write_acknack
from msbot_xrce.messages.submessage import Envelope
from msbot_xrce.streams.receiving_in_order import ReliableInput
from msbot_xrce.streams.round_trip import RoundTrip
from msbot_xrce.streams.sending_and_resending import ReliableOutput
from msbot_xrce.streams.sending_best_effort import TOO_LARGE, BestEffortOutput
from msbot_xrce.streams.sequence_numbers import StreamState
from msbot_xrce.streams.settings import Memory, SessionCounters, SessionSettings
from msbot_xrce.streams.waiting_messages import Outbox, StreamQueue

Stream = TypeVar("Stream", BestEffortOutput, ReliableOutput)

ANSWERS_FULL = "answer outside of the streams: queue full, oldest dropped"
STREAM_LIMIT = "too many streams"


class SessionOutput:
    """The sending half of a session."""

    __slots__ = (
        "_answer_header",
        "_answers",
        "_counters",
        "_envelope",
        "_guesses",
        "_pool",
        "_settings",
        "_watches_order",
        "best_efforts",
        "heartbeat_s",
        "outbox",
        "owed",
        "reliables",
        "round_trip",
    )

    def __init__(
        self, envelope: Envelope, counters: SessionCounters, settings: SessionSettings, pool: Memory | None = None
    ) -> None:
        """`pool` counts what is kept until it is acknowledged, for several sessions together; absent: no limit."""
        self.heartbeat_s = settings.heartbeat_s
        self.round_trip = RoundTrip()
        self.outbox = Outbox(settings.queue_limit, counters)
        self._envelope = envelope
        self._counters = counters
        self._settings = settings
        self._watches_order = settings.watches_order
        self._pool = pool or Memory(sys.maxsize)
        self._answers = StreamQueue(ANSWERS_FULL)
        self.owed: dict[int, ReliableInput] = {}
        """The input streams whose ACKNACK is due: the next `pull` makes it, after everything booked until then."""
        self._guesses: dict[int, None] = {}
        self._answer_header = envelope.seal(STREAM_NONE, 0, b"")
        self.best_efforts: dict[int, BestEffortOutput] = {}
        """The best-effort streams in use; read-only (`best_effort` opens them)."""
        self.reliables: dict[int, ReliableOutput] = {}
        """The reliable streams in use; read-only (`reliable` opens them)."""

    def answer(self, body: bytes) -> None:
        """Book a submessage outside the streams (stream NONE); the caller makes sure that it fits."""
        self.put_answer(self._answer_header + body)

    def put_answer(self, packet: bytes) -> None:
        """Book a finished message of stream NONE."""
        self.outbox.put_newest(packet, self._answers)

    def send_unacknowledged(self, body: bytes, stream_id: int) -> None:
        """Book a message on a best-effort stream or on stream NONE; what does not fit is dropped and counted."""
        if stream_id != STREAM_NONE:
            stream = self.best_efforts.get(stream_id) or self.best_effort(stream_id)
            if stream is not None:
                stream.send(body)
        elif len(body) <= self._envelope.capacity:
            self.answer(body)
        else:
            self._counters.dropped.count(TOO_LARGE)

    def pack(self, body: bytes, stream_id: int) -> None:
        """Book a submessage, in one message with others of the same turn if they fit; `flush` finishes them.

        Raises:
            LocalProtocolError: it does not fit into one message of a stream that is not reliable; or there are too many
                streams.
        """
        is_large = len(body) > self._envelope.capacity
        if stream_id >= STREAM_RELIABLE:
            reliable = self._need(self.reliable(stream_id), stream_id)
            if is_large:
                reliable.send(body)
            else:
                reliable.pack(body)
        elif is_large:
            raise LocalProtocolError(
                f"{len(body)} bytes do not fit one message of {self._envelope.capacity}: use a reliable stream (0x80)"
            )
        elif stream_id == STREAM_NONE:
            self.answer(body)
        else:
            self._need(self.best_effort(stream_id), stream_id).pack(body)

    def finish_message(self, stream_id: int) -> int | None:
        """Finish the packed message on stream 0x01 or 0x80; returns the number of the message after it.

        None for other streams. On 0x80 the window must have room.

        Raises:
            LocalProtocolError: there are too many streams.
        """
        if stream_id == STREAM_BEST_EFFORT:
            best_effort = self._need(self.best_effort(stream_id), stream_id)
            best_effort.flush()
            return best_effort.next_nr
        if stream_id == STREAM_RELIABLE:
            reliable = self._need(self.reliable(stream_id), stream_id)
            reliable.advance()
            return reliable.next_nr
        return None

    def waiting(self, stream_id: int) -> int:
        """How many messages of that stream wait for the window."""
        stream = self.reliables.get(stream_id)
        return 0 if stream is None else stream.waiting

    def next_nr(self, stream_id: int) -> int:
        """The number of the message that this reliable stream sends next."""
        stream = self.reliables.get(stream_id)
        return 0 if stream is None else stream.next_nr

    def first_unacked(self, stream_id: int) -> int:
        """The number of the first message of this reliable stream that the peer has not acknowledged."""
        stream = self.reliables.get(stream_id)
        return 0 if stream is None else stream.first_nr

    def guess(self, stream_id: int) -> None:
        """Have the ACKNACK that is due ask for the next message, even if nobody has said that there is one."""
        self._guesses[stream_id] = None

    def queue_due_acknacks(self, now: float) -> None:
        """Book the ACKNACKs that are due now, ahead of what is booked after this."""
        for packet in self._acknacks(now):
            self.put_answer(packet)

    def _acknacks(self, now: float) -> list[bytes]:
        packets = []
        for stream_id, stream in self.owed.items():
            first, bitmap = stream.missing()
            if not bitmap and stream_id in self._guesses:
                bitmap = 1
            if self._watches_order:
                stream.acknack_sent(first, bitmap, now)
            packets.append(self._answer_header + write_acknack(first, bitmap, stream_id))
        self.owed.clear()
        if self._guesses:
            self._guesses.clear()
        return packets

    def best_effort(self, stream_id: int) -> BestEffortOutput | None:
        """The stream, opened when first used; None (counted) when there are too many."""
        stream = self.best_efforts.get(stream_id)
        if stream is None and self._may_open(self.best_efforts):
            stream = BestEffortOutput(
                stream_id,
                self._envelope,
                self.outbox,
                self._counters,
                packs=self._settings.packs,
                is_stock=self._settings.peer_is_stock,
            )
            self.best_efforts[stream_id] = stream
        return stream

    def reliable(self, stream_id: int) -> ReliableOutput | None:
        """The stream, opened when first used; None (counted) when there are too many."""
        stream = self.reliables.get(stream_id)
        if stream is None and self._may_open(self.reliables):
            stream = ReliableOutput(
                stream_id,
                self._envelope,
                self.outbox,
                self._counters,
                window=self._settings.window,
                round_trip=self.round_trip,
                pool=self._pool,
                packs=self._settings.packs,
                is_stock=self._settings.peer_is_stock,
                is_sparse=self._settings.sparse_acknacks,
            )
            self.reliables[stream_id] = stream
        return stream

    def acknowledged(self, stream_id: int, first: int, bitmap: int, now: float) -> bool:
        """Note an ACKNACK; True when a stream that had refused something has room again."""
        stream = self.reliables.get(stream_id)
        if stream is None or not stream.acknowledge(first, bitmap, now):
            return False
        if stream.moved and not self.outbox.items:
            stream.link_drained(now, self.heartbeat_s, self._settings.heartbeat_min_s)
        if stream.refused and stream.has_room():
            stream.refused = False
            return True
        return False

    def patience_s(self, now: float, unanswered: int, longest_s: float | None = None) -> float:
        """How long to wait for the peer before asking it again, at most `longest_s` or the time of a HEARTBEAT; see
        `RoundTrip`."""
        longest_s = self.heartbeat_s if longest_s is None else longest_s
        return self.round_trip.patience_s(now, longest_s, self._settings.heartbeat_min_s, unanswered)

    def flush(self) -> None:
        """Finish the messages that submessages were packed into."""
        for reliable in self.reliables.values():
            reliable.advance()
        for best_effort in self.best_efforts.values():
            best_effort.flush()

    def pull(self, now: float, limit: int | None = None) -> list[bytes]:
        """The next messages for the link, all or at most `limit`; they count as sent."""
        if limit is not None:
            return self._pull_some(now, limit)
        packets: list[bytes] = []
        for stream in self.reliables.values():
            if stream.missed:
                packets += stream.pull_missed(now)
            if stream.moved:
                stream.link_drained(now, self.heartbeat_s, self._settings.heartbeat_min_s)
        items = self.outbox.items
        if len(items) == 1:
            item = items.pop()
            packets.append(item if type(item) is bytes else item.packets.pop(0))  # type: ignore[union-attr]
        elif items:
            packets += self.outbox.pull()
        if self.owed:
            packets += self._acknacks(now)
        self._counters.packets_out += len(packets)
        return packets

    def _pull_some(self, now: float, limit: int) -> list[bytes]:
        if self.owed:
            self.queue_due_acknacks(now)
        packets: list[bytes] = []
        for stream in self.reliables.values():
            if stream.missed:
                packets += stream.pull_missed(now, limit - len(packets))
        outbox = self.outbox
        if outbox.items:
            packets += outbox.pull(limit - len(packets))
        if not outbox.items:
            for stream in self.reliables.values():
                if stream.moved:
                    stream.link_drained(now, self.heartbeat_s, self._settings.heartbeat_min_s)
        self._counters.packets_out += len(packets)
        return packets

    def stream_states(self) -> list[StreamState]:
        """The state of every stream."""
        states = [stream.state for stream in self.best_efforts.values()]
        return states + [stream.state for stream in self.reliables.values()]

    @property
    def is_delivered(self) -> bool:
        """Whether the peer has acknowledged everything that was booked on reliable streams."""
        return not any(stream.waiting or stream.unacked for stream in self.reliables.values())

    def is_at_rest(self) -> bool:
        """Whether nothing waits to be pulled, and no HEARTBEAT is due or to be worked out."""
        if self.outbox.items or self.owed:
            return False
        for stream in self.reliables.values():
            if stream.moved or stream.missed or stream.heartbeat_at is not None:
                return False
        return True

    @property
    def is_idle(self) -> bool:
        """Whether nothing waits to be pulled."""
        return not self.outbox.items and not self.owed and not any(stream.missed for stream in self.reliables.values())

    def timer(self) -> float | None:
        """When the next HEARTBEAT is due; None while messages wait to be pulled or nothing is unacknowledged."""
        if self.outbox.items or self.owed:
            return None
        due: float | None = None
        for stream in self.reliables.values():
            if stream.missed:
                return None
            at = stream.heartbeat_at
            if at is not None and (due is None or at < due):
                due = at
        return due

    def handle_timer(self, now: float) -> None:
        """Book the HEARTBEATs that are due."""
        if not self.is_idle:
            return
        for stream in self.reliables.values():
            if stream.heartbeat_at is not None and now >= stream.heartbeat_at:
                self._ask(stream, now)

    def _ask(self, stream: ReliableOutput, now: float) -> None:
        self.outbox.put(self._answer_header + stream.heartbeat(now).encode())
        self._counters.heartbeats_out += 1

    def ask_for_delivery(self, now: float) -> bool:
        """See `Session.ask_for_delivery`."""
        asked = False
        if self._settings.sparse_acknacks and self.is_idle:
            for stream in self.reliables.values():
                if stream.unacked and not stream.has_asked:
                    self._ask(stream, now)
                    asked = True
        return asked

    def reset(self, envelope: Envelope | None = None) -> list[int]:
        """Start all streams over and forget what waits; returns the streams that had refused something."""
        self._envelope = envelope or self._envelope
        self.round_trip = RoundTrip()
        refused = [stream.stream_id for stream in self.reliables.values() if stream.refused]
        self.outbox.clear()
        self.owed.clear()
        self._guesses.clear()
        self.best_efforts.clear()
        for stream in self.reliables.values():
            stream.release()
        self.reliables.clear()
        return refused

    def release(self) -> None:
        """Give back what is counted in the pool: nothing will be sent any more."""
        for stream in self.reliables.values():
            stream.release()

    @staticmethod
    def _need(stream: Stream | None, stream_id: int) -> Stream:
        if stream is None:
            raise LocalProtocolError(f"stream 0x{stream_id:02X} cannot be opened: too many streams are in use")
        return stream

    def _may_open(self, streams: dict[int, BestEffortOutput] | dict[int, ReliableOutput]) -> bool:
        if len(streams) < self._settings.max_streams:
            return True
        self._counters.dropped.count(STREAM_LIMIT)
        return False
