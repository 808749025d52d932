"""The simulated bus, with literal times."""

from __future__ import annotations

from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msbot_agent.link.can.controller import BusState
from msbot_agent.link.can.protocol.bits import frame_bits
from msbot_agent.link.can.protocol.frames import Frame
from msbot_agent.link.can.sim.model.events import BusEvent, Delivered, Sent, StateChanged
from msbot_agent.link.can.sim.model.sim_bus import MAILBOXES, SimBus
from msbot_xrce.errors import LinkDown, LinkFull, LocalProtocolError
from tests.effort import tries

RATE = 500_000
BIT = 1 / RATE


def bus_of(*names: str, **settings: float | Random) -> tuple[SimBus, list[int]]:
    bus = SimBus(RATE, fd=True, data_bitrate=2_000_000, **settings)  # type: ignore[arg-type]  # test shorthand
    return bus, [bus.attach(name) for name in names]


def deliveries(events: list[BusEvent]) -> list[tuple[int, int]]:
    """(receiver, identifier) in order."""
    return [(node, event.frame.can_id) for event in events if isinstance(event, Delivered) for node in event.nodes]


def seconds(frame: Frame) -> float:
    return frame_bits(frame).seconds(RATE, 2_000_000)


def test_a_frame_arrives_at_everybody_else_at_its_end_and_the_bus_is_free_3_bits_later() -> None:
    bus, (a, b, c) = bus_of("A", "B", "C")
    first, second = Frame(0x123, b"12345678"), Frame(0x124, b"x")
    bus.submit(a, first, 1.0)
    bus.submit(a, second, 1.0)
    assert bus.pending(a) == 2
    end = 1.0 + seconds(first) - 3 * BIT
    assert bus.next_event_at() == pytest.approx(end)
    assert bus.advance(end - 1e-9) == []
    events = bus.advance(end + 1e-9)
    assert {type(event) for event in events} == {Delivered, Sent}
    assert deliveries(events) == [(b, 0x123), (c, 0x123)]
    assert all(event.at == pytest.approx(end) for event in events)
    assert bus.next_event_at() == pytest.approx(1.0 + seconds(first) + seconds(second) - 3 * BIT)
    bus.advance(2.0)
    assert (bus.counters.frames, bus.counters.errors) == (2, 0)
    assert bus.counters.bits == sum(frame_bits(first)) + sum(frame_bits(second))
    assert bus.next_event_at() is None


def test_a_bit_rate_switch_shortens_the_data_phase() -> None:
    bus, (a, _) = bus_of("A", "B")
    frame = Frame(0x123, bytes(64), fd=True, brs=True)
    bus.submit(a, frame, 0.0)
    nominal, fast = frame_bits(frame)
    assert bus.next_event_at() == pytest.approx((nominal - 3) * 2e-6 + fast * 0.5e-6)


@pytest.mark.parametrize(
    ("winner", "loser"),
    [
        (Frame(0x100), Frame(0x101)),
        (Frame(0x123), Frame(0x123, remote=True)),
        (Frame(0x123, b"x"), Frame(0x123 << 18, extended=True)),
        (Frame(0x123, remote=True), Frame(0x123 << 18, extended=True)),
        (Frame(0x122 << 18 | 0x3FFFF, extended=True), Frame(0x123)),
        (Frame(0x1E000000, extended=True), Frame(0x1E000001, extended=True)),
    ],
)
def test_arbitration_is_won_by_the_first_dominant_bit(winner: Frame, loser: Frame) -> None:
    bus, (a, b, c) = bus_of("A", "B", "C")
    bus.submit(a, loser, 0.0)
    bus.submit(b, winner, 0.0)
    events = bus.advance(1.0)
    assert [event.frame for event in events if isinstance(event, Sent)] == [winner, loser]
    assert [event.frame for event in events if isinstance(event, Delivered) and c in event.nodes] == [winner, loser]
    assert bus.counters.errors == 0


