"""Packets cut into CAN frames and joined again, whatever the bus does to the frames."""

from __future__ import annotations

from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msbot_agent.link.can.protocol import frames as can_frames
from msbot_agent.link.can.protocol.frames import (
    FD_LENGTHS,
    FIRST,
    LAST,
    Frame,
    FrameJoiner,
    check_byte,
    check_frame,
    pad_fd,
    split,
)
from msbot_xrce.counting import Tally
from msbot_xrce.errors import LocalProtocolError
from tests.effort import tries

Message = tuple[bytes, list[bytes]]


def plain_check_byte(message: bytes) -> int:
    """CRC-8/AUTOSAR bit by bit."""
    crc = 0xFF
    for octet in message:
        crc ^= octet
        for _ in range(8):
            crc = (crc << 1 ^ 0x2F) & 0xFF if crc & 0x80 else crc << 1
    return crc ^ 0xFF


def join_all(frames: list[bytes], joiner: FrameJoiner | None = None) -> list[bytes]:
    joiner = joiner or FrameJoiner()
    packets = [joiner.receive(frame, 0.001 * i) for i, frame in enumerate(frames)]
    return [packet for packet in packets if packet is not None]


def test_check_byte_has_the_published_check_value() -> None:
    assert check_byte(b"123456789") == 0xDF


@given(st.binary(max_size=600))
def test_check_byte_is_the_plain_crc(message: bytes) -> None:
    assert check_byte(message) == plain_check_byte(message)


@pytest.mark.parametrize(
    ("size", "frames"), [(1, 1), (7, 1), (8, 2), (13, 2), (14, 3), (24, 4), (418, 60), (4096, 586)]
)
def test_number_of_classic_frames(size: int, frames: int) -> None:
    parts = split(bytes(size), 0, False)
    assert len(parts) == frames
    assert all(len(part) == 8 for part in parts[:-1])


def test_a_classic_message_on_the_wire() -> None:
    packet = bytes(range(1, 14))
    assert split(packet, 62, False) == [
        bytes([FIRST | 62]) + packet[:7],
        bytes([LAST | 63]) + packet[7:] + bytes([check_byte(packet)]),
    ]
    assert split(b"abc", 5, False) == [bytes([FIRST | LAST | 5]) + b"abc"]


@pytest.mark.parametrize(
    ("size", "lengths"),
    [
        (1, [2]),
        (7, [8]),
        (8, [12]),
        (10, [12]),
        (11, [16]),
        (62, [64]),
        (63, [64, 2]),
        (124, [64, 64]),
        (125, [64, 64, 1]),
    ],
)
def test_lengths_of_fd_frames(size: int, lengths: list[int]) -> None:
    assert [len(part) for part in split(bytes(size), 0, True)] == lengths


def test_an_fd_message_on_the_wire() -> None:
    packet = bytes(range(1, 9))
    assert split(packet, 3, True) == [bytes([FIRST | LAST | 3, 8]) + packet + bytes(2)]


def test_an_empty_packet_cannot_be_sent() -> None:
    with pytest.raises(LocalProtocolError):
        split(b"", 0, False)


@given(packets=st.lists(st.binary(min_size=1, max_size=300), max_size=12), q=st.integers(0, 63), fd=st.booleans())
def test_joining_undoes_splitting(packets: list[bytes], q: int, fd: bool) -> None:
    joiner = FrameJoiner()
    got = []
    now = 0.0
    for packet in packets:
        for part in split(packet, q, fd):
            now += 0.001
            q = q + 1 & 63
            whole = joiner.receive(part, now)
            if whole is not None:
                got.append(whole)
    assert got == packets


@pytest.mark.parametrize("fd", [False, True])
def test_every_size_up_to_the_mtu_goes_through(fd: bool) -> None:
    random = Random(4)
    for size in [*range(1, 200), *range(430, 450), 1000, 2047, 4032, 4033, 4095, 4096]:
        packet = random.randbytes(size)
        parts = split(packet, size & 63, fd)
        assert all(len(part) in FD_LENGTHS and (fd or len(part) <= 8) for part in parts)
        assert join_all(parts) == [packet], size


