"""CAN frames as text: the notation of can-utils, log lines, what candump shows."""

from __future__ import annotations

from datetime import datetime

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot_agent.link.can.protocol.frames import FD_LENGTHS, Frame
from msbot_agent.link.can.protocol.notation import (
    LogLine,
    format_frame,
    format_log_line,
    parse_frame,
    parse_log_line,
    show_frame,
)
from msbot_xrce.errors import ConfigError
from tests.link.can.protocol.test_bits import frames

TEXTS = [
    ("123#DEADBEEF", Frame(0x123, b"\xde\xad\xbe\xef")),
    ("123#", Frame(0x123)),
    ("7FF#0011223344556677", Frame(0x7FF, bytes.fromhex("0011223344556677"))),
    ("1ABCDEF0#1122", Frame(0x1ABCDEF0, b"\x11\x22", extended=True)),
    ("00000123#01", Frame(0x123, b"\1", extended=True)),
    ("123#R", Frame(0x123, remote=True)),
    ("123#R4", Frame(0x123, remote=True, remote_length=4)),
    ("123#0011223344556677_F", Frame(0x123, bytes.fromhex("0011223344556677"), long_dlc=15)),
    ("1ABCDEF0#R8_9", Frame(0x1ABCDEF0, extended=True, remote=True, remote_length=8, long_dlc=9)),
    ("1ABCDEF0#R8", Frame(0x1ABCDEF0, extended=True, remote=True, remote_length=8)),
    ("123##0", Frame(0x123, fd=True)),
    ("123##1DEADBEEF", Frame(0x123, b"\xde\xad\xbe\xef", fd=True, brs=True)),
    ("123##2DE", Frame(0x123, b"\xde", fd=True, esi=True)),
    ("1ABCDEF0##3DE", Frame(0x1ABCDEF0, b"\xde", extended=True, fd=True, brs=True, esi=True)),
    ("20000004#0008000000000000", Frame(4, bytes.fromhex("0008000000000000"), error=True)),
]


@pytest.mark.parametrize(("text", "frame"), TEXTS)
def test_notation_both_ways(text: str, frame: Frame) -> None:
    assert parse_frame(text) == frame
    assert format_frame(frame) == text


@pytest.mark.parametrize(
    ("text", "same"),
    [
        ("123#de.ad.be.ef", "123#DEADBEEF"),
        ("123#.DE.AD.", "123#DEAD"),
        ("123#r2", "123#R2"),
        ("1abcdef0##1de.ad", "1ABCDEF0##1DEAD"),
        ("123##5DE", "123##1DE"),
        ("123##1112233445566778899", "123##1112233445566778899CCCCCC"),
    ],
)
def test_other_ways_to_write_the_same(text: str, same: str) -> None:
    assert format_frame(parse_frame(text)) == same


def test_a_can_fd_frame_takes_64_octets() -> None:
    assert parse_frame("123##0" + "5A" * 64).data == b"Z" * 64


def test_both_flags_of_a_can_fd_frame() -> None:
    frames = [parse_frame(f"123##{flags}AA") for flags in range(4)]
    assert [(frame.brs, frame.esi) for frame in frames] == [(False, False), (True, False), (False, True), (True, True)]


def test_the_last_short_identifier_and_the_first_that_needs_eight_digits() -> None:
    with pytest.raises(ConfigError, match="CAN FD is written with two #"):
        parse_frame("7FF#" + 9 * "00")
    with pytest.raises(ConfigError, match="with 8 digits, 00000800, the frame is an extended one"):
        parse_frame("800#")


def test_of_a_long_line_the_first_100_letters_are_shown() -> None:
    with pytest.raises(ConfigError, match=r"^'x{100}' is not a line"):
        parse_log_line("x" * 100)
    with pytest.raises(ConfigError, match=r"^'x{100}\.\.\.' is not a line"):
        parse_log_line("x" * 101)


def test_a_hint_is_given_where_it_helps() -> None:
    with pytest.raises(ConfigError, match="CAN FD is written with two #"):
        parse_frame("123#001122334455667788")
    for text in ("123#0011223344556677_8", "800#0011223344556677", "40000000#0011223344556677"):
        with pytest.raises(ConfigError) as refused:
            parse_frame(text)
        assert "two #" not in str(refused.value)


@given(st.binary(max_size=64))
def test_fd_data_is_padded_with_cc_to_the_next_length(data: bytes) -> None:
    padded = parse_frame(f"123##0{data.hex()}").data
    assert padded[: len(data)] == data
    assert set(padded[len(data) :]) <= {0xCC}
    assert len(padded) == min(length for length in FD_LENGTHS if length >= len(data))


