"""Frames in words: joining, segments, losses, compression, foreign traffic."""

from __future__ import annotations

from collections.abc import Hashable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot_agent.link.can.protocol.decoder import CanDecoder, LegacyDecoder, report_words
from msbot_agent.link.can.protocol.frames import Frame, split
from msbot_agent.link.can.protocol.ids import (
    CAN_FD,
    COMPRESSION,
    NOBODY,
    Assign,
    Beacon,
    CanIds,
    assign_frame,
    beacon_frame,
    join_frame,
    question_frame,
    stop_frame,
)
from msbot_agent.link.can.protocol.legacy_frames import split_legacy
from msbot_agent.link.can.protocol.notation import parse_frame
from msbot_xrce.errors import RemoteProtocolError
from tests.link.can.protocol.test_bits import frames

IDS = CanIds()
UID = bytes(range(1, 9))


def explain(packet: bytes, peer: Hashable, *, up: bool) -> list[str]:
    return [f"{peer} {'up' if up else 'down'} {packet.hex()}"]


def decompress(data: bytes) -> bytes:
    """A short form begins with 0 and leaves one zero out."""
    if data[0] != 0:
        raise RemoteProtocolError("compressed message: not this")
    return b"\x81" + data


def decoder() -> CanDecoder:
    return CanDecoder(explain, decompress=decompress)


@pytest.mark.parametrize(
    ("frame", "words"),
    [
        (stop_frame(1, IDS), "STOP: STOP was pressed"),
        (stop_frame(77, IDS), "STOP: reason 77"),
        (beacon_frame(Beacon(0, 5, 0xC0FFEE), IDS), "BEACON: robot 00c0ffee, epoch 5"),
        (question_frame(0xC0FFEE, IDS), "question: a master starts, robot 00c0ffee; is there one on this bus?"),
        (
            beacon_frame(Beacon(CAN_FD | COMPRESSION, 5, 0xC0FFEE), IDS),
            "BEACON: robot 00c0ffee, epoch 5, offers CAN FD and header compression",
        ),
        (join_frame(UID, 0, IDS), "JOIN: part 0102030405060708 asks for an address"),
        (join_frame(UID, CAN_FD, IDS), "JOIN: part 0102030405060708 asks for an address, knows CAN FD"),
        (assign_frame(Assign(UID, 7, 5, 0), IDS), "ASSIGN: part 0102030405060708 is node 7, epoch 5"),
        (
            assign_frame(Assign(UID, 7, 5, COMPRESSION), IDS),
            "ASSIGN: part 0102030405060708 is node 7, epoch 5, with header compression",
        ),
        (assign_frame(Assign(UID, 0, 5, 0), IDS), "ASSIGN: no address for part 0102030405060708"),
        (assign_frame(Assign(NOBODY, 7, 5, 0), IDS), "ASSIGN: node 7 must ask again"),
        (parse_frame("101#C0112233"), "node 1 to master, SE  0: 3 bytes"),
        (parse_frame("1F8#FF11"), "master to node 120, SE 63: 1 byte"),
        (parse_frame("101#8411223344556677"), "node 1 to master, S  4"),
        (parse_frame("101#0511223344556677"), "node 1 to master,   5: message without its first frame"),
        (parse_frame("101#"), "node 1 to master: frame without a segment header"),
        (parse_frame("101#C0"), "node 1 to master, SE  0: message without content"),
        (parse_frame("101#R"), "foreign: a remote frame"),
        (parse_frame("100#C011"), "foreign"),
        (parse_frame("179#C011"), "foreign"),
        (parse_frame("00000101#C011"), "foreign"),
        (parse_frame("700#0201000000000000"), "foreign"),
        (parse_frame("1E000000#0102030405060708"), "foreign"),
        (parse_frame("7FF#"), "foreign"),
        (parse_frame("20000044#"), "error report: controller problem, bus-off"),
        (parse_frame("20000000#"), "error report: unknown"),
    ],
)
def test_each_kind_of_frame_is_named(frame: Frame, words: str) -> None:
    assert decoder().decode(frame, 0.0)[0] == words


