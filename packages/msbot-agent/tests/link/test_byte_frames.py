"""Serial and TCP framing: known frames both ways, any chunks, any bytes, any damage."""

import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from msbot_agent.link.byte_frames import SerialReceiver, TcpReceiver, crc16_arc, encode_serial, encode_tcp

KNOWN = [
    # source, destination, payload, frame; seen on the wire between genuine peers (the first is a ping)
    (1, 0, "80000000020108 00000afffd02000000", "7e01001000 80000000020108 00000afffd02000000 cf12"),
    (0, 0, "81017e0007010800007d00157e7d5e5d", "7e00001000 81017d5e000701080000 7d5d0015 7d5e7d5d5e5d befe"),
    (0, 0, "313233343536373839", "7e00000900 313233343536373839 3dbb"),
]


@pytest.mark.parametrize(("source", "destination", "payload", "frame"), KNOWN)
def test_known_serial_frames(source: int, destination: int, payload: str, frame: str) -> None:
    assert encode_serial(bytes.fromhex(payload), source, destination) == bytes.fromhex(frame)
    assert SerialReceiver(destination).receive(bytes.fromhex(frame)) == [(source, bytes.fromhex(payload))]


def test_crc_check_value() -> None:
    assert crc16_arc(b"123456789") == 0xBB3D


packets = st.binary(min_size=1, max_size=300) | st.lists(
    st.sampled_from([0x7E, 0x7D, 0x5E, 0x5D]), min_size=1, max_size=40
).map(bytes)


@given(st.lists(packets, max_size=5), st.integers(1, 7), st.binary(max_size=20))
def test_serial_survives_any_chunks_and_leading_noise(sent: list[bytes], chunk: int, noise: bytes) -> None:
    receiver = SerialReceiver(0)
    stream = noise.replace(b"\x7e", b"") + b"".join(encode_serial(packet, 9, 0) for packet in sent)
    got = [pair for i in range(0, len(stream), chunk) for pair in receiver.receive(stream[i : i + chunk])]
    assert got == [(9, packet) for packet in sent]


@given(st.binary(max_size=400))
def test_serial_never_raises(data: bytes) -> None:
    SerialReceiver(0).receive(data)


@given(packets, st.data())
def test_one_flipped_bit_is_never_delivered_as_good_and_the_next_frame_is(packet: bytes, data: st.DataObject) -> None:
    frame = bytearray(encode_serial(packet, 1, 0))
    at = data.draw(st.integers(5 * 8, len(frame) * 8 - 1))
    whole = frame[at // 8]
    frame[at // 8] ^= 1 << at % 8
    # One that makes or unmakes an escape moves all that follows: the check sum finds that only usually.
    assume({whole, frame[at // 8]}.isdisjoint({0x7D, 0x7E}))
    assert SerialReceiver(0).receive(bytes(frame) + encode_serial(b"next", 1, 0)) == [(1, b"next")]


@given(packets, st.data())
@example(b"}}}", None).via("the check sum is right by accident")
def test_after_any_flipped_bit_the_second_frame_is_whole(packet: bytes, data: st.DataObject | None) -> None:
    frame = bytearray(encode_serial(packet, 1, 0))
    at = 60 if data is None else data.draw(st.integers(0, len(frame) * 8 - 1))
    frame[at // 8] ^= 1 << at % 8
    got = SerialReceiver(0).receive(bytes(frame) + encode_serial(b"first", 1, 0) + encode_serial(b"second", 1, 0))
    assert got[-1] == (1, b"second")
    assert len(got) <= 3


def test_frames_for_others_and_cut_frames_are_skipped_and_counted() -> None:
    receiver = SerialReceiver(0)
    cut = encode_serial(b"cut short", 1, 0)[:8]
    assert receiver.receive(encode_serial(b"not you", 1, 5) + cut + encode_serial(b"you", 1, 0)) == [(1, b"you")]
    assert receiver.dropped == {"for another address": 1, "frame cut short": 1}


def test_a_frame_for_another_is_known_by_its_header_and_a_wrong_check_sum_is_counted() -> None:
    header, wrong = bytes.fromhex("7e 01 05 01 00"), bytearray(encode_serial(b"you", 1, 0))
    wrong[-1] ^= 1
    for octets, reason in ((header, "for another address"), (bytes(wrong), "wrong check sum")):
        receiver = SerialReceiver(0)
        assert receiver.receive(octets) == []
        assert receiver.receive(b"\0\0") == []
        assert receiver.receive(encode_serial(b"you", 1, 0)) == [(1, b"you")]
        assert receiver.dropped == {reason: 1}


def test_too_long_for_the_receiver() -> None:
    receiver = SerialReceiver(0, max_packet=4)
    assert receiver.receive(encode_serial(b"12345", 1, 0)) == []
    assert receiver.dropped == {"longer than the limit": 1}


@pytest.mark.parametrize("size", [0, 65536])
def test_serial_size_limits(size: int) -> None:
    with pytest.raises(ValueError, match="1 to 65535"):
        encode_serial(bytes(size), 0, 0)


@pytest.mark.parametrize("size", [1, 65535])
def test_the_largest_and_the_smallest_packet_pass(size: int) -> None:
    packet = bytes(range(256)) * 256
    packet = packet[:size]
    assert SerialReceiver(0).receive(encode_serial(packet, 255, 0)) == [(255, packet)]
    assert SerialReceiver(0, max_packet=size).receive(encode_serial(packet, 1, 0)) == [(1, packet)]
    assert TcpReceiver().receive(encode_tcp(packet)) == [packet]


@given(st.lists(st.binary(max_size=50)), st.integers(1, 7))
def test_tcp_survives_any_chunks_and_skips_empty_packets(sent: list[bytes], chunk: int) -> None:
    receiver = TcpReceiver()
    stream = b"".join(encode_tcp(packet) for packet in sent)
    got = [packet for i in range(0, len(stream), chunk) for packet in receiver.receive(stream[i : i + chunk])]
    assert got == [packet for packet in sent if packet]


def test_tcp_size_limit() -> None:
    with pytest.raises(ValueError, match="at most 65535"):
        encode_tcp(bytes(65536))
