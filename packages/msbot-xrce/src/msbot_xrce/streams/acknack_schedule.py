"""When a receiver acknowledges, and when it asks again for what is missing.

A gap is reported with the ACKNACK of the message that revealed it. If that report or the messages it asked for are
lost, too, nothing else may arrive that would reveal it, so the report is repeated after a while. On a lossy link the
newest messages may be missing as well, or the ACKNACK of the newest may be lost; the peer notices only with its own
timer, 100 ms later in C clients, and never if it is run in shorter slices. So there, the message after the newest one
is asked for too, as if it were known to be missing: a few times, and of a stock client over UDP as long as the link
counts as lossy. A peer that has it sends it at once, and one that has nothing more ignores the question. The waits
grow, up to the peer's own period; those for what may not exist grow further.

Bounds. A receiver with a gap says so with every message that arrives, and a stock client answers each time with
everything it has. So over UDP the same gap is reported to it again only when the wait for an answer is over.

Networks that reorder (`ReorderingDetector`). There, the time that a packet may be late is left

* before a missing message counts as missing: it may only be late;
* between two ACKNACKs, because the first one would harm a stock client if it came last.

Holes. A stock client whose history was emptied can never send what was under way and lost. When it has answered so many
reports of a gap, and never with what is missing, the missing messages are given up.

The time from a report to the missing message is a measurement of the round trip: the only one in a session in which
the peer does all the sending.
"""

from __future__ import annotations

from enum import Enum, auto

from msbot_xrce.streams.receiving_in_order import ALL_RIPE, ReliableInput
from msbot_xrce.streams.reordering import ReorderingDetector
from msbot_xrce.streams.round_trip import QUICK
from msbot_xrce.streams.session_output import SessionOutput

REPEATS_MAX = 8
"""How often the same gap is reported, at least, while nothing arrives; after that as long as the link is lossy."""

GUESSES_MAX = 4
"""How often the message after the newest one is asked for, at least."""

GUESS_RAREST_S = 5.0
"""After those, the waits go on growing up to this: where thousands of clients have lost something, nearly all of them
have nothing more to send."""

UNMEASURED_S = 0.02
"""The wait for an answer of a stock client while the round trip is not known. Elsewhere nothing is repeated then."""

RAREST = 5
"""So often that wait doubles: a peer that never answered may not be there (a forged address), or thousands of others
ask as well."""

HOPELESS = 32
"""What makes a gap one that cannot be filled: a message beyond it that came again in answer to a report counts 2, a
HEARTBEAT 1."""


class _Kind(Enum):
    """Why an ACKNACK will be sent."""

    GAP = auto()
    """Something is missing."""
    GUESS = auto()
    """Something may be missing that nobody has announced."""
    LATER = auto()
    """It would be too early now."""


# Names of the module: to read a member of an Enum from its class takes ten times as long.
_GAP, _GUESS, _LATER = _Kind.GAP, _Kind.GUESS, _Kind.LATER


class _Question:
    """What is asked of one stream, and since when."""

    __slots__ = ("first", "kind", "repeat_at", "repeated", "repeated_at", "rounds", "stream", "told_at")

    def __init__(self, stream: ReliableInput, first: int, kind: _Kind, now: float) -> None:
        self.stream = stream
        self.first = first
        """The number of the first message that is missing."""
        self.kind = kind
        self.repeated_at = now
        self.repeat_at = 0.0
        self.repeated = 0
        self.rounds = 0
        self.told_at = now
        """The report that was counted last in `rounds`."""


