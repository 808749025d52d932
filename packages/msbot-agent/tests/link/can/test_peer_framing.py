"""What two ends of a CAN bus have agreed on, frame by frame."""

from __future__ import annotations

from itertools import product

import pytest

from msbot_agent.link import LinkCounters
from msbot_agent.link.can.controller import CanBusInfo
from msbot_agent.link.can.legacy_link import Codec, PeerFraming, _repeat_s
from msbot_agent.link.can.protocol.frames import REPEATED
from msbot_agent.link.can.protocol.ids import CAN_FD, COMPRESSION
from msbot_xrce.errors import RemoteProtocolError


def refuse(message: bytes) -> bytes:
    raise RemoteProtocolError(f"{len(message)} bytes too many")


CODEC = Codec(lambda packet: packet[1:], lambda message: b"!" + message)


def wire(
    use: int = 0, *, data_rate: int | None = None, rate: int | None = 6400, codec: Codec | None = CODEC
) -> PeerFraming:
    info = CanBusInfo("can:x", rate, data_rate, fd=bool(use & CAN_FD))
    return PeerFraming(0x105, use=use, info=info, mtu=1000, counters=LinkCounters(), codec=codec)


def test_frames_are_of_the_kind_that_was_agreed_on() -> None:
    for fd, fast, short in product((False, True), (None, 2_000_000), (False, True)):
        made = wire(CAN_FD * fd | COMPRESSION * short, data_rate=fast)
        (frame,) = made.split(b"!abc")
        assert (frame.can_id, frame.extended, frame.fd) == (0x105, False, fd)
        assert frame.brs == (fd and fast is not None)
        assert frame.data[1:4] == (b"abc" if short else b"!ab")
        assert made.unpack(b"abc") == (b"!abc" if short else b"abc")


def test_what_nobody_can_decompress_is_counted() -> None:
    made = wire(COMPRESSION, codec=Codec(bytes, refuse))
    assert made.unpack(b"abc") is None
    assert made._counters.dropped == {"3 bytes too many": 1}


def test_frames_are_counted_from_packet_to_packet_and_after_63_comes_0() -> None:
    made = wire()
    counts = [frame.data[0] & 0x3F for size in (1, 20, 7, 400, 30, 1) for frame in made.split(bytes(size))]
    assert counts == [number % 64 for number in range(len(counts))]
    assert len(counts) > 64


@pytest.mark.parametrize(
    ("use", "rate", "within_s"), [(0, 6400, 1.0), (0, 3200, 2.0), (0, None, None), (CAN_FD, 1, None)]
)
def test_the_bus_repeats_a_frame_within_the_time_of_64_frames_of_100_bits(
    use: int, rate: int | None, within_s: float | None
) -> None:
    usual = wire(rate=None).joiner._repeat_s
    assert 0 < usual < 0.5
    within_s = within_s or usual
    for pause_s, is_repeated in ((within_s / 2, True), (within_s * 2, False)):
        made = wire(use, rate=rate)
        (frame,) = made.split(b"!abc")
        first, again = made.joiner.receive(frame.data, 0.0), made.joiner.receive(frame.data, pause_s)
        assert first is not None
        assert (again is None, made._counters.dropped.get(REPEATED, 0)) == (is_repeated, int(is_repeated))


def test_the_longest_packet_has_room_for_what_compression_may_add() -> None:
    for use, most in ((0, 1000), (COMPRESSION, 1001)):
        for size in (most, most + 1):
            made, codec = wire(use), Codec(bytes, bytes)
            sender = wire(use, codec=codec)
            sender._counters = made._counters
            joined = [made.joiner.receive(frame.data, 0.001 * at) for at, frame in enumerate(sender.split(bytes(size)))]
            assert (joined[-1] == bytes(size)) == (size == most)


@pytest.mark.parametrize(("rate", "seconds"), [(500_000, 0.0008), (100_000, 0.004)])
def test_the_thesis_framing_takes_an_equal_frame_within_400_bits_for_a_repetition(rate: int, seconds: float) -> None:
    assert _repeat_s(rate) == pytest.approx(seconds)
    assert 0 < _repeat_s(None) < 0.1