@pytest.mark.parametrize("fd", [False, True])
@given(packet=st.binary(min_size=1, max_size=300).map(lambda rest: b"\x81" + rest))
def test_a_packet_in_many_frames_is_explained_at_its_last_one(fd: bool, packet: bytes) -> None:
    listener = decoder()
    lines = [listener.decode(Frame(0x105, data, fd=fd), 0.0) for data in split(packet, 60, fd)]
    assert all(len(line) == 1 for line in lines[:-1])
    assert lines[-1][0].endswith(f": {len(packet)} byte{'s' * (len(packet) > 1)}")
    assert lines[-1][1:] == [f"5 up {packet.hex()}"]


def test_nodes_and_directions_are_kept_apart() -> None:
    listener = decoder()
    streams = [(0x101, b"\x81" + bytes(10)), (0x181, b"\x82" + bytes(10)), (0x102, b"\x83" + bytes(10))]
    cut = [[Frame(can_id, data) for data in split(packet, 0, False)] for can_id, packet in streams]
    said = [listener.decode(frame, 0.0) for turn in zip(*cut, strict=True) for frame in turn]
    assert [lines[1] for lines in said if len(lines) > 1] == [
        f"1 up 81{'00' * 10}",
        f"1 down 82{'00' * 10}",
        f"2 up 83{'00' * 10}",
    ]


@pytest.mark.parametrize(
    ("bits", "words"),
    [
        (0x001, "a frame was not sent in time"),
        (0x002, "arbitration lost"),
        (0x004, "controller problem"),
        (0x008, "protocol violation"),
        (0x010, "transceiver problem"),
        (0x020, "nobody acknowledged"),
        (0x040, "bus-off"),
        (0x080, "bus error"),
        (0x100, "restarted"),
        (0x200, "error counters changed"),
        (0x088, "protocol violation, bus error"),
        (0x400, "unknown"),
    ],
)
def test_an_error_report_says_what_linux_means_by_its_bits(bits: int, words: str) -> None:
    assert report_words(Frame(bits, bytes(8), error=True)) == f"error report: {words}"


def test_a_lost_frame_is_named_and_the_packet_not_explained() -> None:
    listener = decoder()
    first, _, third = (Frame(0x101, data) for data in split(bytes(range(0x81, 0x81 + 20)), 0, False))
    assert listener.decode(first, 0.0) == ["node 1 to master, S  0"]
    assert listener.decode(third, 0.0) == ["node 1 to master, E  2: a frame of the message is missing"]
    assert listener.decode(third, 0.0) == ["node 1 to master, E  2: frame repeated by the bus"]


def test_a_new_owner_of_an_address_begins_anew() -> None:
    listener = decoder()
    listener.decode(Frame(0x107, split(bytes(range(0x81, 0x81 + 20)), 0, False)[0]), 0.0)
    listener.decode(assign_frame(Assign(UID, 7, 5, 0), IDS), 0.0)
    assert listener.decode(parse_frame("107#C981"), 0.0) == ["node 7 to master, SE  9: 1 byte", "7 up 81"]


@pytest.mark.parametrize("number", [f"{base + 7:03X}" for base in (IDS.up, IDS.down)])
@pytest.mark.parametrize("owner", [UID, NOBODY])
def test_what_was_begun_before_an_address_was_given_or_taken_is_forgotten(number: str, owner: bytes) -> None:
    listener = decoder()
    listener.decode(assign_frame(Assign(UID, 7, 5, COMPRESSION), IDS), 0.0)
    for counter in ("80", "89"):  # the first of several frames, with count 0 and then 9
        (words,) = listener.decode(parse_frame(f"{number}#{counter}818283848586"), 0.0)
        assert words.endswith(f", S  {int(counter, 16) & 0x3F}"), "nothing is missing"
        listener.decode(assign_frame(Assign(owner, 7, 5, 0), IDS), 0.0)
    up = "up" if number == f"{IDS.up + 7:03X}" else "down"
    first, *others = listener.decode(parse_frame(f"{number}#C90111"), 0.0)
    assert first.endswith("SE  9: 2 bytes"), "it does not compress, or it is not known"
    assert others == [f"7 {up} 0111"]


