"""Fault confinement and the bit at which an error is noticed."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot_agent.link.can.controller import BusState
from msbot_agent.link.can.protocol.bits import WireBit, wire_bits
from msbot_agent.link.can.protocol.frames import Frame
from msbot_agent.link.can.sim.model.events import DOMINANT, RECESSIVE, ErrorCounters, is_tail, noticed_at

FRAME = wire_bits(Frame(0x555, b"\x55" * 8))
FD_FRAME = wire_bits(Frame(0x555, b"\x55" * 8, fd=True))


def index_of(bits: list[object], field: str) -> int:
    return next(i for i, bit in enumerate(bits) if getattr(bit, "field", None) == field)


def test_sixteen_failures_make_passive_and_thirty_two_take_off_the_bus() -> None:
    counters = ErrorCounters()
    states = []
    for _ in range(32):
        states.append(counters.state)
        counters.transmit_failed()
    assert states == [BusState.ACTIVE] * 16 + [BusState.PASSIVE] * 16
    assert counters.state is BusState.OFF
    assert not counters.active


def test_success_counts_down_by_one() -> None:
    counters = ErrorCounters(transmit=9, receive=3)
    counters.transmit_succeeded()
    counters.receive_succeeded()
    assert (counters.transmit, counters.receive) == (8, 2)
    counters = ErrorCounters()
    counters.transmit_succeeded()
    counters.receive_succeeded()
    assert (counters.transmit, counters.receive) == (0, 0)


def test_a_receiver_gets_passive_but_never_off() -> None:
    counters = ErrorCounters()
    for _ in range(128):
        counters.receive_failed()
    assert counters.state is BusState.PASSIVE
    counters.receive_failed(first=True)
    assert counters.receive == 137
    counters.receive_succeeded()
    assert (counters.receive, counters.state) == (119, BusState.ACTIVE)


def test_an_error_flag_is_noticed_at_the_sixth_equal_bit() -> None:
    # Bits alternate, so with a flag from bit 31 on, bits 31 to 36 are dominant, and so was bit 30 or not.
    level = FRAME[30].level
    expected = 36 if level == RECESSIVE else 35
    assert noticed_at(FRAME, 30, level, DOMINANT) == expected
    assert noticed_at(FRAME, 30, level, RECESSIVE) == 71 - expected


@pytest.mark.parametrize("broken", [-1, 0])
def test_a_level_that_stays_dominant_from_the_first_bit_on_is_noticed_at_the_sixth(broken: int) -> None:
    assert FRAME[0].level == DOMINANT
    assert noticed_at(FRAME, broken, DOMINANT, DOMINANT) == 5


@pytest.mark.parametrize(("field", "noticed"), [("CRC DELIMITER", "ACK DELIMITER"), ("ACK", "ACK DELIMITER")])
def test_an_error_flag_in_the_tail_is_a_form_error(field: str, noticed: str) -> None:
    at = index_of([*FRAME], field)
    assert noticed_at(FRAME, at, FRAME[at].level, DOMINANT) == index_of([*FRAME], noticed)


def test_a_sender_that_vanishes_after_the_crc_is_not_missed() -> None:
    at = index_of([*FRAME], "CRC DELIMITER")
    assert noticed_at(FRAME, at, 1, RECESSIVE) is None
    assert noticed_at(FRAME, -1, 1, RECESSIVE) is not None


def test_a_sender_that_vanishes_in_the_last_crc_bits_leaves_a_crc_error_behind_the_ack_delimiter() -> None:
    at = index_of([*FRAME], "CRC DELIMITER")
    last_dominant = max(i for i in range(at) if FRAME[i].level == DOMINANT)
    assert at - last_dominant < 5
    assert noticed_at(FRAME, last_dominant - 1, FRAME[last_dominant - 1].level, RECESSIVE) in (
        index_of([*FRAME], "ACK DELIMITER"),
        *range(last_dominant, at),
    )


def test_a_wrong_fixed_stuff_bit_is_noticed_at_once() -> None:
    fixed = [i for i, bit in enumerate(FD_FRAME) if bit.fixed]
    before = fixed[2] - 1
    assert noticed_at(FD_FRAME, before, FD_FRAME[before].level, FD_FRAME[before].level) == fixed[2]


def test_a_bit_that_breaks_the_rules_itself_is_noticed_there() -> None:
    at = index_of([*FRAME], "EOF")
    assert noticed_at(FRAME, at, DOMINANT, DOMINANT) == at


@given(st.integers(-1, len(FRAME) - 4), st.sampled_from([DOMINANT, RECESSIVE]))
def test_an_error_is_noticed_within_seven_bits_or_behind_the_ack(broken: int, level: int) -> None:
    noticed = noticed_at(FRAME, broken, FRAME[max(broken, 0)].level, level)
    if noticed is None:
        assert all(bit.level == level or is_tail(bit) for bit in FRAME[broken + 1 :])
    else:
        assert broken < noticed
        assert noticed <= broken + 7 or FRAME[noticed].field == "ACK DELIMITER"


@pytest.mark.parametrize(
    ("transmit", "receive", "state"),
    [
        (127, 127, BusState.ACTIVE),
        (128, 127, BusState.PASSIVE),
        (127, 128, BusState.PASSIVE),
        (255, 0, BusState.PASSIVE),
        (0, 300, BusState.PASSIVE),
    ],
)
def test_a_controller_is_passive_above_127(transmit: int, receive: int, state: BusState) -> None:
    counters = ErrorCounters(transmit, receive)
    assert counters.state is state
    assert counters.active is (state is BusState.ACTIVE)


@pytest.mark.parametrize(("before", "off"), [(247, False), (248, True)])
def test_a_controller_is_off_above_255_and_stays_off(before: int, off: bool) -> None:
    counters = ErrorCounters(before)
    counters.transmit_failed()
    counters.transmit_succeeded()
    assert (counters.off, counters.state is BusState.OFF) == (off, off)


@pytest.mark.parametrize(("before", "after"), [(0, 0), (1, 0), (127, 126), (128, 119), (200, 119)])
def test_a_received_frame_counts_down(before: int, after: int) -> None:
    counters = ErrorCounters(receive=before)
    counters.receive_succeeded()
    assert counters.receive == after


def seen_wrong_at(bits: Sequence[WireBit], broken: int, broken_level: int, level: int) -> int | None:
    """A second, plain receiver: writes all levels down first, then asks of each bit whether it breaks a rule."""
    levels = [bit.level for bit in bits[: max(0, broken)]] + [broken_level] * (broken >= 0)
    levels += [level] * (len(bits) - len(levels))
    for index in range(max(0, broken), len(bits)):
        field = bits[index].field
        before = [at for at in range(index) if levels[at] != bits[at].level and not is_tail(bits[at])]
        if field == "ACK DELIMITER" and before:
            return index  # its own CRC is another one
        if field in ("CRC DELIMITER", "ACK DELIMITER", "EOF"):
            wrong = levels[index] == DOMINANT
        elif field in ("ACK", "INTERMISSION"):
            wrong = False
        elif bits[index].fixed:
            wrong = index > 0 and levels[index] == levels[index - 1]
        else:
            wrong = index >= 5 and len(set(levels[index - 5 : index + 1])) == 1
        if wrong:
            return index
    return None


@pytest.mark.parametrize(
    "frame",
    [
        Frame(0x555, b"\x55" * 2),
        Frame(0),
        Frame(0x7FF, b"\xff\xff"),
        Frame(0x123, remote=True),
        Frame(0x1ABCDEF0, b"\x0f", extended=True),
        Frame(0x0F0, b"\x00\x81", fd=True),
    ],
)
def test_a_broken_frame_is_noticed_where_a_plain_receiver_does(frame: Frame) -> None:
    bits = wire_bits(frame)
    for broken, first, level in product(range(-1, len(bits)), (DOMINANT, RECESSIVE), (DOMINANT, RECESSIVE)):
        assert noticed_at(bits, broken, first, level) == seen_wrong_at(bits, broken, first, level), (broken, first)
