"""What of a topic concerns a client, and what stands in front of it."""

from __future__ import annotations

from msbot_agent.agent.endpoints import NoEchoShape, ReplyShape, RequestShape
from msbot_agent.agent.reply_routing import UNASKED, PendingRequests, encode_identity
from msbot_agent.space import Sample

ASKER = bytes(range(16))


def test_requests_carry_their_identity() -> None:
    shape = RequestShape()
    sample = Sample(b"body", ASKER, 5)
    assert shape.accepts(sample)
    assert shape.payload(sample) == encode_identity(ASKER, 5) + b"body"
    shape.sent(sample)
    assert not shape.is_filter


def test_replies_to_open_requests_of_the_present_writer_are_wanted_once() -> None:
    pending = PendingRequests(4)
    shape = ReplyShape(0x0017, pending)
    reply = Sample(b"body", bytes(16), 1, (ASKER, 5))
    assert not shape.accepts(reply)
    shape.guid = ASKER
    assert not shape.accepts(reply)
    pending.add(5, 0x1234)
    assert shape.accepts(reply)
    assert shape.payload(reply) == bytes.fromhex("1234 0017") + b"body"
    shape.sent(reply)
    assert not shape.accepts(reply)


def test_what_is_said_unasked_to_the_present_writer_comes_with_request_id_0_as_often_as_it_is_said() -> None:
    shape = ReplyShape(0x0017, PendingRequests(4))
    shape.guid = ASKER
    for _ in range(2):
        said = Sample(b"body", bytes(16), 1, (ASKER, UNASKED))
        assert shape.accepts(said)
        assert shape.payload(said) == bytes.fromhex("0000 0017") + b"body"
        shape.sent(said)
    assert not shape.accepts(Sample(b"body", bytes(16), 1, (bytes(16), UNASKED)))


def test_a_sample_that_is_no_reply_is_not_wanted() -> None:
    shape = ReplyShape(0x0017, PendingRequests(4))
    sample = Sample(b"body", ASKER, 1)
    assert not shape.accepts(sample)
    shape.sent(sample)


def test_without_echo_everybody_elses_samples_come_as_they_are() -> None:
    shape = NoEchoShape(lambda guid: guid == ASKER)
    assert not shape.accepts(Sample(b"own", ASKER, 1))
    other = Sample(b"other", bytes(16), 1)
    assert shape.accepts(other)
    assert shape.payload(other) == b"other"
    shape.sent(other)