def test_who_gets_ready_within_the_first_bit_still_takes_part() -> None:
    for late, order in ((0.9 * BIT, [0x100, 0x200]), (1.1 * BIT, [0x200, 0x100])):
        bus, (a, b, _) = bus_of("A", "B", "C")
        bus.submit(a, Frame(0x200), 0.0)
        bus.submit(b, Frame(0x100), late)
        assert [event.frame.can_id for event in bus.advance(1.0) if isinstance(event, Sent)] == order


def test_a_controller_tries_the_lowest_identifier_first_and_keeps_the_order_of_equal_ones() -> None:
    bus, (a, b) = bus_of("A", "B")
    for can_id, data in ((0x300, b"1"), (0x300, b"2"), (0x100, b"3")):
        bus.submit(a, Frame(can_id, data), 0.0 if can_id == 0x300 else 50e-6)
    got = [event.frame.data for event in bus.advance(1.0) if isinstance(event, Delivered) and b in event.nodes]
    assert got == [b"1", b"3", b"2"], "0x100 came while the first was under way"


def test_frames_keep_their_order_while_the_bus_catches_up_with_the_clock() -> None:
    bus, (a, _) = bus_of("A", "B")
    first, second, third = (Frame(0x123, bytes((n,))) for n in range(3))
    bus.submit(a, first, 0.0)
    bus.submit(a, second, 0.005)  # from outside, when the first frame should have been over for long
    (heard, sent) = bus.advance(0.005)
    assert isinstance(heard, Delivered)
    assert heard.frame == first
    bus.submit(a, third, sent.at)  # the answer to what happened then
    assert [event.frame for event in bus.advance(1.0) if isinstance(event, Delivered)] == [second, third]


def test_a_lone_node_repeats_gets_passive_and_never_off_and_is_heard_once_somebody_comes() -> None:
    bus, (a,) = bus_of("A")
    frame = Frame(0x100, b"hello")
    bus.submit(a, frame, 0.0)
    events = bus.advance(0.5)
    assert [event.state for event in events if isinstance(event, StateChanged)] == [BusState.PASSIVE]
    assert (bus.error_counters(a), bus.state(a), bus.pending(a)) == ((128, 0), BusState.PASSIVE, 1)
    assert bus.counters.by_error == {"nobody acknowledged": bus.counters.errors}
    period = (sum(frame_bits(frame)) - 11 + 6 + 8 + 3) * BIT
    # From the 17th attempt on an error-passive sender waits 8 bits longer.
    assert bus.counters.errors == 16 + int((0.5 - 16 * period) / (period + 8 * BIT))
    b = bus.attach("B")
    events = bus.advance(0.51)
    assert deliveries(events) == [(b, 0x100)]
    assert [event.state for event in events if isinstance(event, StateChanged)] == [BusState.ACTIVE]
    assert bus.error_counters(a) == (127, 0)


def test_one_identifier_with_different_data_hurts_both_until_one_gives_way() -> None:
    bus, (a, b, c) = bus_of("A", "B", "C")
    bus.submit(a, Frame(5, b"\x00"), 0.0)
    bus.submit(b, Frame(5, b"\x01"), 0.0)
    bus.advance(1e-4)
    assert bus.error_counters(a) == bus.error_counters(b) == (8, 0)
    events = bus.advance(1.0)
    assert sorted(event.frame.data for event in events if isinstance(event, Delivered) and c in event.nodes) == [
        b"\x00",
        b"\x01",
    ]
    assert bus.counters.errors == 16


def test_a_sender_unplugged_in_the_middle_is_not_heard_and_goes_on_when_it_is_back() -> None:
    bus, (a, b, c) = bus_of("A", "B", "C")
    bus.submit(a, Frame(0x100, b"12345678"), 0.0)
    bus.unplug(a, 50e-6)
    assert not bus.is_plugged(a)
    events = bus.advance(1.0)
    assert deliveries(events) == []
    assert bus.counters.by_error == {"the sender was unplugged": 1}
    assert (bus.error_counters(b), bus.error_counters(c), bus.pending(a)) == ((0, 1), (0, 1), 1)
    bus.plug(a, 2.0)
    assert deliveries(bus.advance(3.0)) == [(b, 0x100), (c, 0x100)]


