"""Frames of messages: the firmware against MsBOT's own `split` and `FrameJoiner`, octet by octet."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from tests.firmware.msbot_side import FrameJoiner, Tally, split
from tests.firmware.pipe import Firmware

MTU = 256
UNIT_US = 64
REPEAT = 200
"""6400 bit times at 500 kbit/s, in units of 64 us."""
packets = st.binary(min_size=1, max_size=MTU) | st.integers(1, MTU).map(bytes)


@given(packet=packets, q=st.integers(0, 63), fd=st.booleans())
def test_packets_are_cut_alike(firmware: Firmware, packet: bytes, q: int, fd: bool) -> None:
    assert firmware.split(packet, q, fd=fd) == split(packet, q, fd)


def test_every_length_is_cut_alike(firmware: Firmware) -> None:
    for size in range(1, MTU + 1):
        for fd in (False, True):
            packet = bytes(at * 7 & 0xFF for at in range(size))
            assert firmware.split(packet, 0, fd=fd) == split(packet, 0, fd)


def joined(frames: list[tuple[int, bytes]], limit: int) -> tuple[list[bytes], dict[str, int]]:
    """The same by MsBOT's own joiner."""
    dropped = Tally()
    # Half a unit less: the firmware counts whole ones.
    joiner = FrameJoiner(limit, dropped=dropped, repeat_s=(REPEAT - 0.5) * UNIT_US / 1e6)
    return [joiner.receive(data, at / 1e6) or b"" for at, data in frames], dropped


@st.composite
def disturbed(draw: st.DrawFn) -> list[tuple[int, bytes]]:
    """Messages cut into frames, of which some are lost, repeated, moved or replaced, at some times."""
    q = draw(st.integers(0, 63))
    fd = draw(st.booleans())
    frames: list[bytes] = []
    for packet in draw(st.lists(packets, max_size=6)):
        parts = split(packet, q, fd)
        q = q + len(parts) & 63
        frames += parts
    for _ in range(draw(st.integers(0, 6))):
        if not frames:
            break
        at = draw(st.integers(0, len(frames) - 1))
        match draw(st.integers(0, 4)):
            case 0:
                del frames[at : at + draw(st.sampled_from((1, 1, 2, 62, 63, 64, 65)))]
            case 1:
                frames.insert(draw(st.integers(0, len(frames))), frames[at])
            case 2:
                frames.insert(draw(st.integers(0, len(frames))), frames.pop(at))
            case 3:
                frames.insert(at, draw(st.binary(max_size=8) | st.binary(min_size=12, max_size=12)))
            case 4:
                frames += frames[at:]
    now = draw(st.integers(0, 2**32 - 1) if not frames else st.just(0))
    pauses = st.sampled_from((0, 0, 1, 2, 4, REPEAT - 1, REPEAT, REPEAT + 1, 3906, 3907, 60_000, 70_000))
    timed = []
    for data in frames:
        now += draw(pauses) * UNIT_US
        timed.append((now, data))
    return timed


@given(frames=disturbed(), limit=st.sampled_from((20, MTU, MTU + 1)))
def test_disturbed_frames_are_joined_alike(firmware: Firmware, frames: list[tuple[int, bytes]], limit: int) -> None:
    assert firmware.join(frames, limit=limit, repeat=REPEAT) == joined(frames, limit)


@given(
    frames=st.lists(
        st.tuples(st.integers(0, 300), st.binary(max_size=8) | st.binary(min_size=12, max_size=12)), max_size=200
    )
)
def test_arbitrary_frames_are_joined_alike(firmware: Firmware, frames: list[tuple[int, bytes]]) -> None:
    now, timed = 0, []
    for pause, data in frames:
        now += pause * UNIT_US
        timed.append((now, data))
    assert firmware.join(timed, limit=MTU, repeat=REPEAT) == joined(timed, MTU)


def test_the_clock_may_come_round(firmware: Firmware) -> None:
    """Microseconds in 32 bits begin anew after 71 minutes; a message is joined across that moment."""
    parts = split(b"across the end of the clock", 0, False)
    timed = [((2**32 - 200 + 150 * at) & 0xFFFFFFFF, data) for at, data in enumerate(parts)]
    messages, dropped = firmware.join(timed, limit=MTU, repeat=REPEAT)
    assert messages[-1] == b"across the end of the clock"
    assert dropped == {}
