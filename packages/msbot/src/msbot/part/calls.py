"""Calls from part to part: what a reply looks like, and which calls still wait for one. Pure: time in, outcomes out.

Theory of operation. A call is one request to the requester that belongs to the calling port; the agent hands back the
reply with the request's number. Each open call has an end: its reply, its timeout, or the loss of what it needs (the
part that serves, the way to the robot, the port's wire). Whichever comes first closes it; what comes later finds no
open call and is counted. A reply begins with one octet, its `ReplyStatus`: 0, then the reply message, or the reason why
there is none, then a sentence.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum

from msbot_xrce.counting import Tally
from msbot_xrce.errors import CallError, RemoteProtocolError
from msbot_xrce.lazy import dataclass

MOST_OPEN_CALLS = 16
"""Calls of one part that wait for their replies."""
MOST_SERVED = 8
"""Requests that one part serves at the same time: more than one only if its functions make calls themselves."""
LONGEST_TIMEOUT_S = 3600.0
LONGEST_SENTENCE = 180
"""Octets of the sentence in a reply."""


class ReplyStatus(IntEnum):
    """What a reply says of the request."""

    DONE = 0
    """The reply message follows."""
    STOPPED = 1
    BUSY = 2
    FAILED = 3
    UNREADABLE = 4
    NOT_SERVED = 5
    REFUSED = 6
    NOT_PASSED = 7
    """The robot itself replies: nobody gets the request now."""

    @property
    def describe(self) -> str:
        """Why there is no reply message, and what would help."""
        return _WORDS[self]


_CALL_OF = "call of "
_WORDS = {
    ReplyStatus.DONE: "it is done",
    ReplyStatus.STOPPED: "STOP is in force: call again after GO",
    ReplyStatus.BUSY: f"the part that serves it has {MOST_SERVED} requests already: call again later",
    ReplyStatus.FAILED: "the function that serves it failed",
    ReplyStatus.UNREADABLE: "the part that serves it cannot read the request",
    ReplyStatus.NOT_SERVED: "the program of the part has no function for it: write @part.serves(...)",
    ReplyStatus.REFUSED: "refused",
    ReplyStatus.NOT_PASSED: "the robot does not pass it on",
}


def encode_reply(status: ReplyStatus, body: bytes | str = b"") -> bytes:
    """A reply: the encoded message after DONE, else a sentence, which is cut to `LONGEST_SENTENCE` octets."""
    if isinstance(body, str):
        body = body.encode(errors="replace")[:LONGEST_SENTENCE]
    return bytes([status]) + body


def decode_reply(reply: bytes) -> bytes:
    """The encoded message of a reply.

    Raises:
        CallError: there is none; the text says why.
        RemoteProtocolError: it is no reply.
    """
    if not reply:
        raise RemoteProtocolError("a reply without its first byte")
    try:
        status = ReplyStatus(reply[0])
    except ValueError:
        raise RemoteProtocolError(f"a reply with status {reply[0]}, which this version does not know") from None
    if status is ReplyStatus.DONE:
        return reply[1:]
    said, words = sentence_of(reply[1:]), status.describe
    raise CallError(f"{words}: {said}" if said else words)


def refusal_words(error: CallError) -> str:
    """What a caller reads of a refusal; one that a function only passes on names the port that has refused."""
    port, mark, why = str(error).removeprefix(_CALL_OF).partition(f": {ReplyStatus.REFUSED.describe}: ")
    return f"{port}: {why}" if mark and str(error).startswith(_CALL_OF) and " " not in port else str(error)


def sentence_of(octets: bytes) -> str:
    """The sentence behind the status of a reply without a message."""
    return "".join(letter for letter in octets.decode(errors="ignore") if letter.isprintable())[:LONGEST_SENTENCE]


Done = Callable[[bytes | CallError], None]
"""Called once with a call's outcome: the encoded reply message, or why there is none."""


@dataclass(slots=True)
class _OpenCall:
    port: str
    timeout_s: float
    until: float
    done: Done


class OpenCalls:
    """The calls of one caller that wait for their replies, by the numbers of their requests."""

    def __init__(self, most: int = MOST_OPEN_CALLS) -> None:
        self.dropped = Tally()
        """Replies that changed nothing, by reason in words."""
        self._most = most
        self._open: dict[int, _OpenCall] = {}

    def __len__(self) -> int:
        return len(self._open)

    def check_room(self, port: str) -> None:
        """Refuse a call when too many are open.

        Raises:
            CallError: they are.
        """
        if len(self._open) >= self._most:
            raise CallError(f"{_CALL_OF}{port}: {self._most} calls wait for replies already: call more slowly")

    def open(self, number: int, port: str, timeout_s: float, now: float, done: Done) -> None:
        """A request has been sent; `done` is called once."""
        self._close(number, CallError(f"{_CALL_OF}{port}: another one has taken its number"))  # 65,536 requests later
        self._open[number] = _OpenCall(port, timeout_s, now + timeout_s, done)

    def replied(self, number: int, reply: bytes) -> None:
        """A reply has arrived; the first one to an open call ends it."""
        call = self._open.get(number)
        if call is None:
            self.dropped.count("reply to no open call: it came late, or twice")
            return
        try:
            outcome: bytes | CallError = decode_reply(reply)
        except CallError as error:
            outcome = CallError(f"{_CALL_OF}{call.port}: {error}")
        except RemoteProtocolError as error:
            self.dropped.count("reply that makes no sense")
            outcome = CallError(f"{_CALL_OF}{call.port}: {error}")
        self._close(number, outcome)

    def timer(self) -> float | None:
        """When `handle_timer` wants to be called next, or None."""
        return min((call.until for call in self._open.values()), default=None)

    def handle_timer(self, now: float) -> None:
        """End the calls that have waited long enough."""
        for number, call in list(self._open.items()):
            if now >= call.until:
                words = (
                    f"{_CALL_OF}{call.port}: no reply within {call.timeout_s:g} s: is the part there that serves it "
                    "(`msbot parts`), and does its function return in that time?"
                )
                self._close(number, CallError(words))

    def fail(self, why: str, port: str | None = None) -> None:
        """End all calls, or those of one port, for a reason in words."""
        for number, call in list(self._open.items()):
            if port in (None, call.port):
                self._close(number, CallError(f"{_CALL_OF}{call.port}: {why}"))

    def forget(self, number: int) -> None:
        """Whoever called does not wait any more."""
        self._open.pop(number, None)

    def _close(self, number: int, outcome: bytes | CallError) -> None:
        call = self._open.pop(number, None)
        if call is not None:
            call.done(outcome)