def test_a_sender_unplugged_behind_its_crc_was_heard_and_will_repeat() -> None:
    bus, (a, b) = bus_of("A", "B")
    frame = Frame(0x100, b"1")
    bus.submit(a, frame, 0.0)
    bus.unplug(a, seconds(frame) - 11 * BIT)
    assert deliveries(bus.advance(1.0)) == [(b, 0x100)]
    assert bus.pending(a) == 1


def test_an_unplugged_node_neither_hears_nor_acknowledges_nor_sends() -> None:
    bus, (a, b, c) = bus_of("A", "B", "C")
    bus.unplug(c, 0.0)
    bus.unplug(c, 0.0)
    bus.submit(c, Frame(0x001), 0.0)
    bus.submit(a, Frame(0x100), 0.0)
    assert deliveries(bus.advance(0.1)) == [(b, 0x100)]
    bus.unplug(b, 0.2)
    bus.submit(a, Frame(0x101), 0.2)
    assert deliveries(bus.advance(0.21)) == []
    assert bus.counters.errors > 0


def test_a_receiver_unplugged_before_the_ack_slot_leaves_the_sender_alone() -> None:
    frame = Frame(0x100, b"1")
    for cut, heard in ((30 * BIT, False), (seconds(frame) - 9 * BIT, True)):
        bus, (a, b) = bus_of("A", "B")
        bus.submit(a, frame, 0.0)
        bus.unplug(b, cut)
        events = bus.advance(seconds(frame))
        assert any(isinstance(event, Sent) for event in events) == heard
        assert deliveries(events) == []


def test_who_is_plugged_in_during_a_frame_does_not_hear_it() -> None:
    bus, (a, b, c) = bus_of("A", "B", "C")
    bus.unplug(c, 0.0)
    bus.submit(a, Frame(0x100, b"1"), 0.0)
    bus.plug(c, 20e-6)
    bus.submit(a, Frame(0x101), 30e-6)
    assert deliveries(bus.advance(1.0)) == [(b, 0x100), (b, 0x101), (c, 0x101)]


def test_a_node_hears_and_acknowledges_after_11_recessive_bits() -> None:
    bus, (a, b) = bus_of("A", "B")
    bus.unplug(b, 0.0)
    bus.plug(b, 1.0)
    bus.submit(a, Frame(1), 1.0 + 10 * BIT)
    assert bus.advance(1.0 + 20 * BIT + seconds(Frame(1))) == []
    assert bus.counters.by_error == {"nobody acknowledged": 1}
    assert deliveries(bus.advance(1.1)) == [(b, 1)], "the repetition"

    bus.unplug(b, 2.0)
    bus.plug(b, 2.0)
    bus.submit(a, Frame(2), 2.0 + 11 * BIT)
    assert deliveries(bus.advance(2.0 + 11 * BIT + seconds(Frame(2)))) == [(b, 2)]


def test_a_passive_node_that_gave_way_waits_longer_before_it_tries_again() -> None:
    bus, (a, b, c) = bus_of("A", "B", "C")
    bus._nodes[b].counters.transmit = 128
    bus.submit(a, Frame(5, b"\x00"), 1.0)
    bus.submit(b, Frame(5, b"\x01"), 1.0)
    end = 1.0 + seconds(Frame(5, b"\x00"))
    assert deliveries(bus.advance(end)) == [(c, 5)]
    assert bus.error_counters(b) == (136, 0)
    sent = next(event for event in bus.advance(2.0) if isinstance(event, Sent))
    assert sent.at == pytest.approx(end + 8 * BIT + seconds(Frame(5, b"\x01")) - 3 * BIT)


