"""Bits of CAN frames against hand-calculated frames, an independent, plain calculator, and a receiver of its own."""

from __future__ import annotations

from itertools import pairwise
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot_agent.link.can.protocol.bits import (
    CRC15_POLYNOMIAL,
    CRC17_POLYNOMIAL,
    CRC21_POLYNOMIAL,
    FrameBits,
    arbitration_rank,
    frame_bits,
    phase_bits,
    wire_bits,
)
from msbot_agent.link.can.protocol.frames import FD_LENGTHS, Frame
from msbot_xrce.errors import LocalProtocolError
from tests.link.wire_receiver import Receiver


@st.composite
def frames(draw: st.DrawFn) -> Frame:
    extended, fd = draw(st.booleans()), draw(st.booleans())
    can_id = draw(st.integers(0, (1 << 29 if extended else 1 << 11) - 1))
    if not fd and draw(st.integers(0, 5)) == 0:
        code = draw(st.integers(0, 15))
        long_dlc = code if code > 8 else 0
        return Frame(can_id, extended=extended, remote=True, remote_length=min(code, 8), long_dlc=long_dlc)
    size = draw(st.sampled_from(FD_LENGTHS if fd else FD_LENGTHS[:9]))
    long_dlc = draw(st.sampled_from([0, *range(9, 16)])) if size == 8 and not fd else 0
    octet = st.one_of(st.integers(0, 255), st.sampled_from([0x00, 0xFF, 0x0F, 0x1F, 0xE0, 0xF8, 0x83]))
    data = bytes(draw(st.lists(octet, min_size=size, max_size=size)))
    brs, esi = fd and draw(st.booleans()), fd and draw(st.booleans())
    return Frame(can_id, data, extended, fd, brs, esi=esi, long_dlc=long_dlc)


def remainder(bits: str, polynomial: int, width: int, initial: int) -> str:
    """CRC by long division: the message, with the initial value added to its front, times x^width."""
    value = int(bits, 2) << width
    value ^= initial << len(bits)
    divisor = polynomial | 1 << width
    for place in range(len(bits) + width - 1, width - 1, -1):
        if value >> place & 1:
            value ^= divisor << (place - width)
    return f"{value:0{width}b}"


def stuff(bits: str) -> str:
    out, run = "", 0
    for bit in bits:
        run = run + 1 if out[-1:] == bit else 1
        out += bit
        if run == 5:
            out += "10"[int(bit)]
            run = 1
    return out


def plain_bits(frame: Frame) -> str:
    """The frame from SOF to the last bit of the intermission, acknowledged, as a string of bits."""
    base = f"{frame.can_id >> 18:011b}11{frame.can_id & 0x3FFFF:018b}" if frame.extended else f"{frame.can_id:011b}"
    size = frame.remote_length if frame.remote else len(frame.data)
    dlc = f"{frame.long_dlc or FD_LENGTHS.index(size):04b}"
    data = "".join(f"{octet:08b}" for octet in frame.data)
    tail = "1" + "0" + "1" + "1" * 7 + "1" * 3
    if not frame.fd:
        raw = "0" + base + str(int(frame.remote)) + "00" + dlc + data
        return stuff(raw + remainder(raw, CRC15_POLYNOMIAL, 15, 0)) + tail
    control = ("0" if frame.extended else "00") + "10" + str(int(frame.brs)) + str(int(frame.esi))
    raw = "0" + base + control + dlc + data
    stuffed = stuff(raw)
    if len(stuffed) - len(stuff(raw[:-1])) == 2:
        stuffed = stuffed[:-1]  # a stuff bit behind the last bit gives way to the first fixed one
    inserted = len(stuffed) - len(raw)
    gray = inserted % 8 ^ inserted % 8 >> 1
    count = f"{gray:03b}" + str(f"{gray:b}".count("1") % 2)
    width, polynomial = (17, CRC17_POLYNOMIAL) if len(frame.data) <= 16 else (21, CRC21_POLYNOMIAL)
    field = count + remainder(stuffed + count, polynomial, width, 1 << width - 1)
    for start in range(0, len(field), 4):
        stuffed += "10"[int(stuffed[-1])] + field[start : start + 4]
    return stuffed + tail


