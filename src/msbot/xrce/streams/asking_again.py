"""When a receiver asks again for what is missing.

A gap is reported with the ACKNACK of the message that revealed it. If that report or the messages it asked for are
lost, too, nothing else may arrive that would reveal it, so the report is repeated after a while. On a lossy link the
newest messages may be missing as well, or the ACKNACK of the newest may be lost; the peer notices only with its own
timer, 100 ms later in C clients. So there, the message after the newest one is asked for too, a few times, as if it
were known to be missing. A peer that has it sends it at once, and one that has nothing more ignores the question.

The time from a report to the missing message is a measurement of the round trip: the only one in a session in which
the peer does all the sending.
"""

from __future__ import annotations

from msbot.xrce.streams.receiving_in_order import ReliableInput
from msbot.xrce.streams.session_output import SessionOutput

REPEATS_MAX = 8
"""How often the same gap is reported while nothing arrives; after that the peer must ask with a HEARTBEAT."""

GUESSES_MAX = 4
"""How often the message after the newest one is asked for."""


class _Question:
    """What is asked of one stream, and since when."""

    __slots__ = ("first", "is_guess", "repeat_at", "repeated", "repeated_at")

    def __init__(self, first: int, now: float, *, is_guess: bool) -> None:
        self.first = first
        """The number of the first message that is missing."""
        self.is_guess = is_guess
        self.repeated_at = now
        self.repeat_at = 0.0
        self.repeated = 0


class AskingAgain:
    """The open questions of a session, one for each stream at most."""

    __slots__ = ("_guesses", "_sender", "questions")

    def __init__(self, sender: SessionOutput, *, guesses: bool) -> None:
        """`guesses`: whether messages are asked for that may not exist."""
        self._sender = sender
        self._guesses = guesses
        self.questions: dict[int, tuple[ReliableInput, _Question]] = {}
        """The open ones, by stream; read-only."""

    def note(self, stream_id: int, stream: ReliableInput, now: float) -> None:
        """A message or a HEARTBEAT has come, and an ACKNACK says what the stream lacks.

        Not needed while it lacks nothing, nothing is asked, and nothing was lost of late.
        """
        questions, round_trip = self.questions, self._sender.round_trip
        has_gap = stream.announced != stream.last_handled and stream.missing()[1] != 0
        if has_gap:
            round_trip.note_loss(now)
        first = (stream.last_handled + 1) & 0xFFFF
        open_one = questions.get(stream_id)
        if open_one is not None:
            before = open_one[1]
            if before.first == first and before.is_guess is not has_gap:
                before.repeated = 0
                self._wait(stream_id, stream, before, now)
                return
            if not before.is_guess and before.first != first:
                round_trip.learn(now - before.repeated_at)
            del questions[stream_id]
        if has_gap or (self._guesses and round_trip.is_lossy(now)):
            self._wait(stream_id, stream, _Question(first, now, is_guess=not has_gap), now)

    def next_at(self) -> float | None:
        """When to call `ask`; None: nothing is asked."""
        return min((question.repeat_at for _, question in self.questions.values()), default=None)

    def ask(self, now: float) -> None:
        """Have the questions repeated that are due."""
        for stream_id, (stream, question) in list(self.questions.items()):
            if now >= question.repeat_at:
                self._sender.owed[stream_id] = stream
                if question.is_guess:
                    self._sender.guess(stream_id)
                question.repeated += 1
                question.repeated_at = now
                self._wait(stream_id, stream, question, now)

    def clear(self) -> None:
        """Forget all questions: the streams start over."""
        self.questions.clear()

    def _wait(self, stream_id: int, stream: ReliableInput, question: _Question, now: float) -> None:
        most = GUESSES_MAX if question.is_guess else REPEATS_MAX
        if question.repeated < most and self._sender.round_trip.smoothed_s is not None:
            question.repeat_at = now + self._sender.patience_s(now, question.repeated)
            self.questions[stream_id] = (stream, question)
        else:
            self.questions.pop(stream_id, None)