def test_a_disturbed_intermission_delays_the_next_frame_and_harms_nobody() -> None:
    bus, (a, b) = bus_of("A", "B")
    bus.flip_bit(sum(frame_bits(Frame(1))) - 3, 1.0)
    bus.submit(a, Frame(1), 1.0)
    bus.submit(a, Frame(2), 1.0)
    events = bus.advance(2.0)
    assert deliveries(events) == [(b, 1), (b, 2)]
    times = [event.at for event in events if isinstance(event, Sent)]
    assert times[1] - times[0] == pytest.approx((1 + 6 + 8 + 3) * BIT + seconds(Frame(2)) - 3 * BIT)
    assert (bus.counters.overloads, bus.counters.errors, bus.counters.frames) == (1, 0, 2)
    assert (bus.error_counters(a), bus.error_counters(b)) == ((0, 0), (0, 0))


def test_a_removed_node_leaves_nothing_behind() -> None:
    bus, (a, b, c) = bus_of("A", "B", "C")
    for node in (a, c):
        bus.submit(node, Frame(node, b"1"), 0.0)
        bus.submit(node, Frame(node, b"2"), 0.0)
    bus.detach(a, 30e-6)
    assert deliveries(bus.advance(1.0)) == [(b, c), (b, c)]
    with pytest.raises(KeyError):
        bus.pending(a)


def test_a_short_circuit_drives_the_sender_off_the_bus_and_restart_brings_it_back() -> None:
    bus, (a, b) = bus_of("A", "B")
    bus.short_circuit(0.0)
    bus.submit(a, Frame(0x100), 0.0)
    events = bus.advance(0.1)
    changes = [event for event in events if isinstance(event, StateChanged)]
    # SOF and 15 bits of the active flag make it passive; each further attempt costs SOF, flag, delimiter,
    # intermission and the suspended transmission.
    passive_at, off_at = (1 + 15 + 6 + 8) * BIT, (16 + 6 + 8 + 3 + 8 + 15 * (1 + 6 + 8 + 3 + 8) + 1 + 6 + 8) * BIT
    assert [change.state for change in changes] == [BusState.PASSIVE, BusState.OFF]
    assert [change.at for change in changes] == [pytest.approx(passive_at), pytest.approx(off_at)]
    assert (bus.state(a), bus.pending(a), bus.next_event_at()) == (BusState.OFF, 0, None)
    with pytest.raises(LinkDown):
        bus.submit(a, Frame(0x100), 0.2)
    bus.repair(0.3)
    bus.restart(a, 0.4)
    bus.restart(a, 0.5)
    back = 0.4 + 128 * 11 * BIT
    assert bus.next_event_at() == pytest.approx(back)
    assert [event.at for event in bus.advance(1.0)] == [pytest.approx(back)]
    assert bus.state(a) is BusState.ACTIVE
    bus.submit(a, Frame(0x100), 1.0)
    assert deliveries(bus.advance(2.0)) == [(b, 0x100)]


def test_a_short_circuit_in_the_middle_of_a_frame_breaks_it() -> None:
    bus, (a, b) = bus_of("A", "B")
    bus.submit(a, Frame(0x100, bytes(8)), 0.0)
    bus.short_circuit(60e-6)
    events = bus.advance(150e-6)
    assert deliveries(events) == []
    assert "the bus was short-circuited" in bus.counters.by_error
    bus.repair(150e-6)
    assert deliveries(bus.advance(1.0)) == [(b, 0x100)]


def test_recovery_counts_the_gaps_between_frames() -> None:
    bus, (a, b, c) = bus_of("A", "B", "C")
    bus.short_circuit(0.0)
    bus.submit(a, Frame(0x100), 0.0)
    bus.advance(0.1)
    bus.repair(0.1)
    bus.restart(a, 0.1)
    sent = 0
    now = 0.1
    back: list[float] = []
    while not back:
        while bus.pending(b) < MAILBOXES:
            bus.submit(b, Frame(0x200, bytes(8)), now)
            sent += 1
        now = bus.next_event_at() or now
        back = [event.at for event in bus.advance(now) if isinstance(event, StateChanged)]
    # Back to back frames leave exactly one gap of 11 recessive bits each.
    assert 127 <= bus.counters.frames <= 129
    assert c