@pytest.mark.parametrize(
    ("width", "polynomial", "check"),
    [(15, CRC15_POLYNOMIAL, 0x059E), (17, CRC17_POLYNOMIAL, 0x04F03), (21, CRC21_POLYNOMIAL, 0x0ED841)],
)
def test_polynomials_give_the_published_check_values(width: int, polynomial: int, check: int) -> None:
    """Check values of "123456789" with initial value 0, as catalogued for CRC-15/CAN, CRC-17/CAN-FD, CRC-21/CAN-FD."""
    bits = "".join(f"{octet:08b}" for octet in b"123456789")
    assert int(remainder(bits, polynomial, width, 0), 2) == check


@given(frames())
def test_bits_are_those_of_the_plain_calculator(frame: Frame) -> None:
    assert "".join(str(bit.level) for bit in wire_bits(frame)) == plain_bits(frame)


@given(frames())
def test_counting_by_tables_counts_the_bits(frame: Frame) -> None:
    bits = wire_bits(frame)
    fast = sum(bit.fast for bit in bits)
    assert frame_bits(frame) == FrameBits(len(bits) - fast, fast)


@given(frames())
def test_a_receiver_reads_the_frame_off_the_wire(frame: Frame) -> None:
    bits = wire_bits(frame)
    received = Receiver([bit.level for bit in bits]).receive()
    assert received.frame == frame
    assert received.stuff_bits == sum(bit.stuff for bit in bits)
    assert (received.nominal_bits, received.data_bits) == phase_bits(frame)


@pytest.mark.parametrize("size", FD_LENGTHS)
def test_each_end_of_the_data_field_is_read_off_the_wire(size: int) -> None:
    """Five equal bits at the end of the data field, or of the DLC, are followed by one stuff bit, the fixed one."""
    for last in range(256):
        data = bytes(max(0, size - 1)) + bytes([last])[: min(1, size)]
        frame = Frame(last, data, fd=True, brs=bool(last & 2), esi=bool(last & 4))
        received = Receiver([bit.level for bit in wire_bits(frame)]).receive()
        assert received.frame == frame
        assert (received.nominal_bits, received.data_bits) == phase_bits(frame)


@given(frames())
def test_phases_are_told_apart_also_without_a_bit_rate_switch(frame: Frame) -> None:
    if frame.brs or not frame.fd:
        assert phase_bits(frame) == frame_bits(frame)
    else:
        assert frame_bits(frame) == (sum(phase_bits(frame)), 0)


@given(frames())
def test_phases_and_stuffing_of_every_frame(frame: Frame) -> None:
    bits = wire_bits(frame)
    slow_fields = {"ACK", "ACK DELIMITER", "EOF", "INTERMISSION", "SOF", "ID", "FDF", "RES", "BRS"}
    for bit in bits:
        assert bit.fast == (frame.brs and bit.field in ("ESI", "DLC", "DATA", "STUFF COUNT", "CRC", "CRC DELIMITER"))
        assert not (bit.fast and bit.field in slow_fields)
    levels = "".join(str(bit.level) for bit in bits[:-13])
    assert "000000" not in levels
    assert "111111" not in levels
    assert not any(first.stuff and second.stuff for first, second in pairwise(bits)), "two in a row"


@pytest.mark.parametrize(
    ("frame", "nominal", "data"),
    [
        # 34 zeros (19 of the header, CRC 0): stuff bits after each five = 6; tail 13.
        (Frame(0), 34 + 6 + 13, 0),
        # 0 00000000000 0 0 | 1 0 0 0 0000: stuff bits after 5, 10, and after RES BRS ESI DLC3 DLC2.
        (Frame(0, fd=True), 22 + 3 + 27 + 13, 0),
        # With BRS the five equal bits ESI DLC end the field: only the fixed stuff bit follows.
        # The switch at the sample points of BRS and CRC delimiter leaves one of the two bits to each rate.
        (Frame(0, fd=True, brs=True), 17 + 2 + 12, 5 + 27 + 1),
        (Frame(0x555, b"\xaa" * 8), 111 + 1, 0),
    ],
)
def test_hand_calculated_lengths(frame: Frame, nominal: int, data: int) -> None:
    assert frame_bits(frame) == (nominal, data)


