"""CREATE_CLIENT, STATUS_AGENT, GET_INFO, INFO, TIMESTAMP, TIMESTAMP_REPLY: what the message table does not show."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot_xrce.errors import RemoteProtocolError
from msbot_xrce.messages import (
    CreateClient,
    GetInfo,
    Info,
    Locator,
    LocatorFormat,
    StatusAgent,
    Submessage,
    Timestamp,
    TimestampReply,
    iter_submessages,
)

TEXT = st.text(st.characters(exclude_characters="\0", codec="utf-8"), max_size=12)
U16 = st.integers(0, 0xFFFF)
OCTET = st.integers(0, 0xFF)
TIMES = st.integers(-(1 << 31) * 10**9, (1 << 31) * 10**9 - 1)


def one(octets: bytes) -> Submessage:
    (submessage,) = iter_submessages(octets, 0)
    return submessage


@given(
    st.builds(
        CreateClient,
        st.integers(0, 0xFFFFFFFF),
        OCTET,
        U16,
        st.none() | st.lists(st.tuples(TEXT, TEXT), max_size=4).map(tuple),
        st.binary(min_size=4, max_size=4),
        st.binary(min_size=2, max_size=2),
        st.binary(min_size=2, max_size=2),
    )
)
def test_create_client_round_trip(client: CreateClient) -> None:
    octets = client.encode()
    assert one(octets) == client
    assert CreateClient.decode(octets, 4, len(octets), 1) == client


@pytest.mark.parametrize(
    ("octets", "reason"),
    [
        ("00011000 58524345 0100 010f aabbccdd 81 02 fc01", "a boolean is 2"),
        ("00011000 58524345 0100 010f aabbccdd 81 00 fc", "bytes are needed"),
        ("00011000 58524345 0100 010f aabbccdd 81 01 0000 ffffffff fc01", "4294967295 properties do not fit 2 bytes"),
        ("00011000 58524345 0100 010f aabbccdd 81 01 0000 01000000 ff000000 75787200", "255 bytes are needed"),
    ],
)
def test_wrong_create_client_is_refused(octets: str, reason: str) -> None:
    with pytest.raises(RemoteProtocolError, match=reason):
        one(bytes.fromhex(octets))


def test_status_agent_of_a_genuine_agent_for_key_0_is_read_though_its_description_is_garbage() -> None:
    status = one(bytes.fromhex("04010b00 8500 00200048ae7f0000 0000"))
    assert isinstance(status, StatusAgent)
    assert status.status == 0x85
    assert status.cookie == bytes.fromhex("00200048")


@given(st.builds(StatusAgent, OCTET, OCTET))
def test_status_agent_round_trip(status: StatusAgent) -> None:
    assert one(status.encode()) == status


@given(st.builds(GetInfo, U16, U16, st.integers(0, 0xFFFFFFFF)))
def test_get_info_round_trip(request: GetInfo) -> None:
    assert one(request.encode()) == request


def test_get_info_cut_short_is_refused() -> None:
    # The genuine agent answers it, with zeros for what is missing.
    with pytest.raises(RemoteProtocolError, match="GET_INFO: 4 bytes where 8 are needed"):
        one(bytes.fromhex("02010400 000afffd"))


LOCATORS = st.one_of(
    st.builds(Locator, st.just(LocatorFormat.SMALL), st.binary(min_size=2, max_size=2), OCTET),
    st.builds(Locator, st.just(LocatorFormat.MEDIUM), st.binary(min_size=4, max_size=4), U16),
    st.builds(Locator, st.just(LocatorFormat.LARGE), st.binary(min_size=16, max_size=16), st.integers(0, 2**32 - 1)),
    st.builds(Locator, st.just(LocatorFormat.STRING), TEXT.map(str.encode)),
)


@given(
    st.builds(
        Info,
        U16,
        U16,
        OCTET,
        OCTET,
        st.booleans(),
        st.integers(-0x8000, 0x7FFF),
        st.lists(LOCATORS, max_size=5).map(tuple),
    )
)
def test_info_round_trip(info: Info) -> None:
    assert one(info.encode()) == info


def test_answer_of_a_client_is_an_info_without_parts() -> None:
    answer = Info(0, 0xFFFE, has_agent=False, availability=None)
    octets = answer.encode()
    assert octets == bytes.fromhex("06010800 0000fffe 0000 00 00")
    assert one(octets) == answer


def test_properties_of_the_agent_in_an_info_are_skipped() -> None:
    octets = "000afffd 00 00 01 0d 58524345 0100 010f 01 000000 01000000 02000000 6100 0000 02000000 6200 00"
    info = one(bytes.fromhex("0601 2700" + octets))
    assert info == Info(10, 0xFFFD, availability=None)


@pytest.mark.parametrize(
    ("octets", "reason"),
    [
        ("06010900 000afffd 0000 01 0e 58", "about kind 0x0E"),
        ("06011000 000afffd 0000 00 01 0d 00 0100 01000000", "1 locators do not fit 0 bytes"),
        ("06011400 000afffd 0000 00 01 0d 00 0100 01000000 04000000", "a locator of format 4"),
        ("06011400 000afffd 0000 00 01 0d 00 0100 ffffffff 04000000", "4294967295 locators do not fit"),
    ],
)
def test_wrong_info_is_refused(octets: str, reason: str) -> None:
    with pytest.raises(RemoteProtocolError, match=reason):
        one(bytes.fromhex(octets))


@pytest.mark.parametrize(
    ("locator", "words"),
    [
        (Locator(LocatorFormat.SMALL, b"\x01\x02", 3), "01 02:3"),
        (Locator(LocatorFormat.MEDIUM, b"\x7f\0\0\x01", 2018), "127.0.0.1:2018"),
        (Locator(LocatorFormat.LARGE, bytes(15) + b"\x01", 2018), "[0000:0000:0000:0000:0000:0000:0000:0001]:2018"),
        (Locator(LocatorFormat.STRING, b"can0"), "can0"),
    ],
)
def test_locators_have_words(locator: Locator, words: str) -> None:
    assert locator.describe == words


@given(TIMES, TIMES, TIMES)
def test_time_stamps_round_trip(transmit: int, receive: int, originate: int) -> None:
    assert one(Timestamp(transmit).encode()) == Timestamp(transmit)
    reply = TimestampReply(transmit, receive, originate)
    assert one(reply.encode()) == reply


def test_time_after_2038_wraps_and_comes_back_bit_by_bit() -> None:
    octets = Timestamp(0x9000_0000 * 10**9 + 5).encode()
    assert octets[4:] == bytes.fromhex("00000090 05000000")
    again = one(octets)
    assert again.encode() == octets


def test_time_with_a_second_of_nanoseconds_is_refused() -> None:
    with pytest.raises(RemoteProtocolError, match="TIMESTAMP: a time stamp with 1000000000 nanoseconds"):
        one(bytes.fromhex("0e010800 00000000 00ca9a3b"))


@pytest.mark.parametrize("octets", ["0e010400 00000000", "0f010800 00000000 00000000", "04010400 00005852"])
def test_payload_cut_short_is_refused(octets: str) -> None:
    with pytest.raises(RemoteProtocolError, match="bytes where"):
        one(bytes.fromhex(octets))