@pytest.mark.parametrize(
    ("use", "message", "remark", "packet"),
    [
        (COMPRESSION, "0011", "2 bytes for 3", "810011"),
        (COMPRESSION, "0111", "compressed message: not this", None),
        (0, "0011", "2 bytes", "0011"),
        (None, "0011", "2 bytes for 3", "810011"),
        (None, "0111", "2 bytes", "0111"),
        (None, "8111", "2 bytes", "8111"),
    ],
)
def test_compression_is_undone_where_the_assign_says_so_or_is_not_known(
    use: int | None, message: str, remark: str, packet: str | None
) -> None:
    listener = decoder()
    if use is not None:
        listener.decode(assign_frame(Assign(UID, 7, 5, use), IDS), 0.0)
    first, *others = listener.decode(parse_frame(f"107#C0{message}"), 0.0)
    assert first == f"node 7 to master, SE  0: {remark}"
    assert others == ([] if packet is None else [f"7 up {packet}"])


def test_without_a_codec_messages_stand_as_they_are() -> None:
    assert CanDecoder(explain).decode(parse_frame("107#C000"), 0.0)[1] == "7 up 00"


def test_other_bases_are_understood() -> None:
    ids = CanIds(up=0x300, down=0x400)
    listener = CanDecoder(explain, ids=ids)
    assert listener.decode(parse_frame("301#C081"), 0.0)[1] == "1 up 81"
    assert listener.decode(parse_frame("101#C081"), 0.0) == ["foreign"]


@given(st.lists(frames(), max_size=20))
def test_any_frames_are_said_in_one_line_each_and_nothing_raises(many: list[Frame]) -> None:
    listener = decoder()
    for number, frame in enumerate(many):
        assert "\n" not in listener.decode(frame, number * 0.001)[0]


def legacy() -> LegacyDecoder:
    return LegacyDecoder(explain, lambda packet: packet[:1] == b"\x81")


def test_the_thesis_framing_is_understood_both_ways() -> None:
    listener = legacy()
    packet = b"\x81" + bytes(16)
    up = [listener.decode(Frame(0x123, data), 0.0) for data in split_legacy(packet)]
    down = [listener.decode(Frame(0x120, data), 0.0) for data in split_legacy(packet)]
    assert up == [
        ["component to master, 2"],
        ["component to master, 1"],
        ["component to master, 0: 17 bytes", f"0 up {packet.hex()}"],
    ]
    assert down[-1] == ["master to component, 0: 17 bytes", f"0 down {packet.hex()}"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("123#", "component to master: frame without a segment header"),
        ("123#0011", "component to master, 0: message without its first frames, or of two in one"),
        ("121#0011", "foreign"),
        ("00000123#0081", "foreign"),
        ("123##00081", "foreign"),
        ("123#R", "foreign: a remote frame"),
        ("20000020#", "error report: nobody acknowledged"),
        ("008#00", "STOP: no reason given"),
    ],
)
def test_other_frames_beside_the_thesis_framing(text: str, words: str) -> None:
    assert legacy().decode(parse_frame(text), 0.0) == [words]


@given(st.lists(frames(), max_size=20))
def test_any_frames_are_said_in_the_thesis_framing_too(many: list[Frame]) -> None:
    listener = legacy()
    for number, frame in enumerate(many):
        assert "\n" not in listener.decode(frame, number * 0.001)[0]
