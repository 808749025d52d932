"""What becomes of one attempt when a bit is disturbed: against a plain simulation that goes bit by bit."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from msbot_agent.link.can.protocol.bits import arbitration_rank, frame_bits, wire_bits
from msbot_agent.link.can.protocol.frames import Frame, pad_fd
from msbot_agent.link.can.sim.model.arbitration import (
    Attempt,
    QueuedFrame,
    Rates,
    SimNode,
    arbitrate,
    fall_silent,
    plan_attempt,
    plan_shorted,
)
from msbot_agent.link.can.sim.model.events import ErrorCounters
from tests.effort import tries
from tests.link.can.sim.model.plain_bus import PlainNode, plain_bus

RATES = Rates(4.0, 0.5)
"""Powers of two, so that sums of bit times are exact."""
SLOW = RATES.bit_s


def node(name: str, *frames: Frame, fd: bool = True, passive: bool = False) -> SimNode:
    made = SimNode(name, fd)
    made.mailboxes = [QueuedFrame(0.0, arbitration_rank(frame), frame) for frame in frames]
    if frames:
        made.choose(1.0)
    if passive:
        made.counters = ErrorCounters(transmit=128)
    return made


def attempt(senders: list[SimNode], listeners: list[SimNode], flip: int | None = None) -> Attempt:
    return plan_attempt(0.0, senders, listeners, RATES, lambda bits: flip if flip is not None and flip < bits else None)


classic_frames = st.builds(
    lambda extended, can_id, data: Frame(can_id & (0x1FFFFFFF if extended else 0x7FF), data, extended),
    st.booleans(),
    st.integers(0, 0x1FFFFFFF),
    st.binary(max_size=8),
)


fd_frames = st.builds(
    lambda extended, can_id, data, brs, esi: Frame(
        can_id & (0x1FFFFFFF if extended else 0x7FF), pad_fd(data), extended, True, brs, esi=esi
    ),
    st.booleans(),
    st.integers(0, 0x1FFFFFFF),
    st.binary(max_size=64),
    st.booleans(),
    st.booleans(),
)


def names_and_counts(nodes: dict[str, PlainNode]) -> dict[str, tuple[int, int]]:
    """Without those that counted nothing."""
    return {name: it.counted for name, it in nodes.items() if it.counted != (0, 0)}


@settings(max_examples=tries(300, 6000))
@given(classic_frames | fd_frames, st.booleans(), st.booleans(), st.data())
def test_a_disturbed_bit_costs_what_the_plain_simulation_says(
    frame: Frame, sender_passive: bool, listener_passive: bool, data: st.DataObject
) -> None:
    wire = wire_bits(replace(frame, esi=True) if frame.fd and sender_passive else frame)
    flip = data.draw(st.integers(0, len(wire) - 4))
    listeners = [node("B"), node("C", passive=listener_passive)]
    planned = attempt([node("A", frame, passive=sender_passive)], listeners, flip)
    nodes = {"A": PlainNode(True, sender_passive), "B": PlainNode(False), "C": PlainNode(False, listener_passive)}
    course = plain_bus([(it, wire) for it in nodes.values()], RATES, flip=flip)
    assert planned.error == "a bit was disturbed"
    assert (planned.free_at, planned.bits) == (course.seconds, course.bits)
    assert (planned.ends_at, planned.recessive_from) == (planned.free_at - 3 * SLOW, planned.free_at - 11 * SLOW)
    assert planned.sent == []
    if flip == len(wire) - 4:  # too late for receivers: they have the frame, and send an overload flag
        assert planned.received == listeners
        assert added(planned) == {"A": (8, 0)}
    else:
        assert planned.received == []
        in_arbitration = wire[flip].field in ("ID", "SRR", "IDE", "RTR", "RRS") and wire[flip].level == 1
        if wire[flip].stuff and in_arbitration:
            nodes["A"].counted = (0, 0)  # an exception of rule c
        assert added(planned) == names_and_counts(nodes)


@given(classic_frames)
def test_an_undisturbed_frame_takes_its_bits(frame: Frame) -> None:
    sender, listeners = node("A", frame), [node("B"), node("C")]
    planned = attempt([sender], listeners)
    length = sum(frame_bits(frame))
    assert planned.bits == length
    assert planned.free_at == length * SLOW
    assert planned.ends_at == (length - 3) * SLOW
    assert planned.recessive_from == (length - 11) * SLOW
    assert (planned.sent, planned.received, planned.failures, planned.error) == ([sender], listeners, [], "")


@given(classic_frames | fd_frames)
def test_a_disturbed_intermission_is_an_overload_frame(frame: Frame) -> None:
    length = sum(frame_bits(frame))
    undisturbed = attempt([node("A", frame)], [node("B")])
    for place, more in ((0, 1 + 6 + 8), (1, 2 + 6 + 8)):
        sender, listeners = node("A", frame), [node("B"), node("C")]
        planned = attempt([sender], listeners, length - 3 + place)
        assert planned.overload
        assert (planned.sent, planned.received, planned.failures, planned.error) == ([sender], listeners, [], "")
        assert planned.ends_at == undisturbed.ends_at, "the frame has gone well by then"
        assert planned.bits == length + more
        assert planned.free_at == undisturbed.free_at + more * SLOW
        assert planned.recessive_from == planned.free_at - (8 + 3) * SLOW
    assert not attempt([node("A", frame)], [node("B")], length - 1).overload


def test_a_disturbance_of_the_acknowledgement_may_stand_in_for_it() -> None:
    sender = node("A", Frame(5, b"x"))
    length = sum(frame_bits(Frame(5, b"x")))
    planned = attempt([sender], [], length - 12)
    assert (planned.error, planned.sent, planned.received) == ("", [sender], [])
    assert planned.bits == length
    assert attempt([node("A", Frame(5, b"x"))], [], length - 13).error == "a bit was disturbed"
    assert attempt([node("A", Frame(5, b"x"))], [], length - 3).error == "nobody acknowledged"


def added(planned: Attempt) -> dict[str, tuple[int, int]]:
    """What the nodes count, without those that count nothing."""
    before = {it.node.name: (it.node.counters.transmit, it.node.counters.receive) for it in planned.failures}
    after = counts(planned)
    both = {name: (after[name][0] - before[name][0], after[name][1] - before[name][1]) for name in before}
    return {name: count for name, count in both.items() if count != (0, 0)}


def counts(planned: Attempt) -> dict[str, tuple[int, int]]:
    for failure in planned.failures:
        failure.apply()
    return {
        failure.node.name: (failure.node.counters.transmit, failure.node.counters.receive)
        for failure in planned.failures
    }


def test_the_sender_counts_8_and_each_receiver_1() -> None:
    assert counts(attempt([node("A", Frame(1, b"x"))], [node("B"), node("C")], 25)) == {
        "A": (8, 0),
        "B": (0, 1),
        "C": (0, 1),
    }


def test_a_disturbance_in_the_identifier_makes_the_sender_a_receiver() -> None:
    assert counts(attempt([node("A", Frame(0x7FF))], [node("B")], 3)) == {"A": (0, 1), "B": (0, 1)}


def test_a_stuff_bit_disturbed_during_arbitration_does_not_count_for_the_sender() -> None:
    bits = wire_bits(Frame(0))
    at = next(i for i, bit in enumerate(bits) if bit.stuff)
    assert bits[at].field == "ID"
    assert counts(attempt([node("A", Frame(0))], [node("B")], at)) == {"A": (0, 0), "B": (0, 1)}


def test_a_lone_active_node_counts_and_a_passive_one_does_not() -> None:
    for passive, transmit in ((False, 8), (True, 128)):
        planned = attempt([node("A", Frame(1), passive=passive)], [])
        assert planned.error == "nobody acknowledged"
        assert counts(planned)["A"][0] == transmit
        # Up to and including the ACK slot, then flag, delimiter and intermission.
        assert planned.bits == sum(frame_bits(Frame(1))) - 11 + 6 + 8 + 3
        assert planned.free_at == planned.bits * SLOW


def test_two_frames_with_one_identifier_destroy_each_other() -> None:
    one, other = Frame(5, b"\x00"), Frame(5, b"\x01")
    senders, listeners = [node("A", one), node("B", other)], [node("C")]
    planned = attempt(senders, listeners)
    assert planned.error == "two nodes sent different frames with one identifier"
    assert counts(planned) == {"A": (8, 0), "B": (8, 0), "C": (0, 1)}
    first, second = wire_bits(one), wire_bits(other)
    differ = next(i for i, (a, b) in enumerate(zip(first, second, strict=False)) if a.level != b.level)
    assert planned.bits <= differ + 1 + 12 + 8 + 3


@given(classic_frames | fd_frames, st.binary(max_size=64), st.integers(0, 2))
def test_a_conflict_of_two_frames_costs_what_the_plain_simulation_says(
    frame: Frame, other_data: bytes, listeners: int
) -> None:
    other = replace(frame, data=pad_fd(other_data) if frame.fd else other_data[:8])
    assume(wire_bits(frame) != wire_bits(other))
    one, two = wire_bits(frame), wire_bits(other)
    differ = next(at for at, (a, b) in enumerate(zip(one, two, strict=False)) if a.level != b.level)
    assume(one[differ].field not in ("ID", "RTR", "SRR", "IDE", "RRS"))
    seen = one if one[differ].level == 0 else two
    nodes = [(PlainNode(True), one), (PlainNode(True), two)]
    nodes += [(PlainNode(False), seen) for _ in range(listeners)]
    planned = attempt([node("A", frame), node("B", other)], [node(f"L{number}") for number in range(listeners)])
    assert planned.error == "two nodes sent different frames with one identifier"
    assert planned.free_at == plain_bus(nodes, RATES).seconds
    assert sorted(counts(planned).values()) == [(0, 1)] * listeners + [(8, 0)] * 2


@settings(max_examples=tries(100, 2000))
@given(classic_frames | fd_frames, st.booleans(), st.sampled_from((0.0, 0.5)), st.data())
def test_a_bus_that_falls_silent_costs_what_the_plain_simulation_says(
    frame: Frame, stuck: bool, part_of_bit: float, data: st.DataObject
) -> None:
    """The sender is unplugged, or the bus is short-circuited, during a bit."""
    wire = wire_bits(frame)
    at = data.draw(st.integers(1, len(wire) - 4))
    planned = attempt([node("A", frame)], [node("B"), node("C")])
    now = RATES.end_of(wire, at - 1, 0.0) + part_of_bit * (0.5 if wire[at].fast else SLOW)
    silent = fall_silent(planned, now, RATES, stuck=stuck)
    nodes = {"A": PlainNode(True), "B": PlainNode(False), "C": PlainNode(False)}
    course = plain_bus([(it, wire) for it in nodes.values()], RATES, **{"shorted_from" if stuck else "leaves_at": at})
    assert (silent.free_at, silent.bits) == (course.seconds, course.bits)
    assert added(silent) == names_and_counts(nodes)
    is_heard = all(nodes[name].counted == (0, 0) for name in "BC")
    assert [it.name for it in silent.received] == (["B", "C"] if is_heard else [])
    assert [it.name for it in silent.sent] == (["A"] if stuck and nodes["A"].counted == (0, 0) else [])
    words = "the bus was short-circuited" if stuck else "the sender was unplugged"
    assert silent.error == (words if names_and_counts(nodes) else "")


def test_on_a_shorted_bus_each_bit_of_a_flag_is_an_error_until_the_sender_is_passive() -> None:
    """Rule d of fault confinement; then follow the six bits of its passive flag."""
    for transmit in range(256):
        plain, bits = ErrorCounters(transmit=transmit), 1
        plain.transmit_failed()  # SOF is not seen
        while plain.active:
            bits += 1
            plain.transmit_failed()
        lone = node("A", Frame(5))
        lone.counters = ErrorCounters(transmit=transmit)
        planned = plan_shorted(SLOW, [lone], RATES)
        assert planned.bits == bits + 6 + 8 + 3
        assert planned.free_at == SLOW + planned.bits * SLOW
        assert counts(planned) == {"A": (plain.transmit, 0)}


def test_of_several_senders_on_a_shorted_bus_the_longest_flag_counts() -> None:
    one, other = node("A", Frame(5)), node("B", Frame(6))
    one.counters, other.counters = ErrorCounters(transmit=100), ErrorCounters(transmit=60)
    planned = plan_shorted(0.0, [one, other], RATES)
    assert planned.bits == 1 + 8 + 6 + 8 + 3
    assert counts(planned) == {"A": (132, 0), "B": (132, 0)}


@given(fd_frames, st.integers(0, 2), st.booleans(), st.data())
def test_a_classic_controller_costs_what_the_plain_simulation_says(
    frame: Frame, others: int, is_disturbed: bool, data: st.DataObject
) -> None:
    """It takes FDF for an error, unless FDF itself, or a bit before, is disturbed; what comes later is too late."""
    wire = wire_bits(frame)
    fdf = next(at for at, bit in enumerate(wire) if bit.field == "FDF")
    lost = {at for at in range(fdf) if wire[at].level == 1 and not wire[at].stuff}  # taken for lost arbitration
    flip = data.draw(st.integers(0, fdf).filter(lambda at: at not in lost)) if is_disturbed else -1
    listeners = [node("B", fd=False), *(node(f"L{number}") for number in range(others))]
    planned = attempt([node("A", frame)], listeners, flip if is_disturbed else fdf + 1)
    nodes = {"A": PlainNode(True), "B": PlainNode(False, classic=True)}
    nodes |= {f"L{number}": PlainNode(False) for number in range(others)}
    course = plain_bus([(it, wire) for it in nodes.values()], RATES, flip=flip)
    assert (planned.free_at, planned.bits) == (course.seconds, course.bits)
    assert planned.error == (
        "a bit was disturbed" if is_disturbed else "a classic-only controller does not support CAN FD"
    )
    if is_disturbed and wire[flip].stuff and wire[flip].level == 1:
        nodes["A"].counted = (0, 0)  # an exception of rule c
    assert added(planned) == names_and_counts(nodes)


@pytest.mark.parametrize("passive", [False, True])
@pytest.mark.parametrize("brs", [False, True])
def test_without_an_acknowledgement_the_flag_follows_the_ack_slot(passive: bool, brs: bool) -> None:
    frame = Frame(0x123, bytes(range(12)), fd=True, brs=brs)
    wire = wire_bits(replace(frame, esi=passive))
    planned = attempt([node("A", frame, passive=passive)], [])
    course = plain_bus([(PlainNode(True, passive), wire)], RATES)
    assert (planned.free_at, planned.bits) == (course.seconds, course.bits)
    assert planned.ends_at == planned.free_at - 3 * SLOW


def test_who_is_ready_when_the_first_bit_is_over_comes_too_late() -> None:
    slow, quick = node("A"), node("B")
    slow.mailboxes = [QueuedFrame(4.0, 1, Frame(1)), QueuedFrame(3.9, 3, Frame(3))]
    quick.mailboxes = [QueuedFrame(0.0, 2, Frame(2))]
    assert arbitrate([slow, quick], 4.0) == [quick]
    assert (slow.choice, quick.choice) == (slow.mailboxes[1], quick.mailboxes[0])
    assert arbitrate([slow, quick], 4.5) == [slow]
    assert slow.ready() == 3.9


def test_a_passive_node_that_meets_its_own_identifier_gives_way_without_destroying() -> None:
    one, other = node("A", Frame(5, b"\x00")), node("B", Frame(5, b"\x01"), passive=True)
    planned = attempt([one, other], [node("C")])
    assert (planned.sent, planned.error) == ([one], "")
    assert counts(planned) == {"B": (136, 0)}


def test_equal_frames_are_sent_by_both() -> None:
    senders, listeners = [node("A", Frame(5, b"x")), node("B", Frame(5, b"x"))], [node("C")]
    planned = attempt(senders, listeners)
    assert (planned.sent, planned.received) == (senders, listeners)


def test_a_classic_controller_destroys_fd_frames_and_counts_nine() -> None:
    planned = attempt([node("A", Frame(5, b"x", fd=True))], [node("B"), node("C", fd=False)])
    assert planned.error == "a classic-only controller does not support CAN FD"
    assert counts(planned) == {"C": (0, 9), "A": (8, 0), "B": (0, 1)}


def test_a_passive_classic_controller_cannot_destroy_and_does_not_hear() -> None:
    listener = node("B")
    planned = attempt([node("A", Frame(5, b"x", fd=True))], [listener, node("C", fd=False, passive=True)])
    assert (planned.error, planned.received) == ("", [listener])
    assert counts(planned) == {"C": (128, 1)}, "it has found a form error, too"


def test_a_disturbance_before_the_fdf_bit_comes_before_the_classic_controller() -> None:
    planned = attempt([node("A", Frame(5, b"x", fd=True))], [node("C", fd=False)], 0)
    assert planned.error == "a bit was disturbed"


def test_a_disturbed_fdf_bit_is_no_can_fd_for_a_classic_controller() -> None:
    frame = Frame(5, b"x", fd=True)
    fdf = next(at for at, bit in enumerate(wire_bits(frame)) if bit.field == "FDF")
    for flip, error in ((fdf, "a bit was disturbed"), (fdf + 1, "a classic-only controller does not support CAN FD")):
        planned = attempt([node("A", frame)], [node("C", fd=False)], flip)
        assert planned.error == error
        assert counts(planned) == {"A": (8, 0), "C": (0, 1) if flip == fdf else (0, 9)}


def test_a_recessive_bit_of_an_identifier_that_is_disturbed_is_noticed_by_its_run() -> None:
    """Then all bits are recessive: the sixth of them is a stuff error for everybody."""
    planned = attempt([node("A", Frame(0x555, b"x"))], [node("B")], 1)
    assert wire_bits(Frame(0x555, b"x"))[1].level == 1
    assert planned.bits == 1 + 1 + 6 + 6 + 8 + 3
    assert counts(planned) == {"A": (0, 1), "B": (0, 1)}


def test_a_passive_sender_says_so_in_its_fd_frames() -> None:
    frame = Frame(5, b"x", fd=True, brs=True)
    assert attempt([node("A", frame, passive=True)], [node("B")]).frame == Frame(5, b"x", fd=True, brs=True, esi=True)
    assert attempt([node("A", frame)], [node("B")]).frame == frame


def test_a_passive_sender_cannot_destroy_but_its_receivers_do() -> None:
    frame = Frame(0x555, b"\x55" * 4)
    planned = attempt([node("A", frame, passive=True)], [node("B")], 30)
    level = 1 - wire_bits(frame)[30].level
    same = 2 if wire_bits(frame)[29].level == level == 1 else 1 if level == 1 else 0
    # The sender falls silent; the receiver finds six recessive bits and sends its flag.
    assert planned.bits == 31 + (6 - same) + 6 + 8 + 3
    everybody_passive = attempt([node("A", frame, passive=True)], [node("B", passive=True)], 30)
    assert everybody_passive.bits == 31 + 6 + 8 + 3


def test_the_data_phase_is_timed_at_its_own_rate() -> None:
    frame = Frame(0x123, bytes(range(64)), fd=True, brs=True)
    nominal, fast = frame_bits(frame)
    planned = plan_attempt(10.0, [node("A", frame)], [node("B")], Rates(4.0, 1.0), lambda _: None)
    assert planned.free_at == 10.0 + 4 * nominal + fast
    fdf = next(i for i, bit in enumerate(wire_bits(frame)) if bit.fast)
    assert Rates(4.0, 1.0).end_of(wire_bits(frame), fdf, 10.0) == 10.0 + 4 * fdf + 1
    assert Rates(4.0, 1.0).end_of(wire_bits(frame), -1, 10.0) == 10.0