@pytest.mark.parametrize("sample_points", [(0.8, 0.8), (0.875, 0.6)])
def test_a_bit_rate_switch_at_the_sample_points_takes_what_is_counted(sample_points: tuple[float, float]) -> None:
    """The time of a frame, bit by bit, each of the two switching bits in two parts."""
    slow, fast = 1 / 500_000, 1 / 2_000_000
    at_slow, at_fast = sample_points
    frame = Frame(0x123, bytes(range(20)), fd=True, brs=True)
    seconds = 0.0
    in_data_phase = False
    for bit in wire_bits(frame):
        if bit.field == "BRS" and not bit.stuff:
            seconds += at_slow * slow + (1 - at_fast) * fast
            in_data_phase = True
        elif bit.field == "CRC DELIMITER":
            seconds += at_fast * fast + (1 - at_slow) * slow
            in_data_phase = False
        else:
            seconds += fast if in_data_phase else slow
    assert frame_bits(frame).seconds(500_000, 2_000_000) == pytest.approx(seconds, rel=1e-12)


def test_unstuffed_lengths_are_the_published_ones() -> None:
    def plain(frame: Frame) -> int:
        return sum(not bit.stuff for bit in wire_bits(frame))

    assert plain(Frame(1, bytes(8))) == 111
    assert plain(Frame(1, bytes(8), extended=True)) == 131
    assert plain(Frame(1, remote=True, remote_length=8)) == 47
    fixed = [bit for bit in wire_bits(Frame(1, bytes(64), fd=True)) if bit.fixed]
    assert len(fixed) == 7
    assert len([bit for bit in wire_bits(Frame(1, bytes(16), fd=True)) if bit.fixed]) == 6


def test_mean_length_on_random_data() -> None:
    random = Random(7)
    lengths = [frame_bits(Frame(0x123, random.randbytes(8))).nominal_bits for _ in range(20000)]
    assert sum(lengths) / len(lengths) == pytest.approx(113.8, abs=0.1)
    assert max(lengths) <= 135


def test_seconds_add_both_phases() -> None:
    assert FrameBits(50, 100).seconds(500_000, 2_000_000) == pytest.approx(150e-6)
    assert FrameBits(111, 0).seconds(125_000) == pytest.approx(888e-6)


@given(frames())
def test_stuff_bits_in_the_data_count_for_the_phase_they_are_in(frame: Frame) -> None:
    nominal, data = frame_bits(frame)
    assert (data > 0) == frame.brs
    assert nominal + data == len(wire_bits(frame, acknowledged=False))


@given(frames(), frames())
def test_arbitration_rank_orders_as_the_wire_does(one: Frame, other: Frame) -> None:
    """The lower rank has the dominant bit at the first difference of the arbitration fields."""
    fields = ("ID", "SRR", "IDE", "RTR", "RRS")

    def arbitration(frame: Frame) -> list[int]:
        return [bit.level for bit in wire_bits(frame) if bit.field in fields and not bit.stuff]

    first, second = arbitration(one), arbitration(other)
    difference = next((i for i, (a, b) in enumerate(zip(first, second, strict=False)) if a != b), None)
    if difference is None:
        assert arbitration_rank(one) == arbitration_rank(other)
    else:
        assert (arbitration_rank(one) < arbitration_rank(other)) == (first[difference] == 0)


def test_a_standard_frame_wins_against_an_extended_one_and_data_against_remote() -> None:
    standard, remote = Frame(0x123), Frame(0x123, remote=True)
    extended = Frame(0x123 << 18, extended=True)
    ranks = [arbitration_rank(frame) for frame in (standard, remote, extended, Frame(0x124))]
    assert ranks == sorted(ranks)


@pytest.mark.parametrize("bad", [Frame(1, bytes(9), fd=True), Frame(1, error=True)])
def test_impossible_frames_have_no_length(bad: Frame) -> None:
    with pytest.raises(LocalProtocolError):
        frame_bits(bad)
    with pytest.raises(LocalProtocolError):
        wire_bits(bad)
