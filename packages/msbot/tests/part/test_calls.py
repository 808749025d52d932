"""The table of open calls: each ends once, by its reply, its timeout or a loss, whatever comes in whatever order."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot.part.calls import (
    LONGEST_SENTENCE,
    MOST_OPEN_CALLS,
    OpenCalls,
    ReplyStatus,
    decode_reply,
    encode_reply,
)
from msbot_xrce.errors import CallError, RemoteProtocolError


class Outcomes(list[bytes | CallError]):
    """What became of the calls, in order."""

    @property
    def words(self) -> list[str]:
        return [str(one) for one in self if isinstance(one, CallError)]


def test_a_reply_ends_its_call_and_a_second_one_changes_nothing() -> None:
    calls, outcomes = OpenCalls(), Outcomes()
    calls.open(7, "ask", 1.0, 10.0, outcomes.append)
    assert calls.timer() == 11.0
    calls.replied(8, encode_reply(ReplyStatus.DONE, b"of another"))
    calls.replied(7, encode_reply(ReplyStatus.DONE, b"mine"))
    calls.replied(7, encode_reply(ReplyStatus.DONE, b"again"))
    assert outcomes == [b"mine"]
    assert calls.timer() is None
    assert sum(calls.dropped.values()) == 2


def test_a_call_without_a_reply_ends_at_its_time_and_what_comes_later_is_counted() -> None:
    calls, outcomes = OpenCalls(), Outcomes()
    calls.open(1, "ask", 0.5, 0.0, outcomes.append)
    calls.open(2, "ask", 2.0, 0.0, outcomes.append)
    calls.handle_timer(0.4)
    assert not outcomes
    calls.handle_timer(0.5)
    assert outcomes.words == [
        "call of ask: no reply within 0.5 s: is the part there that serves it (`msbot parts`), and does its function "
        "return in that time?"
    ]
    calls.replied(1, encode_reply(ReplyStatus.DONE, b"late"))
    assert len(calls) == 1
    assert calls.timer() == 2.0
    assert sum(calls.dropped.values()) == 1


@pytest.mark.parametrize("status", [one for one in ReplyStatus if one is not ReplyStatus.DONE])
def test_a_refusal_is_a_sentence(status: ReplyStatus) -> None:
    calls, outcomes = OpenCalls(), Outcomes()
    calls.open(1, "ask", 0.5, 0.0, outcomes.append)
    calls.replied(1, encode_reply(status, "the lid is open"))
    assert outcomes.words == [f"call of ask: {status.describe}: the lid is open"]


@pytest.mark.parametrize("octets", [b"", b"\x08", b"\xff text"])
def test_a_reply_that_makes_no_sense_ends_the_call_with_a_sentence(octets: bytes) -> None:
    calls, outcomes = OpenCalls(), Outcomes()
    calls.open(1, "ask", 0.5, 0.0, outcomes.append)
    calls.replied(1, octets)
    assert len(outcomes.words) == 1
    assert outcomes.words[0].startswith("call of ask: a reply ")


def test_sentences_are_bounded_and_can_be_printed() -> None:
    with pytest.raises(CallError) as caught:
        decode_reply(encode_reply(ReplyStatus.REFUSED, "\x1b[2Jé" * 1000))
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) <= LONGEST_SENTENCE + len("refused: ")


def test_losses_end_the_calls_of_one_port_or_all() -> None:
    calls, outcomes = OpenCalls(), Outcomes()
    calls.open(1, "left", 1.0, 0.0, outcomes.append)
    calls.open(2, "right", 1.0, 0.0, outcomes.append)
    calls.fail("the part that served it has left", "left")
    assert outcomes.words == ["call of left: the part that served it has left"]
    calls.fail("the part has ended")
    assert outcomes.words[1:] == ["call of right: the part has ended"]
    assert len(calls) == 0


def test_open_calls_are_bounded() -> None:
    calls = OpenCalls()
    for number in range(MOST_OPEN_CALLS):
        calls.check_room("ask")
        calls.open(number, "ask", 1.0, 0.0, lambda _: None)
    with pytest.raises(CallError, match="16 calls wait for replies already"):
        calls.check_room("ask")


def test_a_number_that_is_used_again_ends_the_older_call() -> None:
    calls, older, newer = OpenCalls(), Outcomes(), Outcomes()
    calls.open(1, "ask", 1.0, 0.0, older.append)
    calls.open(1, "ask", 1.0, 0.0, newer.append)
    calls.replied(1, encode_reply(ReplyStatus.DONE, b"x"))
    assert older.words == ["call of ask: another one has taken its number"]
    assert newer == [b"x"]


@given(st.binary(max_size=400))
def test_any_octets_are_a_reply_or_a_sentence(octets: bytes) -> None:
    try:
        found = decode_reply(octets)
    except (CallError, RemoteProtocolError) as error:
        words = str(error)
    else:
        words = ""
        assert found == octets[1:]
    assert words.isprintable()


@given(st.lists(st.tuples(st.sampled_from("orthf"), st.integers(0, 3), st.floats(0.01, 2.0)), max_size=60))
def test_every_call_ends_exactly_once(steps: list[tuple[str, int, float]]) -> None:
    calls, ends, now, opened = OpenCalls(), [0] * len(steps), 0.0, 0
    for step, number, seconds in steps:
        match step:
            case "o":

                def done(_: object, which: int = opened) -> None:
                    ends[which] += 1

                calls.open(number, f"port{number}", seconds, now, done)
                opened += 1
            case "r":
                calls.replied(number, encode_reply(ReplyStatus.DONE))
            case "t":
                now += seconds
                calls.handle_timer(now)
            case "h":
                calls.replied(number, b"")
            case "f":
                calls.fail("gone", f"port{number}")
    calls.fail("over")
    assert ends[:opened] == [1] * opened