@given(frames())
def test_every_frame_comes_back(frame: Frame) -> None:
    assert parse_frame(format_frame(frame)) == frame
    line = LogLine(1700000000.123456, "can0", frame)
    assert parse_log_line(format_log_line(line)) == line


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("hello", "'hello' is no CAN frame: write 123#DEADBEEF"),
        ("", "is no CAN frame"),
        ("123", "is no CAN frame"),
        ("12#00", "with 8 digits before the # for an extended frame"),
        ("12345#00", "is no CAN frame"),
        ("123#0", "is no CAN frame"),
        ("123#R4DE", "is no CAN frame"),
        ("123#DE AD", "is no CAN frame"),
        ("123###00", "is no CAN frame"),
        ("123##", "is no CAN frame"),
        ("8FF#00", "0x8ff is outside 0 to 0x7ff; with 8 digits, 000008FF, the frame is an extended one"),
        ("40000000#", "outside 0 to 0x1fffffff"),
        ("123#001122334455667788", "at most 8 bytes, not 9; CAN FD is written with two #"),
        ("123##8", "the flags of a CAN FD frame are 1 = bit-rate switch and 2 = ESI, not 8"),
        ("123##0" + "00" * 65, "at most 64 bytes, not 65"),
        ("123#R9", "asks for 0 to 8 bytes"),
    ],
)
def test_what_is_wrong_is_said_in_one_sentence(text: str, words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_frame(text)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("line", "at", "channel", "frame"),
    [
        ("(1700000000.123456) can0 123#DEAD", 1700000000.123456, "can0", "123#DEAD"),
        ("(0.5) vcan1 123##1DEAD R\n", 0.5, "vcan1", "123##1DEAD"),
        (" (000.000123)  can0  123   [2]  DE AD", 0.000123, "can0", "123#DEAD"),
        ("  can0  123   [0]", None, "can0", "123#"),
        ("  can0  123   [3]  DE AD 2E   '...'", None, "can0", "123#DEAD2E"),
        ("  can0  123  [02]  DE AD", None, "can0", "123##0DEAD"),
        ("  can0  RX B E  123  [02]  DE AD", None, "can0", "123##3DEAD"),
        ("  can0  TX - -  1ABCDEF0   [1]  DE", None, "can0", "1ABCDEF0#DE"),
        ("  can0  123   [4]  remote request", None, "can0", "123#R4"),
        ("  can0  20000004   [2]  00 08   ERRORFRAME", None, "can0", "20000004#0008"),
    ],
)
def test_log_lines(line: str, at: float | None, channel: str, frame: str) -> None:
    assert parse_log_line(line) == LogLine(at, channel, parse_frame(frame))


@pytest.mark.parametrize("frame", ["can0 123#DEAD", "can0  123   [2]  DE AD"])
def test_a_line_with_a_date_has_the_time_of_this_place(frame: str) -> None:
    line = parse_log_line(f" (2026-03-02 10:11:12.123456)  {frame}")
    assert line.at == datetime(2026, 3, 2, 10, 11, 12, 123456).timestamp()
    assert line.frame == parse_frame("123#DEAD")


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("(2026-02-30 10:11:12.0) can0 123#DE", "has no possible time"),
        ("hello", "not a line of candump, such as"),
        ("(1.0) can0 123#D", "is no CAN frame"),
        ("can0  123   [3]  DE AD", "says it has 3 data bytes and shows 2"),
        ("can0  FFF   [0]", "outside 0 to 0x7ff"),
    ],
)
def test_lines_that_are_none(line: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        parse_log_line(line)


def test_a_line_without_time_is_written_with_time_0() -> None:
    assert format_log_line(LogLine(None, "can0", Frame(1))) == "(0000000000.000000) can0 001#"


@given(frames())
def test_what_is_shown_is_read_again(frame: Frame) -> None:
    again = parse_log_line(f"  can0  {show_frame(frame)}").frame
    assert format_frame(again).replace("##0", "##") == format_frame(frame).replace(
        f"##{frame.brs | frame.esi << 1}", "##"
    )


def test_columns_line_up() -> None:
    shown = [show_frame(parse_frame(text)) for text in ("123#DE", "1ABCDEF0#DE", "123##1" + "DE" * 12, "20000004#DE")]
    assert shown == [
        "     123   [1]  DE",
        "1ABCDEF0   [1]  DE",
        "     123  [12]  " + " ".join(["DE"] * 12),
        "20000004   [1]  DE",
    ]
