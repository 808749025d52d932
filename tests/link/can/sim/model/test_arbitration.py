"""What becomes of one attempt when a bit is disturbed: against a plain simulation that goes bit by bit."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from itertools import repeat

from hypothesis import assume, given, settings
from hypothesis import strategies as st

from msbot.link.can.protocol.bits import WireBit, arbitration_rank, frame_bits, wire_bits
from msbot.link.can.protocol.frames import Frame, pad_fd
from msbot.link.can.sim.model.arbitration import Attempt, Mail, Rates, SimNode, fall_silent, plan_attempt
from msbot.link.can.sim.model.error_counters import ErrorCounters, is_tail
from tests.effort import tries

RATES = Rates(1.0, 1.0)
"""One second a bit, so that times are bits."""


def node(name: str, *frames: Frame, fd: bool = True, passive: bool = False) -> SimNode:
    made = SimNode(name, fd)
    made.mailboxes = [Mail(0.0, arbitration_rank(frame), frame) for frame in frames]
    if frames:
        made.choose(1.0)
    if passive:
        made.counters = ErrorCounters(transmit=128)
    return made


def attempt(senders: list[SimNode], listeners: list[SimNode], flip: int | None = None) -> Attempt:
    return plan_attempt(0.0, senders, listeners, RATES, lambda bits: flip if flip is not None and flip < bits else None)


class Mode(Enum):
    FRAME = 0
    FLAG = 1
    WAIT = 2
    DELIMITER = 3
    DONE = 4


@dataclass
class PlainNode:
    """An error-active controller that decides bit by bit."""

    sends: bool
    mode: Mode = Mode.FRAME
    left: int = 0
    run: int = 0
    last: int = -1
    altered: bool = False

    def drive(self, bit: WireBit) -> int:
        if self.mode is Mode.FLAG:
            return 0
        if self.mode is not Mode.FRAME:
            return 1
        if bit.field == "ACK":
            return 1 if self.sends or self.altered else 0
        return bit.level if self.sends else 1

    def see(self, bit: WireBit, driven: int, level: int) -> None:
        if self.mode is Mode.FRAME:
            if self._finds_error(bit, driven, level):
                self.mode, self.left = Mode.FLAG, 6
        elif self.mode is Mode.FLAG:
            self.left -= 1
            if not self.left:
                self.mode = Mode.WAIT
        elif self.mode is Mode.WAIT and level == 1:
            self.mode, self.left = Mode.DELIMITER, 7
        elif self.mode is Mode.DELIMITER:
            self.left -= 1
            if not self.left:
                self.mode = Mode.DONE

    def _finds_error(self, bit: WireBit, driven: int, level: int) -> bool:
        if self.sends and bit.field in ("ID", "RTR", "SRR", "IDE") and driven > level and not bit.stuff:
            self.sends = False  # arbitration lost, even to a disturbance
        self.run = self.run + 1 if level == self.last else 1
        wrong_fixed = bit.fixed and level == self.last
        self.last = level
        self.altered = self.altered or (level != bit.level and not is_tail(bit))
        if bit.field == "ACK":
            return level == 1 and (self.sends or not self.altered)
        if self.sends:
            return level != driven
        if is_tail(bit):
            return level == 0 or (bit.field == "ACK DELIMITER" and self.altered)
        return wrong_fixed or self.run == 6


def plain_length(frame: Frame, flip: int) -> int:
    """Bits until the bus is free, intermission included, with one sender, two receivers and one disturbed bit."""
    wire = wire_bits(frame)
    return plain_bus([(PlainNode(True), wire), (PlainNode(False), wire), (PlainNode(False), wire)], flip=flip)


def plain_bus(nodes: list[tuple[PlainNode, list[WireBit]]], *, flip: int = -1, leaves_at: int = -1) -> int:
    """Bits until the bus is free, intermission included.

    Args:
        nodes: each with the frame it sends, or takes what it sees for.
        flip: the bit that is disturbed.
        leaves_at: the bit from which on the first node is not there any more.
    """
    wires = [[*wire[:-3], *repeat(WireBit(1, "IDLE"), 200)] for _, wire in nodes]
    ends = [len(wire) - 3 for _, wire in nodes]
    for index in range(min(map(len, wires))):
        for (it, _), end in zip(nodes, ends, strict=True):
            it.mode = Mode.DONE if it.mode is Mode.FRAME and index == end else it.mode
        if index == leaves_at:
            nodes[0][0].mode = Mode.DONE
        if all(it.mode is Mode.DONE for it, _ in nodes):
            return index + 3
        driven = [it.drive(wire[index]) for (it, _), wire in zip(nodes, wires, strict=True)]
        level = min(driven) ^ (index == flip)
        for (it, _), wire, own in zip(nodes, wires, driven, strict=True):
            it.see(wire[index], own, level)
    raise AssertionError("the bus never gets free")


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


@settings(max_examples=tries(300, 6000))
@given(classic_frames | fd_frames, st.data())
def test_a_disturbed_bit_costs_what_the_plain_simulation_says(frame: Frame, data: st.DataObject) -> None:
    flip = data.draw(st.integers(0, len(wire_bits(frame)) - 4))
    planned = attempt([node("A", frame)], [node("B"), node("C")], flip)
    assert planned.error == "a bit was disturbed"
    assert (planned.free_at, planned.bits) == (plain_length(frame, flip), plain_length(frame, flip))
    last = flip == len(wire_bits(frame)) - 4
    assert planned.sent == []
    assert len(planned.received) == (2 if last else 0), "the last bit of the end of frame comes too late for receivers"


@given(classic_frames)
def test_an_undisturbed_frame_takes_its_bits(frame: Frame) -> None:
    sender, listeners = node("A", frame), [node("B"), node("C")]
    planned = attempt([sender], listeners)
    length = sum(frame_bits(frame))
    assert planned.bits == planned.free_at == length
    assert planned.ends_at == length - 3
    assert planned.recessive_from == length - 11
    assert (planned.sent, planned.received, planned.failures, planned.error) == ([sender], listeners, [], "")


@given(classic_frames | fd_frames)
def test_a_disturbed_intermission_is_an_overload_frame(frame: Frame) -> None:
    length = sum(frame_bits(frame))
    for place, more in ((0, 1 + 6 + 8), (1, 2 + 6 + 8)):
        sender, listeners = node("A", frame), [node("B"), node("C")]
        planned = attempt([sender], listeners, length - 3 + place)
        assert planned.overload
        assert (planned.sent, planned.received, planned.failures, planned.error) == ([sender], listeners, [], "")
        assert planned.ends_at == length - 3, "the frame has gone well by then"
        assert planned.bits == planned.free_at == length + more
        assert planned.recessive_from == planned.free_at - 8 - 3
    assert not attempt([node("A", frame)], [node("B")], length - 1).overload


def test_a_disturbance_of_the_acknowledgement_may_stand_in_for_it() -> None:
    sender = node("A", Frame(5, b"x"))
    length = sum(frame_bits(Frame(5, b"x")))
    planned = attempt([sender], [], length - 12)
    assert (planned.error, planned.sent, planned.received) == ("", [sender], [])
    assert planned.bits == length
    assert attempt([node("A", Frame(5, b"x"))], [], length - 13).error == "a bit was disturbed"
    assert attempt([node("A", Frame(5, b"x"))], [], length - 3).error == "nobody acknowledged"


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
        assert planned.bits == planned.free_at == sum(frame_bits(Frame(1))) - 11 + 6 + 8 + 3


def test_two_frames_with_one_identifier_destroy_each_other() -> None:
    one, other = Frame(5, b"\x00"), Frame(5, b"\x01")
    senders, listeners = [node("A", one), node("B", other)], [node("C")]
    planned = attempt(senders, listeners)
    assert planned.error == "two nodes sent different frames with one identifier"
    assert counts(planned) == {"A": (8, 0), "B": (8, 0), "C": (0, 1)}
    first, second = wire_bits(one), wire_bits(other)
    differ = next(i for i, (a, b) in enumerate(zip(first, second, strict=False)) if a.level != b.level)
    assert planned.free_at <= differ + 1 + 12 + 8 + 3


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
    assert planned.free_at == plain_bus(nodes)
    assert sorted(counts(planned).values()) == [(0, 1)] * listeners + [(8, 0)] * 2


@given(classic_frames | fd_frames, st.data())
def test_a_sender_that_is_unplugged_costs_what_the_plain_simulation_says(frame: Frame, data: st.DataObject) -> None:
    wire = wire_bits(frame)
    leaves_at = data.draw(st.integers(1, len(wire) - 4))
    planned = attempt([node("A", frame)], [node("B"), node("C")])
    silent = fall_silent(planned, float(leaves_at), RATES, stuck=False)
    nodes = [(PlainNode(True), wire), (PlainNode(False), wire), (PlainNode(False), wire)]
    assert silent.free_at == plain_bus(nodes, leaves_at=leaves_at)
    assert bool(silent.received) != bool(silent.failures)


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
    assert planned.free_at == 31 + (6 - same) + 6 + 8 + 3
    everybody_passive = attempt([node("A", frame, passive=True)], [node("B", passive=True)], 30)
    assert everybody_passive.free_at == 31 + 6 + 8 + 3


def test_the_data_phase_is_timed_at_its_own_rate() -> None:
    frame = Frame(0x123, bytes(range(64)), fd=True, brs=True)
    nominal, fast = frame_bits(frame)
    planned = plan_attempt(10.0, [node("A", frame)], [node("B")], Rates(4.0, 1.0), lambda _: None)
    assert planned.free_at == 10.0 + 4 * nominal + fast
    fdf = next(i for i, bit in enumerate(wire_bits(frame)) if bit.fast)
    assert Rates(4.0, 1.0).end_of(wire_bits(frame), fdf, 10.0) == 10.0 + 4 * fdf + 1
    assert Rates(4.0, 1.0).end_of(wire_bits(frame), -1, 10.0) == 10.0
