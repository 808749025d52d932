"""Stock clients await answers one by one; where messages get lost, only one STATUS may be on its way."""

from __future__ import annotations

import pytest

from msbot_xrce.messages.objects import write_status
from msbot_xrce.messages.submessage import Envelope, data_submessage
from msbot_xrce.streams.session_output import SessionOutput
from msbot_xrce.streams.settings import SessionCounters, SessionSettings

RELIABLE = 0x80
STATUS, DATA = 5, 9


def sender(*, is_stock: bool = True) -> SessionOutput:
    settings = SessionSettings(packs=True, peer_is_stock=is_stock)
    return SessionOutput(Envelope(0x81, 1, 512, pads=False), SessionCounters(), settings)


def kinds(packets: list[bytes]) -> list[int]:
    """The kind of the first submessage in each message."""
    return [packet[4] for packet in packets]


def book(output: SessionOutput, *bodies: bytes) -> list[int]:
    """Book submessages; the kinds that leave at once."""
    stream = output.reliable(RELIABLE)
    assert stream is not None
    for body in bodies:
        assert stream.send(body, 100)
    return kinds(output.pull(0.0))


def status(number: int) -> bytes:
    return write_status(number, 0x0015, 0)


SAMPLE = data_submessage(DATA, 1, 0x0016, b"12345678")


@pytest.mark.promise("A stock client sees the answer to each request, whatever is lost")
def test_after_a_loss_nothing_follows_a_status_before_the_client_has_it() -> None:
    output = sender()
    assert book(output, SAMPLE, status(10), status(11)) == [DATA, STATUS, STATUS], "nothing was lost yet"
    assert output.acknowledged(RELIABLE, 0, 0b001, 1.0) is False
    assert kinds(output.pull(1.0)) == [DATA], "the lost one again"
    output.acknowledged(RELIABLE, 3, 0, 1.1)
    assert book(output, status(12), status(13), SAMPLE) == [STATUS]
    output.acknowledged(RELIABLE, 4, 0, 1.2)
    assert kinds(output.pull(1.2)) == [STATUS]
    assert kinds(output.pull(1.3)) == []
    output.acknowledged(RELIABLE, 5, 0, 1.4)
    assert kinds(output.pull(1.4)) == [DATA], "samples wait for it, too, and in order"
    assert book(output, SAMPLE, SAMPLE) == [DATA], "between samples nothing changes: they share a message"


def test_samples_that_may_be_refused_are_booked_behind_a_status() -> None:
    output = sender()
    book(output, SAMPLE)
    output.acknowledged(RELIABLE, 0, 1, 1.0)
    output.pull(1.0)
    output.acknowledged(RELIABLE, 1, 0, 1.1)
    stream = output.reliable(RELIABLE)
    assert stream is not None
    assert book(output, status(10)) == [STATUS]
    assert stream.offer(SAMPLE)
    assert kinds(output.pull(1.2)) == []
    output.acknowledged(RELIABLE, 2, 0, 1.3)
    assert kinds(output.pull(1.3)) == [DATA]


def test_a_client_of_ours_gets_them_as_fast_as_they_come() -> None:
    output = sender(is_stock=False)
    book(output, SAMPLE)
    output.acknowledged(RELIABLE, 0, 1, 1.0)
    output.pull(1.0)
    output.acknowledged(RELIABLE, 1, 0, 1.1)
    assert book(output, status(10), status(11)) == [STATUS], "both in one message"


def test_a_status_that_is_lost_itself_comes_again_and_then_the_next() -> None:
    output = sender()
    book(output, SAMPLE)
    output.acknowledged(RELIABLE, 0, 1, 1.0)
    output.pull(1.0)
    output.acknowledged(RELIABLE, 1, 0, 1.1)
    assert book(output, status(10), status(11)) == [STATUS]
    due = output.timer()
    assert due is not None
    output.handle_timer(due)
    (heartbeat,) = output.pull(due)
    assert heartbeat[4] == 0x0B
    output.acknowledged(RELIABLE, 1, 1, due + 0.01)
    assert kinds(output.pull(due + 0.01)) == [STATUS]
    output.acknowledged(RELIABLE, 2, 0, due + 0.02)
    assert kinds(output.pull(due + 0.02)) == [STATUS]
