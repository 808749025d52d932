"""What programs on one simulated bus say to each other, to the octet, and what makes no sense."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot_agent.link.can.controller import BusState
from msbot_agent.link.can.protocol.frames import Frame
from msbot_agent.link.can.sim.model.sim_bus_messages import (
    MAX_MESSAGE,
    BusFrame,
    FrameRejected,
    FrameSent,
    FramesLost,
    Hello,
    Message,
    Refused,
    Restart,
    Splitter,
    StateTold,
    Welcome,
    decode,
    encode,
)
from msbot_xrce.errors import LocalProtocolError, RemoteProtocolError
from tests.damage import damaged, read_or_refused
from tests.link.can.protocol.test_bits import frames

KEY = bytes(range(16))
NUMBERS = st.integers(0, 0xFFFFFFFF)
TIMES = st.floats(allow_nan=False)
WORDS = st.text(max_size=90)
MESSAGES: st.SearchStrategy[Message] = st.one_of(
    st.builds(Hello, st.binary(min_size=16, max_size=16), WORDS, st.booleans(), st.booleans()),
    st.builds(Welcome, st.integers(1, 0xFFFFFFFF), st.none() | st.integers(1, 0xFFFFFFFF), st.booleans()),
    st.builds(Refused, WORDS),
    st.builds(BusFrame, frames(), NUMBERS, TIMES),
    st.builds(FrameSent, NUMBERS, TIMES),
    st.builds(FrameRejected, NUMBERS, WORDS),
    st.builds(
        StateTold,
        st.sampled_from([BusState.ACTIVE, BusState.PASSIVE, BusState.OFF]),
        TIMES,
        st.integers(0, 0xFFFF),
        st.integers(0, 0xFFFF),
        WORDS,
    ),
    st.builds(FramesLost, NUMBERS),
    st.just(Restart()),
)

LITERAL = [
    (Hello(KEY, "A", listen_only=True), "1800 01 4d735342 01 01 000102030405060708090a0b0c0d0e0f 41"),
    (Welcome(500_000, 2_000_000, fd=True), "0b00 02 01 01 20a10700 80841e00"),
    (BusFrame(Frame(0x123, b"\xde\xad"), 7, 1.0), "1500 04 07000000 000000000000f03f 23010000 00 00 dead"),
    (FrameSent(7, 1.0), "0d00 05 07000000 000000000000f03f"),
    (BusFrame(Frame(0x12345678, bytes(12), extended=True, fd=True, brs=True, esi=True)),
     "1f00 04 00000000 0000000000000000 78563412 17 00 000000000000000000000000"),
    (BusFrame(Frame(5, remote=True, remote_length=7)), "1300 04 00000000 0000000000000000 05000000 08 07"),
    (BusFrame(Frame(5, bytes(8), long_dlc=13)), "1b00 04 00000000 0000000000000000 05000000 00 d0 0000000000000000"),
    (StateTold(BusState.OFF, 1.0, 0x108, 3, "x"), "0f00 07 000000000000f03f 02 0801 0300 78"),
    (FramesLost(5), "0500 08 05000000"),
    (Restart(), "0100 09"),
]  # fmt: skip


@pytest.mark.parametrize(("message", "octets"), LITERAL)
def test_messages_to_the_octet(message: Message, octets: str) -> None:
    assert encode(message) == bytes.fromhex(octets)
    assert Splitter().receive(bytes.fromhex(octets)) == [message]


@given(st.lists(MESSAGES, max_size=4), st.integers(1, 50))
def test_messages_come_out_as_they_went_in_however_they_are_cut(messages: list[Message], size: int) -> None:
    octets = b"".join(map(encode, messages))
    assert all(len(encode(message)) <= MAX_MESSAGE + 2 for message in messages)
    splitter, received = Splitter(), []
    for start in range(0, len(octets), size):
        received += splitter.receive(octets[start : start + size])
    assert received == messages


@given(damaged(MESSAGES.map(lambda message: encode(message)[2:])) | st.binary(max_size=80))
def test_any_octets_are_a_message_or_an_error(octets: bytes) -> None:
    message = read_or_refused(decode, octets)
    if message is not None:
        assert repr(decode(encode(message)[2:])) == repr(message), "also with a time that is no number"


@given(st.lists(st.binary(max_size=40) | damaged(MESSAGES.map(encode)), max_size=8))
def test_a_splitter_never_keeps_more_than_a_message(pieces: list[bytes]) -> None:
    splitter = Splitter()
    try:
        for piece in pieces:
            splitter.receive(piece)
            assert len(splitter._buffer) <= MAX_MESSAGE + 2
    except RemoteProtocolError:
        assert not splitter._buffer


@pytest.mark.parametrize(
    ("octets", "words"),
    [
        ("0000", "impossible length"),
        ("0102" + "00" * 513, "impossible length"),
        ("0100 00", "unknown kind"),
        ("0100 0a", "unknown kind"),
        ("0500 01 4d735342", "Hello message that makes no sense"),
        ("1700 01 48545450 01 00 000102030405060708090a0b0c0d0e0f", "another protocol"),
        ("1700 01 4d735342 02 00 000102030405060708090a0b0c0d0e0f", "version 2, here it is 1"),
        ("0b00 02 02 01 20a10700 80841e00", "Welcome of version 2"),
        ("1400 04 07000000 000000000000f03f 00080000 00 00 de", "impossible frame"),
        ("1400 04 07000000 000000000000f03f 01000000 08 01 de", "a remote frame is classic, carries no data"),
        ("0e00 07 000000000000f03f 03 0000 0000", "StateTold message that makes no sense"),
        ("474554202f20485454502f312e310d0a", "impossible length"),
    ],
)
def test_nonsense_is_an_error_that_says_what(octets: str, words: str) -> None:
    with pytest.raises(RemoteProtocolError, match=words):
        Splitter().receive(bytes.fromhex(octets))


def test_what_is_left_out_of_a_message() -> None:
    assert (Hello(KEY, "A").listen_only, Hello(KEY, "A").classic) == (False, False)
    assert (BusFrame(Frame(1)).tag, BusFrame(Frame(1)).at) == (0, 0.0)


def test_a_message_has_from_1_to_512_octets() -> None:
    assert Splitter().receive(bytes.fromhex("0002 03") + b"x" * 511) == [Refused("x" * 511)]
    with pytest.raises(RemoteProtocolError, match="impossible length"):
        Splitter().receive(bytes.fromhex("0102 03"))


def test_a_message_is_read_when_its_last_octet_has_come() -> None:
    octets = encode(FramesLost(5)) + encode(Restart())
    splitter = Splitter()
    read = [(at, splitter.receive(octets[at : at + 1])) for at in range(len(octets))]
    assert [(at, found) for at, found in read if found] == [(6, [FramesLost(5)]), (9, [Restart()])]


@pytest.mark.parametrize("more", [0, 1, 1 << 40])
def test_a_count_that_has_no_room_is_told_as_the_largest(more: int) -> None:
    assert decode(encode(FramesLost(0xFFFFFFFF + more))[2:]) == FramesLost(0xFFFFFFFF)
    told = StateTold(BusState.ACTIVE, 0.0, 0xFFFF + more, 0xFFFF + more, "")
    assert decode(encode(told)[2:]) == StateTold(BusState.ACTIVE, 0.0, 0xFFFF, 0xFFFF, "")


def test_a_key_has_16_octets() -> None:
    with pytest.raises(LocalProtocolError, match="16 bytes"):
        encode(Hello(b"short", "A"))


def test_long_words_are_cut_where_a_letter_ends() -> None:
    message = decode(encode(Refused("ä" * 300 + "!"))[2:])
    assert message == Refused("ä" * 200)
