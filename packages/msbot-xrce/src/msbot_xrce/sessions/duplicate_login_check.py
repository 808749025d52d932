"""Whether a further answer to the login means that the agent has started its streams over.

The agent starts its streams over with every CREATE_CLIENT it gets. A client that repeated its login may thus get
several answers, each of which restarts the numbers of the agent's samples at 0. So every further answer that a
repetition explains restarts the input, as long as neither end has taken anything from the other. Later, nobody can see
whether a further answer is the copy of an old one or means that a late login has reached the agent, and to guess wrong
either way stops or loses samples. So the agent is asked: a HEARTBEAT that goes back to message 0 is answered with the
number that the agent expects, and only if that is 0 again, it has restarted.

An agent that knows the numbers of logins (`LoginProperty.NUMBER`) answers the copies of one with OK_MATCHED, and
starts nothing over. Once it has said so, there is no doubt.
"""

from __future__ import annotations

from msbot_xrce.messages.ids import STREAM_RELIABLE, Status
from msbot_xrce.messages.message import Heartbeat
from msbot_xrce.streams.session_output import SessionOutput


class DuplicateLoginCheck:
    """Counts the answers to a login, and asks the agent where they leave a doubt."""

    __slots__ = ("_answers", "_knows_numbers", "_sender", "ask_at")

    def __init__(self, sender: SessionOutput) -> None:
        self._sender = sender
        self._answers = 0
        self._knows_numbers = False
        self.ask_at: float | None = None
        """When to call `ask` again; None: there is no doubt."""

    def begin(self, status: int) -> None:
        """The login was answered for the first time."""
        self._answers = 1
        self._knows_numbers = status == Status.OK_MATCHED

    def is_ruled_out(self, status: int) -> bool:
        """Note the status of a further answer; True: the agent has not started over because of this login."""
        self._knows_numbers |= status == Status.OK_MATCHED
        return self._knows_numbers or status >= Status.ERR_DDS_ERROR

    def end(self) -> None:
        """The session is over, or begins anew."""
        self.ask_at = None

    def is_explained(self, tries: int) -> bool:
        """Note a further answer; False: there are more answers than logins were sent."""
        if self._answers >= tries:
            return False
        self._answers += 1
        return True

    @property
    def has_sent(self) -> bool:
        """Whether the agent has something to tell by: a reliable message was sent."""
        return self._sender.next_nr(STREAM_RELIABLE) != 0

    @property
    def has_arrived(self) -> bool:
        """Whether the agent has acknowledged a reliable message."""
        return self._sender.first_unacked(STREAM_RELIABLE) != 0

    def ask(self, now: float) -> None:
        """Ask what the agent expects."""
        last = (self._sender.next_nr(STREAM_RELIABLE) - 1) & 0xFFFF
        self._sender.answer(Heartbeat(0, last, STREAM_RELIABLE).encode())
        self.ask_at = now + self._sender.heartbeat_s

    def has_restarted(self, expected: int) -> bool:
        """Take the agent's answer, before what it acknowledges is noted; True: it expects message 0 again."""
        if self.ask_at is None:
            return False
        if expected or self.has_arrived:
            self.ask_at = None
        return self.has_arrived and not expected
