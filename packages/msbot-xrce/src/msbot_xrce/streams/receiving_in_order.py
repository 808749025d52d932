"""The receiving half of a stream: what is new, what came too early, what came again.

Theory of operation. A best-effort stream takes every message that is newer than the newest it has seen. A reliable
stream passes on every message exactly once and in order: the next one at once, those up to a window ahead are held
until the gap before them is filled. It reports its state to the peer in an ACKNACK after every message and every
HEARTBEAT, so a gap is repaired at the speed of the link (XRCE 1.0 §8.4).
"""

from __future__ import annotations

from msbot_xrce.streams.sequence_numbers import HALF, NOTHING_YET, distance, is_after
from msbot_xrce.streams.settings import Memory, SessionCounters

# Reassembles the pieces of a large submessage (XRCE 1.0 §8.3.5.14).
#
# A submessage that does not fit into one message is cut into FRAGMENTs with consecutive numbers of one reliable stream;
# they contain neither a length nor an offset, so the joiner must never see a gap: its owner clears it when a message is
# given up, at RESET and at every login (seen on the wire: an agent that keeps half a message across a RESET spoils the
# next one). Cutting is done by `ReliableOutput`, one piece at a time, so that a large sample is stored once.


TOO_LARGE = "fragmented message larger than allowed"


class FragmentJoiner:
    """Collects the pieces of one reliable stream."""

    __slots__ = ("_buffer", "_counters", "_memory", "_refused")

    def __init__(self, memory: Memory, counters: SessionCounters) -> None:
        self._memory = memory
        self._counters = counters
        self._buffer = bytearray()
        self._refused = False

    def add(self, piece: bytes, *, last: bool) -> bytes | None:
        """Take the next piece; returns the whole string of submessages if it was the last one, else None.

        A message that outgrows the memory is dropped as a whole, up to and including its last piece, and counted once.
        """
        if not self._refused:
            if self._memory.take(len(piece)):
                self._buffer += piece
            else:
                self._counters.dropped.count(TOO_LARGE)
                self.clear()
                self._refused = True
        if not last:
            return None
        whole = None if self._refused else bytes(self._buffer)
        self.clear()
        return whole

    def clear(self) -> None:
        """Forget what was collected."""
        if self._buffer:
            self._memory.give(len(self._buffer))
            self._buffer = bytearray()
        self._refused = False


BITMAP_BITS = 16
"""How many messages one ACKNACK can report missing."""

NO_MEMORY = "early message: no memory to hold it"
BEYOND_WINDOW = "message beyond the window"
GIVEN_UP = "message given up: its client can no longer send it"

MOVES_KEPT = 64
"""How many of the latest numbers from which ACKNACKs spoke are remembered."""
LONGEST_MOVE = HALF // 2 // MOVES_KEPT
"""Numbers from which ACKNACKs spoke have one order while each is nearer to the one before it than this."""
REPORTS_KEPT = 16
"""How many of the latest reports are remembered with their time."""
ALL_RIPE: frozenset[int] = frozenset()
"""What is missing is not only late."""
_NEVER_YET = float("-inf")


class BestEffortInput:
    """A stream without acknowledgement: newer messages only."""

    __slots__ = ("last",)

    def __init__(self) -> None:
        self.last = NOTHING_YET

    def accept(self, sequence_nr: int) -> bool:
        """Whether the message is newer than all before it."""
        if 0 < (sequence_nr - self.last) & 0xFFFF < HALF:
            self.last = sequence_nr
            return True
        return False


