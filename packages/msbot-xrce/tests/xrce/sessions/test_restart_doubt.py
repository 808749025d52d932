"""Answers to a login that may mean that the agent has started its streams over, beside a model in other words."""

from __future__ import annotations

from dataclasses import dataclass, field

from hypothesis import given
from hypothesis import strategies as st

from msbot_xrce.messages.ids import STREAM_RELIABLE, Status
from msbot_xrce.messages.message import Heartbeat
from msbot_xrce.sessions.duplicate_login_check import DuplicateLoginCheck


@dataclass
class Sender:
    """What the doubt asks of the session's output."""

    sent: int = 0
    """Reliable messages, from 0 on, that the number wraps behind."""
    acknowledged: int = 0
    heartbeat_s: float = 0.2
    answers: list[bytes] = field(default_factory=list)

    def next_nr(self, stream: int) -> int:
        assert stream == STREAM_RELIABLE
        return self.sent & 0xFFFF

    def first_unacked(self, stream: int) -> int:
        assert stream == STREAM_RELIABLE
        return self.acknowledged & 0xFFFF

    def answer(self, message: bytes) -> None:
        self.answers.append(message)


def doubt_of(sender: Sender) -> DuplicateLoginCheck:
    return DuplicateLoginCheck(sender)  # type: ignore[arg-type]


@given(tries=st.integers(1, 6), answers=st.integers(1, 12))
def test_as_many_answers_are_explained_as_logins_were_sent(tries: int, answers: int) -> None:
    doubt = doubt_of(Sender())
    for _ in range(2):
        doubt.begin(Status.OK)
        explained = [True, *(doubt.is_explained(tries) for _ in range(answers - 1))]
        assert explained == [number < tries for number in range(answers)]


@given(st.lists(st.sampled_from((Status.OK, Status.OK_MATCHED, Status.ERR_DENIED)), min_size=1, max_size=6))
def test_an_agent_that_knows_a_copy_of_the_login_for_one_leaves_no_doubt_nor_does_a_refusal(
    answers: list[Status],
) -> None:
    doubt = doubt_of(Sender())
    for _ in range(2):  # the next login begins with doubt again
        doubt.begin(answers[0])
        for index, status in enumerate(answers[1:], 1):
            knows = Status.OK_MATCHED in answers[: index + 1]
            assert doubt.is_ruled_out(status) == (knows or status is Status.ERR_DENIED)


@given(sent=st.integers(0, 0xFFFF), now=st.floats(0, 1e6))
def test_the_question_goes_back_to_the_first_message(sent: int, now: float) -> None:
    sender = Sender(sent)
    doubt = doubt_of(sender)
    assert doubt.has_sent == (sent > 0)
    assert not doubt.has_arrived
    assert doubt.ask_at is None
    doubt.ask(now)
    assert sender.answers == [Heartbeat(0, (sent - 1) % 65536, STREAM_RELIABLE).encode()]
    assert doubt.ask_at == now + 0.2
    doubt.end()
    assert doubt.ask_at is None


@given(acknowledged=st.integers(0, 5), expected=st.lists(st.sampled_from((0, 0, 1, 5, 0xFFFF)), min_size=1, max_size=6))
def test_the_agent_has_restarted_if_it_once_had_something_and_expects_the_first_again(
    acknowledged: int, expected: list[int]
) -> None:
    sender = Sender(5, acknowledged)
    doubt = doubt_of(sender)
    assert not doubt.has_restarted(0), "nobody has asked"
    doubt.ask(1.0)
    is_asking = True
    for number in expected:
        assert doubt.has_restarted(number) == (is_asking and acknowledged > 0 and number == 0)
        # Any other number says that it goes on; 0 of an agent that never had anything says nothing.
        is_asking = is_asking and acknowledged == 0 and number == 0
        assert (doubt.ask_at is not None) == is_asking
