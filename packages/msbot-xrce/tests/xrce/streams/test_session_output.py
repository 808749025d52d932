"""The sending half of a session."""

from __future__ import annotations

from dataclasses import replace

import pytest

from msbot_xrce.errors import LocalProtocolError
from msbot_xrce.messages.submessage import Envelope
from msbot_xrce.streams.receiving_in_order import ReliableInput
from msbot_xrce.streams.sending_best_effort import TOO_LARGE
from msbot_xrce.streams.session_output import ANSWERS_FULL, STREAM_LIMIT, SessionOutput
from msbot_xrce.streams.settings import Memory, SessionCounters, SessionSettings


def make_sender(**changes: int) -> tuple[SessionOutput, SessionCounters]:
    counters = SessionCounters()
    settings = replace(SessionSettings(window=4, queue_limit=4, max_streams=2), **changes)  # type: ignore[arg-type]
    return SessionOutput(Envelope(0x81, 1, 24, pads=False), counters, settings), counters


def hexes(packets: list[bytes]) -> list[str]:
    return [packet.hex() for packet in packets]


def reliable(sender: SessionOutput, stream_id: int, *bodies: bytes) -> None:
    stream = sender.reliable(stream_id)
    assert stream is not None
    for body in bodies:
        stream.send(body)


def test_messages_of_all_streams_leave_in_the_order_of_booking() -> None:
    sender, counters = make_sender()
    reliable(sender, 0x80, b"a")
    sender.answer(b"b")
    sender.send_unacknowledged(b"c", 1)
    sender.send_unacknowledged(b"d", 0)
    stream = ReliableInput(8, Memory(1000), counters)
    for number in (0, 1, 2, 3, 4, 6, 7):
        stream.accept(number, b"x")
        sender.owed[0x80] = stream
    assert hexes(sender.pull(0.0, limit=2)) == ["8180000061", "8100000062"]
    assert hexes(sender.pull(0.0)) == ["8101000063", "8100000064", "810000000a0105000500000180"]
    assert sender.is_idle
    assert counters.packets_out == 5


def test_what_is_missing_goes_first_and_counts_against_the_limit() -> None:
    sender, _ = make_sender()
    reliable(sender, 0x80, b"a", b"b")
    reliable(sender, 0x81, b"x")
    sender.pull(0.0)
    reliable(sender, 0x80, b"c")
    sender.acknowledged(0x80, 0, 0b11, 0.0)
    sender.acknowledged(0x81, 0, 0b1, 0.0)
    assert not sender.is_idle
    assert hexes(sender.pull(0.0, limit=1)) == ["8180000061"]
    assert hexes(sender.pull(0.0, limit=2)) == ["8180010062", "8181000078"]
    assert hexes(sender.pull(0.0, limit=2)) == ["8180020063"]


def test_no_heartbeat_while_anything_waits_for_the_link() -> None:
    sender, counters = make_sender()
    reliable(sender, 0x80, b"a", b"b")
    sender.pull(0.0, limit=1)
    assert sender.timer() is None
    sender.handle_timer(10.0)
    assert len(sender.pull(10.0)) == 1
    assert sender.timer() == 10.2
    sender.acknowledged(0x80, 0, 0b1, 10.1)
    assert sender.timer() is None, "a message is to be sent again: ask only after it"
    sender.handle_timer(10.3)
    assert hexes(sender.pull(10.3)) == ["8180000061"]
    sender.handle_timer(10.4)
    assert sender.timer() == 10.5
    sender.handle_timer(10.5)
    assert sender.timer() is None
    assert hexes(sender.pull(10.5)) == ["810000000b0105000000010080"]
    assert sender.timer() == 10.7
    assert counters.heartbeats_out == 1


def test_the_heartbeat_period_can_be_changed_at_any_time() -> None:
    sender, _ = make_sender()
    sender.heartbeat_s = 2.0
    reliable(sender, 0x80, b"a")
    reliable(sender, 0x81, b"b")
    sender.pull(0.0)
    assert sender.timer() == 2.0


def test_an_acknowledgement_stops_the_heartbeat_without_another_pull() -> None:
    sender, _ = make_sender()
    reliable(sender, 0x80, b"a", b"b")
    sender.pull(0.0)
    sender.acknowledged(0x80, 1, 0, 0.1)
    assert sender.timer() == pytest.approx(0.3)
    sender.acknowledged(0x80, 2, 0, 0.2)
    assert sender.timer() is None


