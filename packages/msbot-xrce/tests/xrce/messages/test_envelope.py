"""Message headers around bodies."""

from __future__ import annotations

from msbot_xrce.messages.submessage import Envelope, append_submessage


def test_sessions_from_0x80_have_a_header_of_4_bytes_with_a_little_endian_number() -> None:
    envelope = Envelope(0x81, 0xAABBCC07, 64, pads=False)
    assert envelope.seal(0x80, 0x0102, b"body") == bytes.fromhex("81800201") + b"body"
    assert envelope.capacity == 60


def test_sessions_below_0x80_carry_the_key_in_every_header() -> None:
    envelope = Envelope(0x01, 0xAABBCC07, 64, pads=False)
    assert envelope.seal(0, 0, b"") == bytes.fromhex("01000000aabbcc07")
    assert envelope.capacity == 56


def test_padding_fills_messages_of_streams_only_and_never_exceeds_the_mtu() -> None:
    envelope = Envelope(0x81, 1, 63, pads=True)
    assert envelope.seal(1, 0, b"12345") == bytes.fromhex("81010000") + b"12345\0\0\0"
    assert envelope.seal(0, 0, b"12345") == bytes.fromhex("81000000") + b"12345"
    assert envelope.capacity == 56
    assert len(envelope.seal(1, 0, bytes(envelope.capacity))) <= 63


def test_submessages_begin_at_multiples_of_4() -> None:
    assert append_submessage(b"", b"abcde") == b"abcde"
    assert append_submessage(b"abcde", b"x") == b"abcde\0\0\0x"
