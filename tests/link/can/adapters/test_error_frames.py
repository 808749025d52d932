from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msbot.link.can.adapters import error_frames as can_errors
from msbot.link.can.adapters.error_frames import STATE_WORDS, WARNING_WORDS, read_report
from msbot.link.can.controller import BusState


@pytest.mark.parametrize(
    ("classes", "data", "state", "words"),
    [
        (0x40, "", BusState.OFF, STATE_WORDS[BusState.OFF]),
        (0x44, "0030", BusState.OFF, STATE_WORDS[BusState.OFF]),
        (0x100, "", BusState.ACTIVE, "back on the bus"),
        (0x04, "0010", BusState.PASSIVE, STATE_WORDS[BusState.PASSIVE]),
        (0x04, "0020", BusState.PASSIVE, STATE_WORDS[BusState.PASSIVE]),
        (0x04, "000c", BusState.ACTIVE, WARNING_WORDS),
        (0x04, "0040", BusState.ACTIVE, STATE_WORDS[BusState.ACTIVE]),
        (0x04, "0001", None, ""),
        (0x20, "", None, ""),
        (0, "", None, ""),
    ],
)
def test_states_of_the_controller(classes: int, data: str, state: BusState | None, words: str) -> None:
    report = read_report(classes, bytes.fromhex(data))
    assert (report.state, report.words) == (state, words)


@pytest.mark.parametrize(
    ("classes", "data", "events"),
    [
        (0x001, "", (can_errors.TX_TIMEOUT_WORDS,)),
        (0x002, "05", (can_errors.LOST_ARBITRATION_WORDS,)),
        (0x004, "0003", (can_errors.RX_OVERFLOW_WORDS, can_errors.TX_OVERFLOW_WORDS)),
        (0x020, "", (can_errors.NO_ACK_WORDS,)),
        (0x0A8, "00000819", (can_errors.NO_ACK_WORDS, "dominant bit not seen on the bus: wire broken or transceiver "
         "off in the acknowledgement")),
        (0x008, "00000408", ("stuff error in the check sum",)),
        (0x008, "000003ff", ("bit error", "form error")),
        (0x008, "", (can_errors.BUS_ERROR_WORDS,)),
        (0x080, "", (can_errors.BUS_ERROR_WORDS,)),
        (0x088, "000010", ("recessive bit not seen on the bus: short circuit or two nodes with one identifier",)),
        (0x010, "0000000047", ("CAN high: short circuit to ground", "CAN low: no wire")),
        (0x010, "0000000080", ("CAN low: short circuit to CAN high",)),
        (0x010, "0000000000", ("the transceiver reports an error",)),
        (0x200, "", ()),
    ],
)  # fmt: skip
def test_single_events(classes: int, data: str, events: tuple[str, ...]) -> None:
    assert read_report(classes, bytes.fromhex(data)).events == events


def test_error_counters_are_told_where_the_driver_gives_them() -> None:
    with_counters = read_report(0x204, bytes.fromhex("0008000000006000"))
    assert (with_counters.transmit_errors, with_counters.receive_errors) == (0x60, 0)
    older_kernel = read_report(0x004, bytes.fromhex("0008000000000061"))
    assert (older_kernel.transmit_errors, older_kernel.receive_errors) == (0, 0x61)
    without = read_report(0x004, bytes.fromhex("0008000000000000"))
    assert (without.transmit_errors, without.receive_errors) == (None, None)


@given(st.integers(0, 0x1FFFFFFF), st.binary(max_size=8))
@settings(deadline=None)
def test_every_report_has_words_for_its_state(classes: int, data: bytes) -> None:
    report = read_report(classes, data)
    assert (report.state is None) == (not report.words)
    assert all(report.events)
    assert report.state is not BusState.GONE