def test_deafness_is_silent_and_for_one_node_only() -> None:
    bus, (a, b, c) = bus_of("A", "B", "C")
    bus.deafen(b, frames=2)
    for can_id in (1, 2, 3):
        bus.submit(a, Frame(can_id), 0.0)
    assert deliveries(bus.advance(1.0)) == [(c, 1), (c, 2), (b, 3), (c, 3)]
    assert bus.counters.errors == 0


def test_probable_deafness_and_noise_need_a_random() -> None:
    bus, (a, _) = bus_of("A", "B")
    with pytest.raises(LocalProtocolError):
        bus.deafen(a, probability=0.5)
    with pytest.raises(LocalProtocolError):
        bus.set_bit_error_rate(0.1)
    with pytest.raises(LocalProtocolError):
        SimBus(RATE, random=Random(1), bit_error_rate=1.0)


def test_probable_deafness() -> None:
    bus, (a, b) = bus_of("A", "B", random=Random(3))
    bus.deafen(b, probability=0.5)
    heard = 0
    for i in range(200):
        bus.submit(a, Frame(1), float(i))
        heard += len(deliveries(bus.advance(i + 0.5)))
    assert 70 < heard < 130


def test_a_flipped_bit_costs_a_repetition_and_in_the_last_bit_a_double() -> None:
    frame = Frame(0x123, b"data")
    length = sum(frame_bits(frame))
    for index in range(length - 3):
        bus, (a, b) = bus_of("A", "B")
        bus.flip_bit(index, 0.0)
        bus.submit(a, frame, 0.0)
        events = bus.advance(1.0)
        assert deliveries(events) == [(b, 0x123)] * (2 if index == length - 4 else 1), index
        assert (bus.counters.errors, bus.counters.frames) == (1, 1)
        assert all(event.frame == frame for event in events if isinstance(event, Delivered))


def test_flips_wait_for_their_frames() -> None:
    bus, (a, _) = bus_of("A", "B")
    bus.submit(a, Frame(1), 0.0)
    bus.flip_bit(20, 0.0)
    bus.flip_bit(500, 0.0)
    bus.advance(1.0)
    assert bus.counters.errors == 1
    bus.submit(a, Frame(1), 1.0)
    bus.flip_bit(20, 1.0 + 50e-6)
    bus.advance(2.0)
    assert bus.counters.errors == 1, "a flip ordered in the middle of a frame is for the next"
    bus.submit(a, Frame(1), 2.0)
    bus.advance(3.0)
    assert bus.counters.errors == 2


def test_noise_delays_but_loses_nothing_and_alters_nothing() -> None:
    bus, (a, _) = bus_of("A", "B", random=Random(5), bit_error_rate=1e-3)
    got = []
    for i in range(300):
        bus.submit(a, Frame(i, bytes([i & 255])), i * 0.01)
        got += [event.frame.can_id for event in bus.advance(i * 0.01 + 0.009) if isinstance(event, Delivered)]
    assert sorted(set(got)) == list(range(300))
    assert 10 < bus.counters.errors < 60


def test_a_babbling_node_starves_the_others_until_it_is_pulled_out() -> None:
    bus, (babbler, a, b) = bus_of("babbler", "A", "B")
    bus.submit(a, Frame(0x100), 0.0)
    now = 0.0
    while now < 0.05:
        while bus.pending(babbler) < MAILBOXES:
            bus.submit(babbler, Frame(0, bytes(8)), now)
        now = bus.next_event_at() or now
        assert all(event.frame.can_id == 0 for event in bus.advance(now) if isinstance(event, Sent))
    assert bus.load(now) > 0.049
    bus.unplug(babbler, now)
    assert (b, 0x100) in deliveries(bus.advance(now + 0.01))


