"""The thesis' 96-octet layouts."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msbot.part.join.thesis_messages import BUFFER_BYTES, decode_reply, encode_reply, encode_request
from msbot.pnp import Claim
from msbot.pnp.thesis_claims import decode_thesis_claim
from msbot_xrce.errors import RemoteProtocolError
from tests.damage import damaged, read_or_refused
from tests.effort import tries

REQUEST = bytes.fromhex("05000000") + b"ABCD\0\0\0\0" + bytes.fromhex("0b000000") + b"ABCD-local\0" + bytes(96 - 27)
"""AA's request: 27 of 96 octets are used (padding octets after the strings are zero anyway)."""


def test_the_request_of_the_thesis_component_aa() -> None:
    assert encode_request("ABCD", "ABCD-local") == REQUEST
    assert decode_thesis_claim(REQUEST) == Claim("ABCD", "ABCD-local", layout="compat")


def test_the_reply_is_the_part_number_in_a_buffer_of_96_octets() -> None:
    reply = encode_reply("ABCD")
    assert reply == bytes.fromhex("05000000") + b"ABCD\0" + bytes(96 - 9)
    assert decode_reply(reply) == "ABCD"


@pytest.mark.parametrize(
    "body",
    [
        b"",
        bytes(95),
        bytes(97),
        bytes(96),
        b"\xff\xff\xff\xff" + bytes(92),
        b"\x04\0\0\0ABCD" + bytes(88),
        b"\x05\0\0\0AB\xffD\0" + bytes(87),
        b"\x5c\0\0\0" + b"A" * 91 + b"\0",
        b"\x5a\0\0\0" + b"A" * 89 + b"\0" + b"\0\0",
    ],
    ids=["empty", "short", "long", "no string", "huge", "no NUL", "not UTF-8", "no second", "no room for second"],
)
def test_what_is_not_two_strings_in_96_octets_is_dropped(body: bytes) -> None:
    with pytest.raises(RemoteProtocolError):
        decode_thesis_claim(body)


def test_a_reply_of_another_size_is_dropped() -> None:
    with pytest.raises(RemoteProtocolError, match="reply of 4 bytes"):
        decode_reply(b"ABCD")


def test_texts_that_do_not_fit_are_refused_when_encoding() -> None:
    with pytest.raises(ValueError, match="do not fit"):
        encode_request("A" * 50, "B" * 50)
    with pytest.raises(ValueError, match="do not fit"):
        encode_reply("A" * 92)


texts = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=9)


@given(texts, texts)
@settings(max_examples=tries(100, 2000), deadline=None)
def test_requests_survive_the_round_trip(number: str, name: str) -> None:
    claim = decode_thesis_claim(encode_request(number, name))
    assert (claim.part_number, claim.local_name) == (number, name)
    assert decode_reply(encode_reply(number)) == number


@given(
    damaged(st.builds(encode_request, texts, texts)) | st.binary(min_size=BUFFER_BYTES, max_size=BUFFER_BYTES),
)
@settings(max_examples=tries(200, 4000), deadline=None)
def test_any_octets_are_a_request_or_a_protocol_error(body: bytes) -> None:
    claim = read_or_refused(decode_thesis_claim, body)
    if claim is not None:
        assert decode_thesis_claim(encode_request(claim.part_number, claim.local_name)) == claim


@pytest.mark.parametrize("length", range(1, 93))
def test_a_string_has_to_end_in_nul_wherever_it_ends(length: int) -> None:
    body = length.to_bytes(4, "little") + b"A" * (length - 1)
    assert decode_reply((body + b"\0").ljust(96, b"\0")) == "A" * (length - 1)
    with pytest.raises(RemoteProtocolError, match="string without its final NUL"):
        decode_reply((body + b"A").ljust(96, b"\0"))
    with pytest.raises(RemoteProtocolError, match="string of 93 bytes at offset 0"):
        decode_reply((93).to_bytes(4, "little") + bytes(92))


@pytest.mark.parametrize(("length", "fits"), [(91, True), (92, False)])
def test_a_reply_has_96_octets_and_not_one_more(length: int, fits: bool) -> None:
    if fits:
        assert decode_reply(encode_reply("n" * length)) == "n" * length
    else:
        with pytest.raises(ValueError, match="100 bytes do not fit into 96"):
            encode_reply("n" * length)
