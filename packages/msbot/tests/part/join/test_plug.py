from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot.part.join.pnp_messages import (
    MOST_BINDINGS,
    NO_BINDING,
    PROFILE_TYPE,
    Beat,
    BeatReply,
    BindingDirection,
    Challenge,
    ClaimMessage,
    ConfigurationMessage,
    ConfigurationRequest,
    Notice,
    NoticeKind,
    PortBinding,
    ProfileMessage,
    Proof,
    Setting,
    VerdictMessage,
    decode_reply,
    decode_request,
    safe_setting,
)
from msbot.part.join.refusal import Refusal
from msbot.part.messages.message import Message
from msbot.part.messages.wire_types import uint32
from msbot_xrce.errors import LocalProtocolError, RemoteProtocolError
from tests.damage import damaged, read_or_refused

PROFILE = ProfileMessage(
    index=1,
    message="MSBOT_MASTER",
    name="MSBOT_V1",
    id="X100Y100Z100",
    dof="8-4-2021",
    make="MASSEY_ENGINEERING_DEP",
)

REQUESTS: list[tuple[Message, str]] = [
    (Beat(lease=0x01020304), "04030201"),
    (ConfigurationRequest(lease=1, have_version=2), "01000000 02000000"),
    (Proof(proof=bytes(range(16))), "00010203 04050607 08090a0b 0c0d0e0f"),
    (
        ClaimMessage(part_number="ABCD", local_name="L", uid=b"12345678", session_nonce=5),
        "05000000 41424344 00 000000 02000000 4c00 3132333435363738 0000 05000000",
    ),
]

REPLIES: list[tuple[Message, str]] = [
    (BeatReply(configuration_version=7), "07000000"),
    (Challenge(nonce=bytes(range(16))), "00010203 04050607 08090a0b 0c0d0e0f"),
    (Notice(number=2, binding=1, kind=NoticeKind.PARTNER_LOST), "02000000 0100 01 00"),
    (Notice(number=0, binding=NO_BINDING, kind=NoticeKind.STOP), "00000000 ffff 04 00"),
    (VerdictMessage(lease=1, configuration_version=2, beat_period_ms=1000), "01000000 02000000 e803 00 00"),
    (
        ConfigurationMessage(version=1, slot="", bindings=[], settings=[]),
        "01000000 01000000 00000000 00000000 00000000",
    ),
    (
        ConfigurationMessage(
            version=1,
            slot="S",
            bindings=[
                PortBinding(port="p", topic="t", topic_type="T", direction=BindingDirection.SUBSCRIBE, reliable=1),
                PortBinding(port="q", topic="u", topic_type="T", direction=BindingDirection.PUBLISH, reliable=0),
            ],
            settings=[Setting(name="n", value="v")],
        ),
        "01000000 02000000 5300 0000 02000000"
        "02000000 7000 0000 02000000 7400 0000 02000000 5400 01 01"
        "02000000 7100 0000 02000000 7500 0000 02000000 5400 00 00"
        "01000000 02000000 6e00 0000 02000000 7600",
    ),
]


def test_the_profile_of_the_original_is_103_octets() -> None:
    assert PROFILE.type_name == PROFILE_TYPE == "msbot_master"
    octets = PROFILE.encode()
    assert len(octets) == 103
    assert octets[:24] == bytes.fromhex("01000000 0d000000") + b"MSBOT_MASTER\0\0\0\0"
    assert ProfileMessage.decode(octets) == PROFILE


def test_profile_texts_are_as_short_as_the_buffers_of_the_original() -> None:
    PROFILE_LIKE = ProfileMessage(index=1, message="x" * 254, name="", id="", dof="", make="")
    assert ProfileMessage.decode(PROFILE_LIKE.encode()) == PROFILE_LIKE
    with pytest.raises(LocalProtocolError, match="at most 254 bytes"):
        PROFILE_LIKE.message = "x" * 255


@pytest.mark.parametrize(("request_message", "octets"), REQUESTS)
def test_requests_are_told_apart_by_length(request_message: Message, octets: str) -> None:
    assert request_message.encode() == bytes.fromhex(octets)
    assert decode_request(bytes.fromhex(octets)) == request_message


@pytest.mark.parametrize(("reply", "octets"), REPLIES)
def test_replies_are_told_apart_by_length(reply: Message, octets: str) -> None:
    assert reply.encode() == bytes.fromhex(octets)
    assert decode_reply(bytes.fromhex(octets)) == reply


def test_the_shortest_claim_and_configuration_cannot_be_mistaken() -> None:
    claim = ClaimMessage(part_number="", local_name="", uid=bytes(8), session_nonce=0).encode()
    assert len(claim) == 28
    assert isinstance(decode_request(claim), ClaimMessage)
    shortest = ConfigurationMessage(version=0, slot="", bindings=[], settings=[]).encode()
    assert len(shortest) == 20


class Boundless(Message):
    """A configuration as a master might send it that keeps no limits."""

    version: uint32
    slot: str
    bindings: list[PortBinding]
    settings: list[Setting]


def test_a_configuration_cannot_bind_more_ports_than_an_agent_has_objects_for() -> None:
    binding = PortBinding(port="p", topic="t", topic_type="T", direction=0, reliable=1)
    most = ConfigurationMessage(version=1, slot="AA", bindings=[binding] * MOST_BINDINGS, settings=[])
    assert decode_reply(most.encode()) == most
    more = Boundless(version=1, slot="AA", bindings=[binding] * (MOST_BINDINGS + 1), settings=[])
    with pytest.raises(RemoteProtocolError, match="at most 120"):
        decode_reply(more.encode())


SAID = [message.encode() for message in (PROFILE, *(one for one, _ in REQUESTS + REPLIES))]


@given(damaged(st.sampled_from(SAID)) | st.binary(max_size=80))
def test_any_octets_are_understood_or_a_remote_protocol_error(octets: bytes) -> None:
    readers: list[Callable[[bytes], Message]] = [decode_request, decode_reply, ProfileMessage.decode]
    for read in readers:
        message = read_or_refused(read, octets)
        if message is not None:
            assert read(message.encode()) == message


def test_every_refusal_has_words() -> None:
    assert [refusal.value for refusal in Refusal] == list(range(1, 12))
    assert all(refusal.describe for refusal in Refusal)


def test_a_safe_value_is_a_setting_with_a_name_that_no_parameter_has() -> None:
    assert safe_setting("speed", "value") == "speed.safe.value"