class AcknackSchedule:
    """The open questions of a session, one for each stream at most."""

    __slots__ = ("_guesses", "_overtaking", "_sender", "questions")

    def __init__(self, sender: SessionOutput, *, guesses: bool, overtaking: ReorderingDetector | None = None) -> None:
        """Ask nothing yet.

        Args:
            sender: sends the ACKNACKs.
            guesses: whether messages are asked for that may not exist.
            overtaking: if the peer is a stock client on a network that may reorder.
        """
        self._sender = sender
        self._guesses = guesses
        self._overtaking = overtaking
        self.questions: dict[int, _Question] = {}
        """The open ones, by stream; read-only."""

    def note(self, stream_id: int, stream: ReliableInput, now: float, *, was_asked: bool = False) -> bool:
        """A message or a HEARTBEAT (`was_asked`) has come; returns whether an ACKNACK is due now.

        Not needed while the stream lacks nothing, nothing is asked, and nothing was lost or overtaken of late.
        """
        delay_s = self._delay_s(now)
        if stream.announced == stream.last_handled and not delay_s:
            question = self.questions.get(stream_id)
            if question is None or question.first != (stream.last_handled + 1) & 0xFFFF:
                self._note_in_order(stream_id, stream, question, now)
                return True
        ripe_at = self._ripen(stream_id, stream, now, delay_s)
        first, bits = stream.missing()
        if bits:
            self._sender.round_trip.note_loss(now)
        question = self._current(stream_id, first, bits, now)
        if self._overtaking is not None:
            if (
                question is not None
                and bits
                and bits == stream.told_bits
                and first == stream.told_first
                and not was_asked
            ):
                due_at = question.repeat_at
            else:
                due_at = stream.told_at + delay_s if delay_s else now
            if due_at > now:
                if question is None:
                    question = self.questions[stream_id] = _Question(stream, first, _LATER, now)
                if question.kind is _LATER or due_at < question.repeat_at:
                    question.repeat_at = due_at
                return False
        elif question is not None:
            question.repeated = 0
        self._plan(stream_id, stream, question, first, bits, now, delay_s, ripe_at)
        return True

    def is_hopeless(self, stream_id: int, stream: ReliableInput, *, came_again: bool) -> bool:
        """Whether the peer has shown that it cannot send what is missing; ask this before `note`.

        `came_again`: what came is a message beyond the gap that had come before; otherwise it is a HEARTBEAT.
        """
        question = self.questions.get(stream_id)
        if self._overtaking is None or question is None or question.kind is not _GAP:
            return False
        is_reported = stream.told_first == question.first == (stream.last_handled + 1) & 0xFFFF and stream.told_bits & 1
        if not is_reported or stream.told_at <= question.told_at:
            return False
        question.told_at = stream.told_at
        question.rounds += 2 if came_again else 1
        question.repeated = min(question.repeated, QUICK)  # it is there, and answers
        return question.rounds >= HOPELESS

    def next_at(self) -> float | None:
        """When to call `ask`; None: nothing is asked."""
        return min((question.repeat_at for question in self.questions.values()), default=None)

    def ask(self, now: float) -> None:
        """Have the questions repeated that are due."""
        for stream_id, question in list(self.questions.items()):
            if now >= question.repeat_at:
                stream = question.stream
                delay_s = self._delay_s(now)
                ripe_at = self._ripen(stream_id, stream, now, delay_s)
                first, bits = stream.missing()
                self._sender.owed[stream_id] = stream
                if question.kind is _GUESS:
                    self._sender.guess(stream_id)
                question.repeated += 1
                question.repeated_at = now
                current = self._current(stream_id, first, bits, now)
                self._plan(stream_id, stream, current, first, bits, now, delay_s, ripe_at)

    def clear(self) -> None:
        """Forget all questions: the streams start over."""
        self.questions.clear()
        if self._overtaking is not None:
            self._overtaking.clear()

    def _delay_s(self, now: float) -> float:
        """How late a packet may be that another one has overtaken; 0: packets keep their order."""
        overtaking = self._overtaking
        return 0.0 if overtaking is None or now >= overtaking.until else overtaking.delay_s

    def _note_in_order(self, stream_id: int, stream: ReliableInput, answered: _Question | None, now: float) -> None:
        """What came answers the question that was open, if one was, and nothing is missing now.

        On a lossy link nearly every message comes this way. So it does what the rest of `note` would do, in one place.
        """
        stream.unripe = ALL_RIPE
        sender = self._sender
        round_trip = sender.round_trip
        if answered is not None:
            if answered.kind is _GAP:
                round_trip.learn(now - answered.repeated_at)
            del self.questions[stream_id]
        if not self._guesses or now >= round_trip.lossy_until:
            return
        if round_trip.smoothed_s is not None:
            wait_s = sender.patience_s(now, 0)
        elif self._overtaking is not None:
            wait_s = UNMEASURED_S
        else:
            return
        guess = _Question(stream, (stream.last_handled + 1) & 0xFFFF, _GUESS, now)
        guess.repeat_at = now + wait_s
        self.questions[stream_id] = guess

    def _ripen(self, stream_id: int, stream: ReliableInput, now: float, delay_s: float) -> float | None:
        """Have only those reported that are late enough; returns when the next one is."""
        if not delay_s or self._overtaking is None:
            stream.unripe = ALL_RIPE
            return None
        stream.unripe, ripe_at = self._overtaking.unripe(stream_id, stream, now)
        return ripe_at

    def _current(self, stream_id: int, first: int, bits: int, now: float) -> _Question | None:
        """The open question, if it is still about the same; one that was answered is a measurement."""
        question = self.questions.get(stream_id)
        if question is None:
            return None
        if question.first == first and (question.kind is _GAP) == (bits != 0):
            return question
        if question.kind is _GAP and question.first != first:
            self._sender.round_trip.learn(now - question.repeated_at)
        del self.questions[stream_id]
        return None

    def _plan(  # noqa: PLR0917 - what it depends on
        self,
        stream_id: int,
        stream: ReliableInput,
        question: _Question | None,
        first: int,
        bits: int,
        now: float,
        delay_s: float,
        ripe_at: float | None,
    ) -> None:
        """An ACKNACK goes now; when must another one, if nothing comes?"""
        round_trip = self._sender.round_trip
        is_lossy = now < round_trip.lossy_until
        if bits:
            kind, most = _GAP, REPEATS_MAX
        elif ripe_at is not None:
            kind, most = _LATER, REPEATS_MAX
        elif self._guesses and is_lossy:
            kind, most = _GUESS, GUESSES_MAX
        else:
            self.questions.pop(stream_id, None)
            return
        if question is None or question.kind is not kind:
            question = _Question(stream, first, kind, now)
        if kind is _LATER and ripe_at is not None:
            question.repeat_at = ripe_at
        elif question.repeated >= most and not (is_lossy and self._overtaking is not None):
            self.questions.pop(stream_id, None)
            return
        elif round_trip.smoothed_s is not None:
            longest_s = GUESS_RAREST_S if kind is _GUESS and question.repeated > GUESSES_MAX else None
            question.repeat_at = now + max(self._sender.patience_s(now, question.repeated, longest_s), delay_s)
        elif self._overtaking is not None:
            rarer = 1 << min(question.repeated, RAREST)
            question.repeat_at = now + max(UNMEASURED_S * rarer, delay_s)
        else:
            self.questions.pop(stream_id, None)
            return
        self.questions[stream_id] = question
