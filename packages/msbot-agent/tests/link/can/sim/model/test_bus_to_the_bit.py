"""The simulated bus at one bit a second, so that times are bits and two of them may be equal."""

from __future__ import annotations

from itertools import pairwise

import pytest

from msbot_agent.link.can.controller import BusState
from msbot_agent.link.can.protocol.bits import frame_bits
from msbot_agent.link.can.protocol.frames import Frame
from msbot_agent.link.can.sim.model.events import BusEvent, Delivered, Sent, StateChanged
from msbot_agent.link.can.sim.model.sim_bus import SimBus
from msbot_xrce.errors import LocalProtocolError

FRAME = Frame(0x100, b"1")
LENGTH = sum(frame_bits(FRAME))
"""Intermission included."""
ACK_SLOT = LENGTH - 3 - 7 - 1 - 1
"""When it begins: before it, end of frame and intermission, is the ACK delimiter."""


def bus_of(*names: str) -> tuple[SimBus, list[int]]:
    bus = SimBus(1)
    return bus, [bus.attach(name) for name in names]


def heard(events: list[BusEvent]) -> list[tuple[int, int]]:
    """(receiver, identifier) in order."""
    return [(node, event.frame.can_id) for event in events if isinstance(event, Delivered) for node in event.nodes]


def sent(events: list[BusEvent]) -> list[int]:
    return [event.frame.can_id for event in events if isinstance(event, Sent)]


def go_off(bus: SimBus, node: int) -> float:
    """Drive it off the bus; returns when that is over."""
    bus.short_circuit(0.0)
    bus.submit(node, FRAME, 0.0)
    bus.advance(1e4)
    assert bus.state(node) is BusState.OFF
    bus.repair(1e4)
    return 1e4


def test_the_data_phase_may_be_as_slow_as_the_rest_but_no_slower() -> None:
    assert SimBus(500_000, 500_000, fd=True).data_bitrate == 500_000
    for wrong in ((500_000, 499_999), (0, None), (-1, None)):
        with pytest.raises(LocalProtocolError, match="the data rate is the higher one"):
            SimBus(*wrong)


def test_the_books_of_the_bus() -> None:
    bus, (a, _) = bus_of("A", "B")
    for start in (10.0, 200.0):
        bus.submit(a, FRAME, start)
        bus.advance(start + 150.0)
    assert (bus.counters.frames, bus.counters.bits, bus.counters.busy_s) == (2, 2 * LENGTH, 2.0 * LENGTH)
    assert bus.load(350.0) == 0


@pytest.mark.parametrize("late", [0.0, 0.5, 1.0, 1.5])
def test_a_flip_or_a_frame_is_for_this_attempt_until_its_first_bit_is_over(late: float) -> None:
    bus, (a, b, _) = bus_of("A", "B", "C")
    bus.submit(a, FRAME, 0.0)
    bus.submit(b, Frame(0x001), late)
    bus.flip_bit(20, late)
    events = bus.advance(1000.0)
    assert sent(events) == ([0x001, 0x100] if late < 1 else [0x100, 0x001])
    ends = [event.at for event in events if isinstance(event, Sent)]
    second = Frame(0x001) if late >= 1 else FRAME
    was_first_disturbed = ends[0] > 1.5 + LENGTH
    assert was_first_disturbed == (late < 1)
    assert (ends[1] - ends[0] == sum(frame_bits(second))) == (late < 1)


def test_who_gets_ready_when_the_first_bit_of_another_is_over_waits_for_its_end() -> None:
    bus, (a, b, _) = bus_of("A", "B", "C")
    bus.unplug(b, 0.0)
    bus.submit(b, Frame(0x001), 0.0)
    bus.plug(b, 100.0)  # 11 recessive bits later it may send
    assert bus.is_plugged(b)
    bus.submit(a, FRAME, 110.0)
    assert sent(bus.advance(1000.0)) == [0x100, 0x001]


def test_a_controller_is_back_before_the_frame_that_begins_at_that_moment() -> None:
    bus, (a, b, _) = bus_of("A", "B", "C")
    repaired = go_off(bus, a)
    bus.restart(a, repaired)
    back = repaired + 128 * 11
    bus.submit(b, Frame(0x200), back)
    assert bus.next_event_at() == back
    events = bus.advance(back + LENGTH)
    assert isinstance(events[0], StateChanged)
    assert events[0].at == back
    assert (a, 0x200) in heard(events)


def test_a_controller_restarted_during_a_frame_counts_from_its_end_on() -> None:
    bus, (a, b, _) = bus_of("A", "B", "C")
    repaired = go_off(bus, a)
    bus.submit(b, FRAME, repaired)
    bus.restart(a, repaired + 20)
    bus.advance(repaired + LENGTH)
    # The delimiter of the ACK slot, the end of frame and the intermission are the first of 128 sequences.
    assert bus.next_event_at() == repaired + LENGTH + 127 * 11


@pytest.mark.parametrize(("cut", "is_acknowledged"), [(ACK_SLOT - 0.5, False), (ACK_SLOT, True), (ACK_SLOT + 1, True)])
def test_a_frame_is_acknowledged_by_who_is_there_when_the_ack_slot_begins(cut: float, is_acknowledged: bool) -> None:
    bus, (a, b) = bus_of("A", "B")
    bus.submit(a, FRAME, 0.0)
    bus.unplug(b, cut)
    events = bus.advance(LENGTH)
    assert (sent(events), heard(events)) == ([0x100] if is_acknowledged else [], [])


