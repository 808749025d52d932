"""Fault confinement and the bit at which an error is noticed."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot.link.can.controller import BusState
from msbot.link.can.protocol.bits import wire_bits
from msbot.link.can.protocol.frames import Frame
from msbot.link.can.sim.model.error_counters import DOMINANT, RECESSIVE, ErrorCounters, is_tail, noticed_at

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
