from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msbot_agent.link.can.adapters import error_frames as can_errors
from msbot_agent.link.can.adapters.error_frames import STATE_WORDS, WARNING_WORDS, read_report
from msbot_agent.link.can.controller import BusState


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
        (
            0x0A8,
            "00000819",
            (
                can_errors.NO_ACK_WORDS,
                "dominant bit not seen on the bus: wire broken or transceiver off in the acknowledgement",
            ),
        ),
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
)
def test_single_events(classes: int, data: str, events: tuple[str, ...]) -> None:
    assert read_report(classes, bytes.fromhex(data)).events == events


def test_error_counters_are_told_where_the_driver_gives_them() -> None:
    with_counters = read_report(0x204, bytes.fromhex("0008000000006000"))
    assert (with_counters.transmit_errors, with_counters.receive_errors) == (0x60, 0)
    older_kernel = read_report(0x004, bytes.fromhex("0008000000000061"))
    assert (older_kernel.transmit_errors, older_kernel.receive_errors) == (0, 0x61)
    sender_only = read_report(0x008, bytes.fromhex("0000010000006100"))
    assert (sender_only.transmit_errors, sender_only.receive_errors) == (0x61, 0)
    without = read_report(0x004, bytes.fromhex("0008000000000000"))
    assert (without.transmit_errors, without.receive_errors) == (None, None)


def test_octet_1_says_nothing_when_the_controller_is_not_meant() -> None:
    for classes in (0x001, 0x002, 0x008, 0x080):
        report = read_report(classes, bytes((0, 0xFF, 1)))
        assert (report.state, report.words) == (None, "")
        assert len(report.events) == 1
        assert report.events[0] not in (can_errors.RX_OVERFLOW_WORDS, can_errors.TX_OVERFLOW_WORDS)


@given(st.integers(0, 0x1FFFFFFF), st.binary(max_size=8))
@settings(deadline=None)
def test_every_report_has_words_for_its_state(classes: int, data: bytes) -> None:
    report = read_report(classes, data)
    assert (report.state is None) == (not report.words)
    assert all(report.events)
    assert report.state is not BusState.GONE


PLACES = {
    "start of frame": (3,), "identifier": (2, 6, 7, 14, 15), "SRR bit": (4,), "IDE bit": (5,), "RTR bit": (12,),
    "reserved bit": (9, 13), "length": (11,), "data": (10,), "check sum": (8,), "check sum delimiter": (24,),
    "acknowledgement": (25,), "acknowledgement delimiter": (27,), "end of frame": (26,), "intermission": (18,),
}  # fmt: skip
"""Octet 3 of an error frame, `CAN_ERR_PROT_LOC_...` of linux/can/error.h, in numbers from there."""
KINDS = ("bit error", "form error", "stuff error", "dominant", "recessive", "overload frame")
"""Octet 2, `CAN_ERR_PROT_...`, from the lowest bit on."""


def test_every_place_in_a_frame_that_linux_knows_has_its_words_and_no_other_number_has() -> None:
    expected = {number: f"bit error in the {words}" for words, numbers in PLACES.items() for number in numbers}
    for number in range(256):
        report = read_report(0x008, bytes((0, 0, 1, number)))
        assert report.events == (expected.get(number, "bit error"),), number


@given(st.sets(st.integers(0, 7)))
def test_every_kind_of_bus_error_that_linux_knows_is_told_once(bits: set[int]) -> None:
    told = read_report(0x008, bytes((0, 0, sum(1 << bit for bit in bits)))).events
    expected = [KINDS[bit] for bit in sorted(bits) if bit < len(KINDS)]
    assert len(told) == max(1, len(expected))
    assert all(words.startswith(kind) for words, kind in zip(told, expected, strict=False))


@given(st.sets(st.integers(0, 9)))
def test_every_class_of_an_error_frame_is_a_bit_of_its_own(bits: set[int]) -> None:
    """`CAN_ERR_...`: timeout, arbitration, controller, protocol, transceiver, no ACK, bus off, bus error, restarted,
    counters."""
    report = read_report(sum(1 << bit for bit in bits), bytes((0, 3, 1, 0, 0, 0, 0, 0)))
    off, back = 6 in bits, 8 in bits
    assert report.state is (BusState.OFF if off else BusState.ACTIVE if back else None)
    assert (report.transmit_errors == 0) == (9 in bits)
    told = {
        can_errors.TX_TIMEOUT_WORDS: 0 in bits,
        can_errors.LOST_ARBITRATION_WORDS: 1 in bits,
        can_errors.RX_OVERFLOW_WORDS: 2 in bits,
        can_errors.TX_OVERFLOW_WORDS: 2 in bits,
        "bit error": 3 in bits,
        "the transceiver reports an error": 4 in bits,
        can_errors.NO_ACK_WORDS: 5 in bits,
        can_errors.BUS_ERROR_WORDS: 7 in bits and not bits & {3, 5},
    }
    assert set(report.events) == {words for words, is_told in told.items() if is_told}


@pytest.mark.parametrize("bit", range(8))
def test_each_bit_of_the_controllers_octet_says_one_thing(bit: int) -> None:
    report = read_report(0x004, bytes((0, 1 << bit)))
    events = {0: (can_errors.RX_OVERFLOW_WORDS,), 1: (can_errors.TX_OVERFLOW_WORDS,)}
    states = {
        2: WARNING_WORDS,
        3: WARNING_WORDS,
        4: STATE_WORDS[BusState.PASSIVE],
        5: STATE_WORDS[BusState.PASSIVE],
        6: STATE_WORDS[BusState.ACTIVE],
    }
    assert (report.events, report.words) == (events.get(bit, ()), states.get(bit, ""))


@pytest.mark.parametrize("high", range(16))
@pytest.mark.parametrize("low", range(8))
def test_each_wire_is_told_by_itself(high: int, low: int) -> None:
    words = {
        4: "no wire",
        5: "short circuit to the battery",
        6: "short circuit to the supply",
        7: "short circuit to ground",
    }
    events = read_report(0x010, bytes((0, 0, 0, 0, low << 4 | high))).events
    expected = [f"CAN high: {words[high]}"] if high in words else []
    expected += [f"CAN low: {words[low]}"] if low in words else []
    assert events == (tuple(expected) or ("the transceiver reports an error",))