def numbered(sizes: list[int], fd: bool) -> list[Message]:
    """Messages that differ, and their frames; the counter runs on."""
    messages = []
    q = 0
    for index, size in enumerate(sizes):
        packet = (index.to_bytes(2, "big") * size)[:size] if size > 1 else bytes([index])
        parts = split(packet, q, fd)
        q = q + len(parts) & 63
        messages.append((packet, parts))
    return messages


@settings(max_examples=tries(150, 3000))
@given(data=st.data(), fd=st.booleans(), seed=st.integers(0, 1 << 32))
def test_bursts_below_64_frames_never_give_a_message_in_part_glued_altered_or_twice(
    data: st.DataObject, fd: bool, seed: int
) -> None:
    """Loss, duplication and reordering in bursts; between two bursts 64 frames come as they were sent."""
    random = Random(seed)
    largest = 4096 if fd else 900
    sizes = data.draw(st.lists(st.integers(1, largest), min_size=1, max_size=14))
    messages = numbered(sizes, fd)
    frames = [part for _, parts in messages for part in parts]
    touched: set[int] = set()
    wire: list[tuple[int, bytes]] = []
    position = 0
    while position < len(frames):
        calm = random.randrange(64, 200)
        wire += list(enumerate(frames[position : position + calm], position))
        position += calm
        burst = list(enumerate(frames[position : position + random.randrange(1, 64)], position))
        position += len(burst)
        touched.update(index for index, _ in burst)
        kind = random.choice(("lose", "lose some", "duplicate", "repeat", "reorder", "all"))
        if kind in ("lose some", "all"):
            burst = [frame for frame in burst if random.random() < 0.5]
        if kind in ("duplicate", "all"):
            burst = [frame for frame in burst for _ in range(random.randrange(1, 4))][:63]
        if kind == "repeat":
            burst = (burst + burst)[:63]
        if kind in ("reorder", "all"):
            random.shuffle(burst)
        wire += [] if kind == "lose" else burst
    joiner = FrameJoiner(repeat_s=0.0635)
    got = [packet for i, (_, frame) in enumerate(wire) if (packet := joiner.receive(frame, i * 0.001)) is not None]

    sent = [packet for packet, _ in messages]
    assert all(packet in sent for packet in got), "in part, glued or altered"
    start = 0
    for packet, parts in messages:
        whole = not touched.intersection(range(start, start + len(parts)))
        # A message right behind a burst is itself the first whole one: the link recovers at once.
        assert got.count(packet) <= sent.count(packet), "twice"
        if whole:
            assert packet in got, "not recovered"
        start += len(parts)


@given(frames=st.lists(st.tuples(st.binary(max_size=64), st.floats(0, 0.3)), max_size=60), mtu=st.integers(1, 200))
def test_arbitrary_frames_never_raise_and_are_counted(frames: list[tuple[bytes, float]], mtu: int) -> None:
    dropped = Tally()
    joiner = FrameJoiner(mtu, dropped=dropped)
    now = 0.0
    for frame, pause in frames:
        now += pause
        packet = joiner.receive(frame, now)
        assert packet is None or 0 < len(packet) <= mtu
    assert set(dropped) <= {
        value for name, value in vars(can_frames).items() if name.isupper() and isinstance(value, str)
    }


def frame(flags: int, q: int, data: bytes = b"1234567") -> bytes:
    return bytes([flags | q]) + data


@pytest.mark.parametrize(
    ("frames", "reason"),
    [
        ([b""], can_frames.EMPTY_FRAME),
        ([frame(FIRST, 0), frame(0, 2)], can_frames.FRAME_LOST),
        ([frame(FIRST, 0), frame(FIRST, 1)], can_frames.UNFINISHED),
        ([frame(0, 0), frame(LAST, 1)], can_frames.NO_FIRST_FRAME),
        ([frame(FIRST, 0), frame(LAST, 1)], can_frames.WRONG_CHECK_BYTE),
        ([frame(FIRST | LAST, 0), frame(FIRST | LAST, 2)], can_frames.MESSAGE_LOST),
        ([frame(FIRST | LAST, 0, b"")], can_frames.EMPTY_MESSAGE),
        ([frame(FIRST, 0, b""), frame(LAST, 1, b"\xff" * 0)], can_frames.EMPTY_MESSAGE),
        ([frame(FIRST, 0), frame(FIRST, 0)], can_frames.REPEATED),
        ([frame(FIRST | LAST, 0, bytes([3]) + bytes(10))], can_frames.WRONG_LENGTH),
        ([frame(FIRST | LAST, 0, bytes([63]) + bytes(62))], can_frames.WRONG_LENGTH),
        ([frame(FIRST, 0), *[frame(0, q) for q in range(1, 9)]], can_frames.TOO_LONG),
        ([frame(FIRST | LAST, 0, bytes([60]) + bytes(62))], can_frames.TOO_LONG),
    ],
)
def test_each_reason_is_counted_once(frames: list[bytes], reason: str) -> None:
    dropped = Tally()
    join_all(frames, FrameJoiner(50, dropped=dropped))
    assert dropped == {reason: 1}


