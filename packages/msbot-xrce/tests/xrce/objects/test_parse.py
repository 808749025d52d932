"""Descriptions in binary form, and the choice between the three forms."""

from __future__ import annotations

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from msbot_xrce.errors import RemoteProtocolError
from msbot_xrce.messages import CdrWriter, Create, Format, ObjectKind, ObjectVariant
from msbot_xrce.messages.objects import KEPT_OCTETS
from msbot_xrce.objects import (
    Definition,
    ParticipantDef,
    PublisherDef,
    ReaderDef,
    ReplierDef,
    RequesterDef,
    SubscriberDef,
    TopicDef,
    WriterDef,
    parse_variant,
)
from tests.damage import damaged, read_or_refused

TABLE: list[tuple[ObjectKind, str, Definition]] = [
    (ObjectKind.PARTICIPANT, "00 01 0000 05000000 7061727400", ParticipantDef(0, "part")),
    (ObjectKind.PARTICIPANT, "0000", ParticipantDef(0, "MicroXRCEParticipant")),
    (ObjectKind.PARTICIPANT, "01 000000 02000000 6400 01 00 05000000 7061727400", ParticipantDef(0, "part")),
    (ObjectKind.TOPIC, "02000000 5400 00 01 05000000 5479706500", TopicDef("T", "Type")),
    (ObjectKind.TOPIC, "02000000 5400 00 00", TopicDef("T", "")),
    (ObjectKind.PUBLISHER, "00 00", PublisherDef()),
    (ObjectKind.SUBSCRIBER, "01 000000 02000000 7300 00", SubscriberDef("s")),
    # Seen on the wire: reliable, keep last, transient local, depth 10; 12 is stale.
    (ObjectKind.DATAWRITER, "0012 01 00 0b00 01 12 0a00 00000000", WriterDef(0x12, None, None, True, True, depth=10)),
    (ObjectKind.DATAWRITER, "0012 00", WriterDef(0x12, None, None, True, False)),
    (ObjectKind.DATAWRITER, "0012 01 00 0000 00 00 00 00 00", WriterDef(0x12, None, None, False, False, keep_all=True)),
    (
        ObjectKind.DATAWRITER,
        "0012 01 00 1600 00 01 64000000 01 000000 c8000000 01 000000 02000000 abcd 01 00 07000000",
        WriterDef(
            0x12,
            None,
            None,
            False,
            True,
            deadline_s=0.1,
            lifespan_s=0.2,
            exclusive=True,
            strength=7,
            further=(("qos_flags", "0x0016"), ("user_data", "abcd")),
        ),
    ),
    # Seen on the wire.
    (ObjectKind.DATAREADER, "0012 01 00 0200 000000000000", ReaderDef(0x12, None, None, False, False)),
    (ObjectKind.DATAREADER, "0012 00", ReaderDef(0x12, None, None, False, False)),
    (
        ObjectKind.DATAREADER,
        "0012 01 00 0300 00 00 00 00 01 00 05000000 01 000000 04000000 783e3100",
        ReaderDef(
            0x12,
            None,
            None,
            True,
            False,
            separation_s=0.005,
            further=(("contentbased_filter", "x>1"),),
        ),
    ),
    (
        ObjectKind.REQUESTER,
        "04000000 73766300 05000000 5265715400 000000 05000000 5265705400 01 0000 07000000 72712f73766300"
        "01 07000000 72722f73766300",
        RequesterDef("svc", "ReqT", "RepT", "rq/svc", "rr/svc"),
    ),
    (
        ObjectKind.REPLIER,
        "04000000 73766300 02000000 5100 0000 02000000 5000 00 00",
        ReplierDef("svc", "Q", "P", "svc_Request", "svc_Reply"),
    ),
]


@pytest.mark.parametrize(("kind", "octets", "definition"), TABLE)
def test_binary_form(kind: ObjectKind, octets: str, definition: Definition) -> None:
    found = parse_variant(ObjectVariant(kind, Format.BINARY, blob=bytes.fromhex(octets)))
    assert repr(found) == repr(definition)


def test_binary_form_in_big_endian() -> None:
    blob = bytes.fromhex("0012 01 00 000b 01 12 000a 00000000")
    definition = parse_variant(ObjectVariant(ObjectKind.DATAWRITER, Format.BINARY, blob=blob), little_endian=False)
    assert definition == WriterDef(0x12, None, None, True, True, depth=10)


@pytest.mark.parametrize(("kind", "octets", "definition"), [row for row in TABLE if row[0] != ObjectKind.PUBLISHER])
def test_binary_form_cut_anywhere_is_another_object_or_refused(
    kind: ObjectKind, octets: str, definition: Definition
) -> None:
    blob = bytes.fromhex(octets)
    for end in range(len(blob)):
        try:
            parse_variant(ObjectVariant(kind, Format.BINARY, blob=blob[:end]))
        except RemoteProtocolError:
            continue
        # Only what is not read at all can be missing.
        assert kind == ObjectKind.SUBSCRIBER


@pytest.mark.parametrize("depth", ["0a00", "0000"])
def test_depth_counts_only_with_keep_last_and_not_0(depth: str) -> None:
    keep_all = ObjectVariant(
        ObjectKind.DATAWRITER, Format.BINARY, blob=bytes.fromhex(f"001201000100 01 00 {depth}00000000")
    )
    definition = parse_variant(keep_all)
    assert isinstance(definition, WriterDef)
    assert (definition.keep_all, definition.depth) == (True, None)