def test_who_is_unplugged_before_an_error_does_not_count_it() -> None:
    bus, (a, b, c) = bus_of("A", "B", "C")
    bus.flip_bit(30, 0.0)
    bus.submit(a, FRAME, 0.0)
    bus.unplug(c, 10.0)
    bus.advance(60.0)
    assert [bus.error_counters(node) for node in (a, b, c)] == [(8, 0), (0, 1), (0, 0)]
    bus.advance(1000.0)
    assert [bus.error_counters(node) for node in (a, b, c)] == [(7, 0), (0, 0), (0, 0)], "a frame has gone well"


def test_of_two_that_send_the_same_frame_one_may_go() -> None:
    bus, (a, b, c) = bus_of("A", "B", "C")
    for node in (a, b):
        bus.submit(node, FRAME, 0.0)
    bus.unplug(a, 10.0)
    events = bus.advance(LENGTH)
    assert [(event.node, event.at) for event in events if isinstance(event, Sent)] == [(b, LENGTH - 3)]
    assert (heard(events), bus.pending(a), bus.pending(b)) == ([(c, 0x100)], 1, 0)


def test_a_sender_that_is_unplugged_before_an_error_does_not_count_it() -> None:
    bus, (a, b, _) = bus_of("A", "B", "C")
    for node in (a, b):
        bus.submit(node, FRAME, 0.0)
    bus.flip_bit(30, 0.0)
    bus.unplug(a, 10.0)
    bus.advance(60.0)
    assert (bus.error_counters(a), bus.error_counters(b)) == ((0, 0), (8, 0))


def test_a_frame_counts_when_receivers_have_it_though_its_sender_has_gone() -> None:
    bus, (a, b) = bus_of("A", "B")
    bus.submit(a, FRAME, 0.0)
    bus.unplug(a, ACK_SLOT + 1.0)
    assert heard(bus.advance(1000.0)) == [(b, 0x100)]
    assert (bus.counters.frames, bus.counters.errors) == (1, 0)


@pytest.mark.parametrize("at", [0.0, 0.5, 1.0, 20.5])
def test_a_short_circuit_lets_no_frame_through_whenever_it_comes(at: float) -> None:
    bus, (a, b) = bus_of("A", "B")
    bus.submit(a, FRAME, 0.0)
    bus.short_circuit(at)
    events = bus.advance(3000.0)
    assert (sent(events), heard(events), bus.state(a), bus.state(b)) == ([], [], BusState.OFF, BusState.ACTIVE)
    first = "the bus is short-circuited" if at < 1 else "the bus was short-circuited"
    assert next(iter(bus.counters.by_error)) == first


def test_a_broken_sender_harms_only_its_own_frames_and_not_those_that_it_lets_pass() -> None:
    bus, (a, b, c) = bus_of("A", "B", "C")
    bus.break_sender(a, broken=True)
    bus.submit(a, FRAME, 0.0)
    bus.submit(b, Frame(0x001), 0.0)
    events = bus.advance(60.0)
    assert heard(events) == [(a, 0x001), (c, 0x001)], "arbitration is fair"
    assert bus.counters.errors == 0
    bus.advance(120.0)
    assert [bus.error_counters(node) for node in (a, b, c)] == [(8, 0), (0, 1), (0, 1)], "it is the sender's error"
    bus.break_sender(a, broken=False)  # from the frame after that on which has begun
    events = bus.advance(1000.0)
    assert sent(events) == [0x100]
    assert bus.counters.by_error == {"a bit was disturbed": 2}
    bus.break_sender(a, broken=True)
    bus.submit(a, FRAME, 1000.0)
    bus.advance(1e5)
    assert bus.state(a) is BusState.OFF


@pytest.mark.parametrize("frame", [Frame(0), Frame(0x7FF, bytes(8)), Frame(0x1FFFFFFF, extended=True)])
def test_a_broken_sender_never_wins_nor_loses_arbitration_by_it(frame: Frame) -> None:
    bus, (a, b) = bus_of("A", "B")
    bus.break_sender(a, broken=True)
    bus.submit(a, frame, 0.0)
    bus.advance(float(sum(frame_bits(frame))))
    assert (bus.error_counters(a), bus.error_counters(b)) == ((8, 0), (0, 1))


def test_deafness_ends_when_it_is_told_so() -> None:
    bus, (a, b, _) = bus_of("A", "B", "C")
    bus.deafen(b, frames=5)
    bus.deafen(b)
    bus.submit(a, FRAME, 0.0)
    assert (b, 0x100) in heard(bus.advance(1000.0))


def test_frames_back_to_back_leave_no_bit_between_them() -> None:
    bus, (a, b, _) = bus_of("A", "B", "C")
    for node, can_id in ((a, 1), (b, 2), (a, 3), (b, 4)):
        bus.submit(node, Frame(can_id), 0.0)
    ends = [event.at + 3 for event in bus.advance(1000.0) if isinstance(event, Sent)]
    lengths = [sum(frame_bits(Frame(can_id))) for can_id in (1, 2, 3, 4)]
    assert ends[0] == lengths[0]
    assert [after - before for before, after in pairwise(ends)] == lengths[1:]