def test_a_pause_of_more_than_250_ms_ends_the_message() -> None:
    dropped = Tally()
    joiner = FrameJoiner(dropped=dropped)
    first, last = split(bytes(10), 0, False)
    assert joiner.receive(first, 0.0) is None
    assert joiner.receive(last, 0.251) is None
    assert dropped == {can_frames.TOO_SLOW: 1}
    first, last = split(bytes(10), 2, False)
    assert joiner.receive(first, 1.0) is None
    assert joiner.receive(last, 1.25) == bytes(10)


def test_the_bus_own_repetition_is_no_loss() -> None:
    dropped = Tally()
    joiner = FrameJoiner(dropped=dropped)
    first, last = split(bytes(10), 0, False)
    assert [joiner.receive(part, 0.0) for part in (first, first, last, last)] == [None, None, bytes(10), None]
    assert dropped == {can_frames.REPEATED: 2}


def test_63_lost_frames_are_noticed_although_the_counter_comes_round() -> None:
    """The frame after them has the counter of the last one heard, and here even its content."""
    joiner = FrameJoiner()
    parts = split(bytes(7 * 200), 0, False)
    heard = parts[:10] + parts[73:]
    assert all(joiner.receive(part, 0.000111 * (i if i < 10 else i + 63)) is None for i, part in enumerate(heard))


def test_a_fast_stream_of_equal_frames_is_no_repetition() -> None:
    """On a virtual bus 64 frames may pass in no time; they are all new."""
    dropped = Tally()
    joiner = FrameJoiner(dropped=dropped)
    got = [packet for part in split(bytes(4096), 0, False) if (packet := joiner.receive(part, 0.0)) is not None]
    assert (got, dropped) == ([bytes(4096)], {})


def test_reset_forgets_the_message_in_progress() -> None:
    joiner = FrameJoiner()
    first, last = split(bytes(10), 0, False)
    joiner.receive(first, 0.0)
    joiner.reset()
    assert joiner.receive(last, 0.0) is None
    assert joiner.receive(split(b"x", 40, False)[0], 0.0) == b"x"


@pytest.mark.parametrize(
    "bad",
    [
        Frame(0x800),
        Frame(-1),
        Frame(1 << 29, extended=True),
        Frame(1, bytes(9)),
        Frame(1, bytes(9), fd=True),
        Frame(1, brs=True),
        Frame(1, error=True),
        Frame(1, b"x", remote=True),
        Frame(1, remote=True, remote_length=9),
        Frame(1, bytes(7), long_dlc=9),
        Frame(1, bytes(8), long_dlc=8),
        Frame(1, bytes(8), long_dlc=16),
        Frame(1, bytes(8), fd=True, long_dlc=9),
        Frame(1, remote=True, remote_length=7, long_dlc=9),
    ],
)
def test_impossible_frames_are_refused(bad: Frame) -> None:
    with pytest.raises(LocalProtocolError):
        check_frame(bad)


@pytest.mark.parametrize(
    ("size", "length"),
    [(0, 0), (8, 8), (9, 12), (12, 12), (13, 16), (17, 20), (21, 24), (25, 32), (33, 48), (49, 64), (64, 64)],
)
def test_an_fd_frame_has_one_of_the_lengths_of_iso_11898(size: int, length: int) -> None:
    assert len(pad_fd(bytes(size))) == length


def test_padding_to_an_fd_length() -> None:
    assert pad_fd(b"123456789", b"\xcc") == b"123456789\xcc\xcc\xcc"
    assert pad_fd(b"12345678") == b"12345678"
    with pytest.raises(LocalProtocolError):
        pad_fd(bytes(65))