def test_depth_0_is_no_depth() -> None:
    blob = bytes.fromhex("0012 01 00 0300 01 00 0000 00000000")
    definition = parse_variant(ObjectVariant(ObjectKind.DATAWRITER, Format.BINARY, blob=blob))
    assert isinstance(definition, WriterDef)
    assert definition.depth is None


@pytest.mark.parametrize(
    ("variant", "reason"),
    [
        (ObjectVariant(0x10, 3), "there is no such kind"),
        (ObjectVariant(ObjectKind.PARTICIPANT, 9), "a participant in form 9: not understood"),
        (ObjectVariant(ObjectKind.PUBLISHER, Format.REFERENCE), "a publisher in form 1: not understood"),
        (ObjectVariant(ObjectKind.TYPE, Format.XML, "<x/>"), "objects of kind TYPE are not made"),
        (ObjectVariant(ObjectKind.TYPE, Format.BINARY, blob=b""), "not understood"),
        (ObjectVariant(ObjectKind.CLIENT, 0), "not understood"),
        (ObjectVariant(ObjectKind.TOPIC, Format.XML, ""), "a topic without a name"),
        (ObjectVariant(ObjectKind.DATAWRITER, Format.XML, ""), "a topic without a name"),
        (ObjectVariant(ObjectKind.PUBLISHER, Format.XML, "<dds>"), "XML, line 1"),
        (ObjectVariant(ObjectKind.TOPIC, Format.BINARY, blob=bytes.fromhex("0100000000 00 00")), "without a name"),
        (ObjectVariant(ObjectKind.PARTICIPANT, Format.BINARY, blob=b"\2\0"), "a boolean is 2"),
        (ObjectVariant(ObjectKind.REPLIER, Format.BINARY, blob=bytes.fromhex("01000000" * 9)), "bytes|NUL|name"),
    ],
)
def test_refused(variant: ObjectVariant, reason: str) -> None:
    with pytest.raises(RemoteProtocolError, match=reason):
        parse_variant(variant)


@pytest.mark.parametrize(
    ("kind", "definition"),
    [
        (ObjectKind.PARTICIPANT, ParticipantDef(0, "MicroXRCEParticipant")),
        (ObjectKind.PUBLISHER, PublisherDef()),
        (ObjectKind.SUBSCRIBER, SubscriberDef()),
    ],
)
def test_no_xml_at_all_means_defaults(kind: ObjectKind, definition: Definition) -> None:
    assert parse_variant(ObjectVariant(kind, Format.XML, "")) == definition


def test_domain_of_the_create_counts_not_that_of_the_xml() -> None:
    text = "<dds><participant><domainId>9</domainId></participant></dds>"
    definition = parse_variant(ObjectVariant(ObjectKind.PARTICIPANT, Format.XML, text, domain_id=4))
    assert definition == ParticipantDef(4, "MicroXRCEParticipant")


BLOBS = [bytes.fromhex(octets) for _, octets, _ in TABLE]
CLASSES = {kind: type(definition) for kind, _, definition in TABLE}


@given(st.sampled_from(list(ObjectKind)), damaged(st.sampled_from(BLOBS)) | st.binary(max_size=60), st.booleans())
@example(ObjectKind.TOPIC, bytes.fromhex("02000000 5400 00 00"), True)
def test_any_blob_is_read_or_refused(kind: ObjectKind, blob: bytes, little_endian: bool) -> None:
    variant = ObjectVariant(kind, Format.BINARY, blob=blob)
    definition = read_or_refused(lambda _: parse_variant(variant, little_endian=little_endian), blob)
    if definition is not None:
        assert type(definition) is CLASSES[kind]


NAMES = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=20)


@given(NAMES.filter(bool), NAMES, st.booleans())
def test_topics_in_binary_form_round_trip_in_both_byte_orders(name: str, type_name: str, little_endian: bool) -> None:
    writer = CdrWriter(little_endian)
    writer.string(name)
    writer.boolean(False)
    writer.boolean(True)
    writer.string(type_name)
    variant = ObjectVariant(ObjectKind.TOPIC, Format.BINARY, blob=writer.finish())
    assert parse_variant(variant, little_endian=little_endian) == TopicDef(name, type_name)


def test_a_description_that_comes_again_is_not_parsed_again() -> None:
    sent = Create(1, 0x12, ObjectVariant(ObjectKind.TOPIC, Format.XML, text=xml_topic("a" * 20))).encode()
    first, again = (Create.decode(bytes(bytearray(sent)), 4, len(sent), sent[1]).variant for _ in range(2))
    assert first is again
    assert parse_variant(first) is parse_variant(again)
    other = ObjectVariant(ObjectKind.TOPIC, Format.XML, text=xml_topic("b" * 20))
    assert parse_variant(other) == TopicDef("b" * 20, "T")


def test_long_descriptions_are_not_kept() -> None:
    long = ObjectVariant(ObjectKind.TOPIC, Format.XML, text=xml_topic("a" * KEPT_OCTETS))
    assert parse_variant(long) == parse_variant(long)
    assert parse_variant(long) is not parse_variant(long)


def test_a_description_kept_in_one_byte_order_is_not_taken_for_the_other() -> None:
    variant = ObjectVariant(
        ObjectKind.DATAWRITER, Format.BINARY, blob=bytes.fromhex("0012 01 00 0100 00 00 00 00 00 00")
    )
    little, big = (parse_variant(variant, little_endian=order) for order in (True, False))
    assert (little, big) == tuple(parse_variant(variant, little_endian=order) for order in (True, False))
    assert little != big


def xml_topic(name: str) -> str:
    return f"<dds><topic><name>{name}</name><dataType>T</dataType></topic></dds>"
