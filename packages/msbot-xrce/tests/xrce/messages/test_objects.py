"""CREATE, DELETE, STATUS and the description of an object, not looked into yet."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot_xrce.errors import LocalProtocolError, RemoteProtocolError
from msbot_xrce.messages import (
    Create,
    Delete,
    Format,
    ObjectKind,
    ObjectVariant,
    StatusReply,
    Submessage,
    iter_submessages,
)

U16 = st.integers(0, 0xFFFF)
OCTET = st.integers(0, 0xFF)
TEXT = st.text(st.characters(exclude_characters="\0", codec="utf-8"), max_size=30)
PARENTED = [kind for kind in ObjectKind if ObjectKind.TOPIC <= kind <= ObjectKind.REPLIER]
NO_REFERENCE = (ObjectKind.PUBLISHER, ObjectKind.SUBSCRIBER)


def one(octets: bytes) -> Submessage:
    (submessage,) = iter_submessages(octets, 0)
    return submessage


@st.composite
def variants(draw: st.DrawFn) -> ObjectVariant:
    kind = draw(st.sampled_from([ObjectKind.PARTICIPANT, *PARENTED]))
    formats = [form for form in Format if form != Format.REFERENCE or kind not in NO_REFERENCE]
    form = draw(st.sampled_from(formats))
    text = None if form == Format.BINARY else draw(TEXT)
    blob = draw(st.binary(max_size=40)) if form == Format.BINARY else None
    if kind == ObjectKind.PARTICIPANT:
        return ObjectVariant(kind, form, text, blob, domain_id=draw(st.integers(-0x8000, 0x7FFF)))
    return ObjectVariant(kind, form, text, blob, parent_id=draw(U16))


@given(st.builds(Create, U16, U16, variants(), st.booleans(), st.booleans(), st.booleans()))
def test_create_round_trip_in_both_byte_orders(create: Create) -> None:
    assert one(create.encode()) == create


@pytest.mark.parametrize("kind", [ObjectKind.TYPE, ObjectKind.QOSPROFILE, ObjectKind.APPLICATION])
@pytest.mark.parametrize("form", [Format.REFERENCE, Format.XML])
def test_kinds_that_are_only_described_have_a_text_and_no_parent(kind: ObjectKind, form: Format) -> None:
    create = Create(10, 0x001A, ObjectVariant(kind, form, "x"))
    assert one(create.encode()) == create


@pytest.mark.parametrize("kind", [0, 9, 0x0D, 0x0E, 0x0F, 0x10, 0xFF])
def test_kinds_that_cannot_be_made_are_read_without_contents(kind: int) -> None:
    create = one(bytes.fromhex(f"01010800 000a0011 {kind:02x}030000"))
    assert isinstance(create, Create)
    assert create.variant == ObjectVariant(kind, 0)


def test_unknown_form_has_no_contents() -> None:
    # Seen in the genuine agent: the domain follows at once.
    create = one(bytes.fromhex("01010800 000a0011 01 09 0500"))
    assert isinstance(create, Create)
    assert create.variant == ObjectVariant(1, 9, domain_id=5)


def test_publisher_by_reference_does_not_exist() -> None:
    create = one(bytes.fromhex("01011000 000a0013 03 01 0000 02000000 6100 0011"))
    assert isinstance(create, Create)
    assert create.variant.text is None
    assert create.variant.format == Format.REFERENCE


@pytest.mark.parametrize(
    "octets",
    [
        "01010400 000a0011",
        "01011000 000a0011 01 03 0000 ffffffff 00000000",
        "01010c00 000a0011 01 02 0000 00000000",
        "01011000 000a0012 02 02 0000 ff000000 3c646400",
        "01010e00 000a0011 01 02 0000 02000000 ff00",
    ],
)
def test_wrong_create_is_refused(octets: str) -> None:
    with pytest.raises(RemoteProtocolError, match="CREATE: "):
        one(bytes.fromhex(octets))


def test_create_above_64_kib_is_refused_when_writing() -> None:
    create = Create(10, 0x0011, ObjectVariant(ObjectKind.PARTICIPANT, Format.XML, "x" * 0x10000))
    with pytest.raises(LocalProtocolError, match="65535 at most"):
        create.encode()


@given(U16, U16, OCTET, OCTET)
def test_delete_and_status_round_trip(request_id: int, object_id: int, status: int, more: int) -> None:
    delete = Delete(request_id, object_id)
    assert one(delete.encode()) == delete
    reply = StatusReply(request_id, object_id, status, more)
    assert one(reply.encode()) == reply


@pytest.mark.parametrize("octets", ["03010300 000a00", "05010500 000a001100"])
def test_payload_cut_short_is_refused(octets: str) -> None:
    with pytest.raises(RemoteProtocolError, match="bytes where"):
        one(bytes.fromhex(octets))