def test_room_is_announced_only_to_those_who_were_refused() -> None:
    sender, _ = make_sender(window=1)
    reliable(sender, 0x80, b"a")
    sender.pull(0.0)
    stream = sender.reliable(0x80)
    assert stream is not None
    assert not sender.acknowledged(0x80, 1, 0, 0.0)
    stream.send(b"b")
    stream.refused = True
    assert not sender.acknowledged(0x80, 1, 0, 0.0)
    assert sender.acknowledged(0x80, 2, 0, 0.0)
    assert not stream.refused


def test_acknacks_of_unknown_streams_mean_nothing() -> None:
    sender, counters = make_sender()
    assert not sender.acknowledged(0x85, 0, 0xFFFF, 0.0)
    assert counters.dropped == {}


def test_what_fits_no_message_is_dropped_or_refused() -> None:
    sender, counters = make_sender()
    sender.send_unacknowledged(bytes(21), 0)
    sender.send_unacknowledged(bytes(21), 1)
    assert counters.dropped == {TOO_LARGE: 2}
    with pytest.raises(LocalProtocolError, match="use a reliable stream"):
        sender.pack(bytes(21), 1)
    sender.pack(bytes(21), 0x80)
    assert len(sender.pull(0.0)) == 2


def test_streams_are_limited() -> None:
    sender, counters = make_sender()
    for stream_id in (1, 2):
        sender.pack(b"x", stream_id)
        sender.pack(b"y", stream_id + 0x80)
    sender.send_unacknowledged(b"z", 3)
    assert counters.dropped == {STREAM_LIMIT: 1}
    for stream_id in (3, 0x83):
        with pytest.raises(LocalProtocolError, match="too many streams"):
            sender.pack(b"z", stream_id)
    sender.pack(b"n", 0)
    sender.flush()
    packets = hexes(sender.pull(0.0))
    assert packets == ["810000006e", "8181000079", "8182000079", "8101000078", "8102000078"]


def test_old_answers_give_way_to_new_ones() -> None:
    sender, counters = make_sender(queue_limit=2)
    for body in (b"a", b"b", b"c"):
        sender.answer(body)
    assert hexes(sender.pull(0.0)) == ["8100000062", "8100000063"]
    assert counters.dropped == {ANSWERS_FULL: 1}


def test_after_a_reset_every_stream_counts_from_0_again() -> None:
    sender, _ = make_sender()
    for _ in range(2):
        sender.send_unacknowledged(b"a", 1)
        reliable(sender, 0x80, b"b")
        assert hexes(sender.pull(0.0)) == ["8101000061", "8180000062"]
        sender.reset()


def test_reset_begins_anew_and_names_the_streams_that_had_no_room() -> None:
    sender, _ = make_sender(window=1)
    reliable(sender, 0x80, b"a", b"b")
    reliable(sender, 0x81, b"c")
    sender.send_unacknowledged(b"d", 1)
    stream = sender.reliable(0x80)
    assert stream is not None
    stream.refused = True
    assert sender.waiting(0x80) == 1
    assert sender.reset() == [0x80]
    assert sender.is_idle
    assert sender.waiting(0x80) == 0
    assert sender.reset(Envelope(0x82, 1, 24, pads=False)) == []
    reliable(sender, 0x80, b"a")
    assert hexes(sender.pull(0.0)) == ["8280000061"]


def test_a_finished_message_has_a_number_of_its_own_before_it_is_booked() -> None:
    sender, _ = make_sender()
    for stream_id in (1, 0x80):
        sender.pack(b"aaaa", stream_id)
        assert sender.finish_message(stream_id) == 1
        sender.pack(b"bbbb", stream_id)
        assert sender.finish_message(stream_id) == 2
    assert sender.finish_message(2) is None
    assert hexes(sender.pull(0.0)) == ["8101000061616161", "8101010062626262", "8180000061616161", "8180010062626262"]


@pytest.mark.parametrize("order", [(0x80, 0x81), (0x81, 0x80)])
def test_the_timer_is_that_of_the_stream_that_has_waited_longest(order: tuple[int, int]) -> None:
    sender, _ = make_sender()
    for stream_id in (0x80, 0x81):
        reliable(sender, stream_id)
    for now, stream_id in zip((0.0, 0.05), order, strict=True):
        reliable(sender, stream_id, b"a")
        sender.pull(now)
        if not now:
            first = sender.timer()
    assert first is not None
    assert sender.timer() == first
