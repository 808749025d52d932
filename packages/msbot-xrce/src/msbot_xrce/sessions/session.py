"""What both ends of a session have in common: receiving through streams, acknowledging, reporting to the owner.

Theory of operation. `receive_packet` runs a message through its stream and then submessage by submessage through
what turns each into an event. An ACKNACK is due from then on, and is made when the owner pulls packets,
after it has taken the events. So the answers to a message always precede its ACKNACK, one ACKNACK speaks for all
messages of a burst, and ACKNACKs never overtake each other; if they did, a C client would lose its history.

DEVIATION: the genuine agent sends an ACKNACK for each message. An ACKNACK covers all messages before it, so of those
that came at once the last one says it all, in a fraction of the packets.

On a link that loses nothing, between two ends of MsBOT, an ACKNACK may speak for messages of a longer time
(`SessionSettings.sparse_acknacks`): what a robot's programs send is acknowledged four times as rarely.

A gap is reported at once and again after a while (`AcknackSchedule`). So repair on a lossy link takes a round trip, and
need not wait for the peer's HEARTBEAT.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, ClassVar, Generic, TypeVar

from msbot_xrce.errors import RemoteProtocolError
from msbot_xrce.messages.ids import STREAM_NONE, STREAM_RELIABLE, SubmessageId
from msbot_xrce.messages.message import Heartbeat
from msbot_xrce.messages.streams import LAST_FRAGMENT, read_acknack
from msbot_xrce.messages.submessage import HEADER_SIZE, MTU_MIN, SUBMESSAGE_HEADER, Envelope, end_of_empty
from msbot_xrce.sessions.events import WindowOpened
from msbot_xrce.streams.acknack_schedule import AcknackSchedule
from msbot_xrce.streams.receiving_in_order import GIVEN_UP, BestEffortInput, ReliableInput
from msbot_xrce.streams.reordering import ReorderingDetector
from msbot_xrce.streams.sequence_numbers import NOTHING_YET, StreamState, last_number
from msbot_xrce.streams.session_output import STREAM_LIMIT, SessionOutput
from msbot_xrce.streams.settings import SPARSE_EVERY, SPARSE_QUIET_S, Memory, SessionCounters, SessionSettings

Event = TypeVar("Event")

# Plain ints: comparing with a member of an IntEnum costs several times as much, for every submessage.
_ACKNACK_ID = SubmessageId.ACKNACK.value
_HEARTBEAT_ID = SubmessageId.HEARTBEAT.value
_FRAGMENT_ID = SubmessageId.FRAGMENT.value
_read_header = SUBMESSAGE_HEADER.unpack_from
_ACKNACK_LENGTH = 5
LONE_ACKNACK = HEADER_SIZE + _ACKNACK_LENGTH
"""Octets behind the header of a message that is nothing but an ACKNACK."""

BROKEN = {kind.value: f"broken {kind.name}" for kind in SubmessageId}
UNKNOWN_BROKEN = "broken submessage of an unknown kind"
OTHER_SESSION = "message of another session"
NOT_RELIABLE = "FRAGMENT outside of a reliable stream"
NESTED = "FRAGMENT inside of fragments"
INSIDE_STREAM = "HEARTBEAT inside of a reliable stream"


Take = Callable[[Any, bytes, int, int, int, int], bool]
"""`(session, packet, start, end, flags, stream id)` takes the submessage `packet[start:end]`; False: it ends the
message."""


class Session(ABC, Generic[Event]):
    """The common half of `AgentSession` and `ClientSession`."""

    __slots__ = (
        "__weakref__",
        "_asking",
        "_best_effort",
        "_key_octets",
        "_memory",
        "_overtaking",
        "_reliable",
        "_sender",
        "_settings",
        "_sparse",
        "_told",
        "_unquestioned",
        "client_key",
        "counters",
        "events",
        "last_heard",
        "mtu",
        "session_id",
    )

    _DATA_ID: ClassVar[int]
    """The submessage that carries samples to this end."""
    _OTHERS: ClassVar[dict[int, Take]]
    """What takes the further submessages that this end knows, by kind."""

    def __init__(
        self,
        client_key: int,
        session_id: int,
        mtu: int,
        settings: SessionSettings,
        *,
        pads: bool,
        memory: Memory | None = None,
        unacked: Memory | None = None,
    ) -> None:
        self.client_key = client_key
        self.session_id = session_id
        self.mtu = max(mtu, MTU_MIN)
        """Largest message in bytes that is sent, header included."""
        self.last_heard = 0.0
        """When the last packet of the peer came; 0.0 before the first, unless the owner sets it."""
        self.counters = SessionCounters()
        self._settings = settings
        self._sparse = settings.sparse_acknacks
        self._unquestioned = -1
        """Packets that begin with this octet are taken without asking `_refusal`."""
        self._memory = Memory(settings.max_message, memory)
        self._key_octets = client_key.to_bytes(4, "big")
        self.events: list[Event | WindowOpened] = []
        """What has happened, oldest first; the owner handles and clears it, or calls `next_event`."""
        self._told = 0  # how many of them `next_event` has given
        self._best_effort: dict[int, BestEffortInput] = {}
        self._reliable: dict[int, ReliableInput] = {}
        envelope = Envelope(session_id, client_key, self.mtu, pads=pads)
        self._sender = SessionOutput(envelope, self.counters, settings, unacked)
        # On a bus (no such short silence) silence means that others go first, and questions would make it worse.
        self._overtaking = ReorderingDetector(self._sender.round_trip) if settings.watches_order else None
        guesses = settings.heartbeat_min_s < settings.heartbeat_s
        self._asking = AcknackSchedule(self._sender, guesses=guesses, overtaking=self._overtaking)

    def receive_packet(self, packet: bytes, now: float) -> bool:
        """Take one packet of the peer; if the result is True, call `next_event` until it returns None, before packets
        are pulled.

        A submessage that makes no sense is counted in `dropped`, and the rest of the message is ignored.

        Raises:
            RemoteProtocolError: the packet is shorter than a message header.
        """
        size = len(packet)
        if size < 4 or (size < 8 and packet[0] < 0x80):
            raise RemoteProtocolError(f"packet of {size} bytes: too short for a message header")
        session_id, stream_id = packet[0], packet[1]
        if session_id != self._unquestioned and (refusal := self._refusal(packet, stream_id)) is not None:
            self.counters.dropped.count(refusal)
            return False
        self.last_heard = now
        self.counters.packets_in += 1
        offset = 4 if session_id >= 0x80 else 8
        if stream_id >= STREAM_RELIABLE:
            self._receive_reliable(stream_id, packet, offset)
        elif stream_id == STREAM_NONE:
            # Mostly a lone ACKNACK: one for every message that was sent on a reliable stream.
            if (
                size == offset + LONE_ACKNACK
                and packet[offset] == _ACKNACK_ID
                and packet[offset + 2] == _ACKNACK_LENGTH
            ):
                self._take_acknack(*read_acknack(packet, offset + HEADER_SIZE, size, packet[offset + 1]))
            else:
                self._process(packet, offset, stream_id)
        elif (stream := self._best_effort.get(stream_id) or self._best_effort_input(stream_id)) is not None:
            if stream.accept(packet[2] | packet[3] << 8):
                self._process(packet, offset, stream_id)
            else:
                self.counters.repeated += 1
        return True if self.events else False  # noqa: SIM210 - a third of what `bool` costs, for every packet

    def next_event(self) -> Event | WindowOpened | None:
        """The next event; None when there are no more."""
        events, at = self.events, self._told
        if at < len(events):
            self._told = at + 1
            return events[at]
        if at:
            events.clear()
            self._told = 0
        return None

    def has_room(self, stream_id: int) -> bool:
        """Whether a sample may be booked on that stream now; after False, `WindowOpened` says when."""
        if stream_id < STREAM_RELIABLE:
            return True
        stream = self._sender.reliable(stream_id)
        if stream is None or stream.has_room():
            return True
        stream.refused = True
        return False

    @property
    def is_delivered(self) -> bool:
        """Whether the peer has acknowledged everything that was booked on reliable streams."""
        return self._sender.is_delivered

    def ask_for_delivery(self, now: float) -> bool:
        """Where ACKNACKs are sparse, ask at once what the peer has of all that was sent; True: something is booked.

        A message is asked for once, however often this is called.
        """
        return self._sender.ask_for_delivery(now)

    @property
    def has_taken_in_order(self) -> bool:
        """Whether a message of a reliable stream has come since the streams were started."""
        return any(stream.last_handled != NOTHING_YET for stream in self._reliable.values())

    @property
    def has_to_answer(self) -> bool:
        """Whether packets wait to be pulled, or are missing and to be asked for later: the timer may have changed."""
        sender = self._sender
        return bool(sender.owed or sender.outbox.items or self._asking.questions)

    @property
    def acknowledged(self) -> tuple[int, float]:
        """How often it was measured how long a message and its acknowledgement take, and the latest, seconds."""
        return self._sender.round_trip.count, self._sender.round_trip.latest_s

    def packets_to_send(self, now: float, limit: int | None = None) -> list[bytes]:
        """The next messages for the link, all or at most `limit`; they count as sent.

        Pull no more than the link accepts now: the wait for acknowledgements begins when nothing is left, and samples
        that wait here can still be replaced by newer ones.
        """
        return self._sender.pull(now, limit)

    def timer(self) -> float | None:
        """When to call `handle_timer`; changes with every other call."""
        due = self._sender.timer()
        if not self._asking.questions or not self._sender.is_idle:
            return due
        again_at = self._asking.next_at()
        if due is None or again_at is None:
            return again_at if due is None else due
        return min(due, again_at)

    def handle_timer(self, now: float) -> None:
        """Book what is due by now."""
        # What already waits for the link says more than a repetition could.
        asks = self._asking.questions and self._sender.is_idle
        self._sender.handle_timer(now)
        if asks:
            self._asking.ask(now)

    def release(self) -> None:
        """The session is over: give back the memory that it shares with others."""
        for stream in self._reliable.values():
            stream.release()
        self._sender.release()

    @property
    def heartbeat_s(self) -> float:
        """Silence in seconds after which a HEARTBEAT asks for what is unacknowledged; may be changed at any time.

        On a slower link, the wait is two measured round trips instead.
        """
        return self._sender.heartbeat_s

    @heartbeat_s.setter
    def heartbeat_s(self, period_s: float) -> None:
        self._sender.heartbeat_s = period_s

    @property
    def queue_limit(self) -> int:
        """How many best-effort messages of each stream may wait for the link; beyond, the oldest are dropped."""
        return self._sender.outbox.limit

    @queue_limit.setter
    def queue_limit(self, messages: int) -> None:
        self._sender.outbox.limit = messages

    def stream_states(self) -> list[StreamState]:
        """How every stream in use stands, incoming ones first."""
        states = [
            StreamState(stream_id, outgoing=False, last=last_number(stream.last))
            for stream_id, stream in self._best_effort.items()
        ]
        states += [
            StreamState(stream_id, outgoing=False, last=last_number(stream.last_handled), waiting=stream.held)
            for stream_id, stream in self._reliable.items()
        ]
        return states + self._sender.stream_states()

    @property
    def dropped(self) -> dict[str, int]:
        """What was not handled or not sent, by reason in words."""
        return self.counters.dropped

    @abstractmethod
    def _refusal(self, packet: bytes, stream_id: int) -> str | None:
        """Why this session cannot take the message in its present state, in words; None when it can."""

    @abstractmethod
    def _take_data(self, packet: bytes, start: int, end: int, flags: int, stream_id: int) -> bool:
        """Take the sample that `packet[start:end]` carries (submessage `_DATA_ID`); False ends the message."""

    def _restart_streams(self, envelope: Envelope | None = None) -> None:
        """Start all streams over, both ways; forget all messages that wait, are held, or are half collected."""
        self._restart_input()
        self.events.extend(WindowOpened(stream_id) for stream_id in self._sender.reset(envelope))

    def _restart_input(self) -> None:
        for stream in self._reliable.values():
            stream.reset()
        self._reliable.clear()
        self._best_effort.clear()
        self._asking.clear()

    def _best_effort_input(self, stream_id: int) -> BestEffortInput | None:
        if not self._may_open(self._best_effort):
            return None
        stream = self._best_effort[stream_id] = BestEffortInput()
        return stream

    def _receive_reliable(self, stream_id: int, packet: bytes, offset: int) -> None:
        stream = self._reliable.get(stream_id) or self._reliable_input(stream_id)
        if stream is None:
            return
        number = packet[2] | packet[3] << 8
        if (overtaking := self._overtaking) is not None and (
            stream.announced != stream.last_handled or (number - stream.last_handled) & 0xFFFF != 1
        ):
            overtaking.note(stream_id, stream, number, self.last_heard)
            if stream.holds(number):
                self._consider_giving_up(stream_id, stream, came_again=True)
        if stream.accept(number, packet):
            self._process(packet, offset, stream_id)
            if stream.announced != stream.last_handled:
                self._process_held(stream, stream_id)
        now = self.last_heard
        if (
            stream.announced == stream.last_handled
            and not self._asking.questions
            and now >= self._sender.round_trip.lossy_until
            and (overtaking is None or now >= overtaking.until)
        ):
            if self._sparse:
                if (number + 1) % SPARSE_EVERY and now - stream.acked_at < SPARSE_QUIET_S:
                    return
                stream.acked_at = now
            self._sender.owed[stream_id] = stream
        else:
            self._owe_acknack(stream, stream_id)

    def _given_up(self, stream_id: int, count: int) -> None:
        """So many messages of that stream will never come."""

    def _consider_giving_up(self, stream_id: int, stream: ReliableInput, *, came_again: bool) -> None:
        if self._asking.questions and self._asking.is_hopeless(stream_id, stream, came_again=came_again):
            count = stream.give_up()
            self.counters.dropped.count(GIVEN_UP, count)
            self._given_up(stream_id, count)
            self._process_held(stream, stream_id)

    def _reliable_input(self, stream_id: int) -> ReliableInput | None:
        stream = self._reliable.get(stream_id)
        if stream is None and self._may_open(self._reliable):
            stream = self._reliable[stream_id] = ReliableInput(self._settings.window, self._memory, self.counters)
        return stream

    def _may_open(self, streams: dict[int, BestEffortInput] | dict[int, ReliableInput]) -> bool:
        if len(streams) < self._settings.max_streams:
            return True
        self.counters.dropped.count(STREAM_LIMIT)
        return False

    def _process_held(self, stream: ReliableInput, stream_id: int) -> None:
        while (packet := stream.next_held()) is not None:
            self._process(packet, 4 if packet[0] >= 0x80 else 8, stream_id)

    def _owe_acknack(self, stream: ReliableInput, stream_id: int, *, was_asked: bool = False) -> None:
        sender, asking, now = self._sender, self._asking, self.last_heard
        if (
            stream.announced != stream.last_handled
            or asking.questions
            or now < sender.round_trip.lossy_until
            or (self._overtaking is not None and now < self._overtaking.until)
        ) and not asking.note(stream_id, stream, now, was_asked=was_asked):
            return
        sender.owed[stream_id] = stream

    def _process(self, packet: bytes, offset: int, stream_id: int) -> None:
        """Handle the submessages of a message, or of reassembled fragments (which begin at offset 0)."""
        size = len(packet)
        start = offset + HEADER_SIZE
        while start <= size:
            kind, flags, length = _read_header(packet, start - HEADER_SIZE)
            end = start + length if length else end_of_empty(kind, packet, start)
            try:
                if end > size:
                    raise RemoteProtocolError("longer than its message")
                if kind == self._DATA_ID:
                    if not self._take_data(packet, start, end, flags, stream_id):
                        return
                elif kind == _ACKNACK_ID:
                    self._take_acknack(*read_acknack(packet, start, end, flags))
                elif (take := self._OTHERS.get(kind)) is not None:
                    if not take(self, packet, start, end, flags, stream_id):
                        return
                elif kind == _HEARTBEAT_ID:
                    self._take_heartbeat(Heartbeat.decode(packet, start, end, flags), stream_id)
                elif kind == _FRAGMENT_ID:
                    self._take_fragment(packet[start:end], flags, stream_id, is_joined=offset == 0)
            except RemoteProtocolError:
                self.counters.dropped.count(BROKEN.get(kind, UNKNOWN_BROKEN))
                return
            start = (end + 7) & ~3

    def _take_acknack(self, first: int, bitmap: int, stream_id: int) -> None:
        if self._sender.acknowledged(stream_id, first, bitmap, self.last_heard):
            self.events.append(WindowOpened(stream_id))

    def _take_heartbeat(self, heartbeat: Heartbeat, carrier_id: int) -> None:
        if carrier_id >= STREAM_RELIABLE:
            # They travel on stream NONE (XRCE 1.0 §8.3.5.12); one in a held message could trigger others without end.
            self.counters.dropped.count(INSIDE_STREAM)
            return
        stream_id = heartbeat.stream_id
        # A HEARTBEAT for a best-effort stream means nothing. DEVIATION: the genuine agent answers it with garbage.
        stream = self._reliable_input(stream_id) if stream_id >= STREAM_RELIABLE else None
        if stream is None:
            return
        if self._overtaking is not None:
            self._overtaking.announced(stream_id, stream, heartbeat.last, self.last_heard)
            self._consider_giving_up(stream_id, stream, came_again=False)
        for packet in stream.announce(heartbeat.first, heartbeat.last):
            if packet is None:
                stream.joiner.clear()
            else:
                self._process(packet, 4 if packet[0] >= 0x80 else 8, stream_id)
        self._process_held(stream, stream_id)
        self._owe_acknack(stream, stream_id, was_asked=True)

    def _take_fragment(self, piece: bytes, flags: int, stream_id: int, *, is_joined: bool) -> None:
        stream = self._reliable.get(stream_id)
        if stream is None:
            self.counters.dropped.count(NOT_RELIABLE)
        elif is_joined:
            self.counters.dropped.count(NESTED)
        else:
            whole = stream.joiner.add(piece, last=bool(flags & LAST_FRAGMENT))
            if whole is not None:
                self._process(whole, 0, stream_id)