def test_what_a_controller_does_not_take() -> None:
    bus = SimBus(RATE)
    a = bus.attach("A")
    with pytest.raises(LocalProtocolError, match="cannot send CAN FD"):
        bus.submit(a, Frame(1, fd=True), 0.0)
    with pytest.raises(LocalProtocolError):
        bus.submit(a, Frame(0x800), 0.0)
    for _ in range(MAILBOXES):
        bus.submit(a, Frame(1), 0.0)
    with pytest.raises(LinkFull):
        bus.submit(a, Frame(1), 0.0)
    with pytest.raises(LocalProtocolError):
        SimBus(0)
    with pytest.raises(LocalProtocolError):
        SimBus(500_000, 250_000)


def test_load_is_busy_time_of_the_last_second() -> None:
    bus, (a, _) = bus_of("A", "B")
    frame = Frame(0x123, b"12345678")
    for i in range(100):
        bus.submit(a, frame, i * 0.01)
        bus.advance(i * 0.01 + 0.005)
    assert bus.load(1.0) == pytest.approx(100 * seconds(frame))
    assert bus.load(3.0) == 0


@settings(max_examples=tries(60, 2000))
@given(
    st.lists(
        st.tuples(
            st.integers(0, 4),
            st.integers(0, 2047),
            st.binary(max_size=8),
            st.floats(0, 2e-3),
        ),
        max_size=60,
    )
)
def test_every_frame_arrives_once_at_everybody_and_those_of_one_identifier_in_order(
    story: list[tuple[int, int, bytes, float]],
) -> None:
    bus, nodes = bus_of("A", "B", "C", "D", "E")
    heard: dict[int, list[Frame]] = {node: [] for node in nodes}
    given: dict[int, list[Frame]] = {node: [] for node in nodes}
    sent: dict[int, list[Frame]] = {node: [] for node in nodes}
    ends: list[float] = []
    now = 0.0

    def let(until: float) -> None:
        for event in bus.advance(until):
            if isinstance(event, Delivered):
                for node in event.nodes:
                    heard[node].append(event.frame)
            elif isinstance(event, Sent):
                sent[event.node].append(event.frame)
                ends.append(event.at)

    for who, can_id, data, pause in story:
        now += pause
        let(now)
        node = nodes[who]
        if bus.pending(node) < MAILBOXES:
            # The node stands in the identifier, so no two nodes ever use the same one.
            frame = Frame(can_id & 0x718 | who, data)
            given[node].append(frame)
            bus.submit(node, frame, now)
    let(now + 1.0)
    for node in nodes:
        for can_id in {frame.can_id for frame in given[node]}:
            assert [f for f in sent[node] if f.can_id == can_id] == [f for f in given[node] if f.can_id == can_id]
        assert len(sent[node]) == len(given[node])
        assert len(heard[node]) == sum(len(given[other]) for other in nodes if other != node)
    assert bus.counters.errors == 0
    assert ends == sorted(ends)
    total = sum(seconds(frame) for frames in given.values() for frame in frames)
    assert not ends or ends[-1] >= total - 3 * BIT - 1e-9


@pytest.mark.parametrize("repaired_at", [0.1, 0.5 * BIT, 30 * BIT])
def test_what_waits_is_sent_once_the_short_circuit_is_over(repaired_at: float) -> None:
    bus, (a, b) = bus_of("A", "B")
    bus.short_circuit(0.0)
    if repaired_at < 0.1:  # later, who tries all the time is off the bus
        bus.submit(a, Frame(0x100, b"1"), 0.0)
        bus.advance(repaired_at)
    bus.repair(repaired_at)
    if repaired_at == 0.1:
        bus.submit(a, Frame(0x100, b"1"), repaired_at)
    events = bus.advance(1.0)
    assert deliveries(events) == [(b, 0x100)]
    assert bus.state(a) is BusState.ACTIVE