class ReliableInput:
    """A stream with acknowledgement: every message exactly once and in order."""

    __slots__ = (
        "_counters",
        "_held",
        "_held_bits",
        "_memory",
        "_moves",
        "_reported_at",
        "_window",
        "acked_at",
        "announced",
        "joiner",
        "last_handled",
        "reports",
        "told_at",
        "told_bits",
        "told_first",
        "unripe",
    )

    def __init__(self, window: int, memory: Memory, counters: SessionCounters) -> None:
        self._window = window
        self._memory = memory
        self._counters = counters
        self._held: dict[int, bytes] = {}
        self._held_bits = 0  # bit i: the i-th number after the last one handled is held
        self.announced = NOTHING_YET
        """The newest number known to exist; nothing is missing while it equals the last one handled."""
        self.last_handled = NOTHING_YET
        self.acked_at = _NEVER_YET
        """When an ACKNACK was last due, with sparse ones."""
        self.joiner = FragmentJoiner(memory, counters)
        self.unripe = ALL_RIPE
        """Missing numbers that are not reported yet, since they may only be late."""
        self.told_first = self.told_bits = 0
        """What the last ACKNACK said."""
        self.told_at = _NEVER_YET
        self.reports = 0
        """How many ACKNACKs asked for something."""
        self._moves: list[tuple[int, int]] = []
        self._reported_at: list[float] = []

    def acknack_sent(self, first: int, bits: int, now: float) -> None:
        """Note an ACKNACK that goes to the peer."""
        if first != self.told_first:
            if distance(self.told_first, first) > LONGEST_MOVE:
                self._moves.clear()
            self._moves.append((first, self.reports))
            if len(self._moves) > MOVES_KEPT:
                del self._moves[0]
        self.told_first, self.told_bits, self.told_at = first, bits, now
        if bits:
            self.reports += 1
            self._reported_at.append(now)
            if len(self._reported_at) > REPORTS_KEPT:
                del self._reported_at[0]

    def reports_on(self, number: int) -> int:
        """How many of the reports can have made the peer send that message: those from before it was acknowledged."""
        count = self.reports
        for first, reports in reversed(self._moves):
            if not 0 < (first - number) & 0xFFFF < HALF:
                break
            count = reports
        return count

    def reports_since(self, moment: float) -> int:
        """How many of the latest reports have gone since then."""
        count = 0
        for reported_at in reversed(self._reported_at):
            if reported_at < moment:
                break
            count += 1
        return count

    def accept(self, sequence_nr: int, packet: bytes) -> bool:
        """Whether the message is the next in order; an early one is held, any other is counted and forgotten."""
        ahead = (sequence_nr - self.last_handled) & 0xFFFF
        if ahead == 1:
            if self.announced == self.last_handled:
                self.announced = sequence_nr
            else:
                self._held_bits >>= 1
            self.last_handled = sequence_nr
            return True
        if ahead == 0 or ahead >= HALF or sequence_nr in self._held:
            self._counters.repeated += 1
        else:
            self._hold(sequence_nr, packet, ahead)
        return False

    def next_held(self) -> bytes | None:
        """The message after the last one handled, if it came early; it counts as handled from now on."""
        if not self._held:
            return None
        following = (self.last_handled + 1) & 0xFFFF
        packet = self._held.pop(following, None)
        if packet is not None:
            self._memory.give(len(packet))
            self.last_handled = following
            self._held_bits >>= 1
        return packet

    def announce(self, first: int, last: int) -> list[bytes | None]:
        """Note a HEARTBEAT; returns what must be handled now because older messages will never come.

        The peer keeps `first` to `last`; anything before `first` that is missing is given up. In the result, None
        stands for messages that are lost: pieces collected before it are worthless.
        """
        given_up: list[bytes | None] = []
        gap = distance(self.last_handled, first) - 1
        if 0 < gap < HALF - 1:
            target = (first - 1) & 0xFFFF
            for _ in range(min(gap, self._window)):
                packet = self.next_held()
                if packet is None:
                    self._pass_over()
                given_up.append(packet)
            if self.last_handled != target:
                self.last_handled = target
                given_up.append(None)
            if is_after(target, self.announced):
                self.announced = target
        if is_after(last, self.announced):
            self.announced = last
        return given_up

    def missing(self) -> tuple[int, int]:
        """The contents of an ACKNACK: the first number not handled; bit i is set if the i-th from there is missing."""
        first = (self.last_handled + 1) & 0xFFFF
        if self.announced == self.last_handled:
            return first, 0
        count = min(distance(self.last_handled, self.announced), BITMAP_BITS)
        bitmap = ~self._held_bits & ((1 << count) - 1)
        for number in self.unripe:
            index = distance(first, number)
            if index < count:
                bitmap &= ~(1 << index)
        return first, bitmap

    def give_up(self) -> int:
        """Pass over the messages that are missing before the next one that is there; returns how many."""
        count = 0
        while self.last_handled != self.announced and (self.last_handled + 1) & 0xFFFF not in self._held:
            self._pass_over()
            count += 1
        if count:
            self.joiner.clear()
        return count

    def holds(self, number: int) -> bool:
        """Whether that message came early, and waits."""
        return number in self._held

    @property
    def held(self) -> int:
        """How many messages came early."""
        return len(self._held)

    def release(self) -> None:
        """Forget what is held: nothing is received any more."""
        if self._held:
            for packet in self._held.values():
                self._memory.give(len(packet))
            self._held.clear()
        self._held_bits = 0
        self.joiner.clear()

    def reset(self) -> None:
        """Start over: the next message expected is number 0."""
        self.release()
        self.announced = self.last_handled = NOTHING_YET
        self.unripe = ALL_RIPE
        self.told_first = self.told_bits = self.reports = 0
        self.told_at = _NEVER_YET
        self._moves.clear()
        self._reported_at.clear()

    def _pass_over(self) -> None:
        """Go on without the next message, which is not held."""
        self.last_handled = (self.last_handled + 1) & 0xFFFF
        self._held_bits >>= 1

    def _hold(self, sequence_nr: int, packet: bytes, ahead: int) -> None:
        # A number far beyond the window is ignored: it would be reported missing for ever, and C clients answer any bit
        # by sending everything again.
        if ahead <= 2 * self._window and is_after(sequence_nr, self.announced):
            self.announced = sequence_nr
        if ahead > self._window:
            self._counters.dropped.count(BEYOND_WINDOW)
        elif self._memory.take(len(packet)):
            self._held[sequence_nr] = packet
            self._held_bits |= 1 << (ahead - 1)
            self._counters.early += 1
        else:
            self._counters.dropped.count(NO_MEMORY)
