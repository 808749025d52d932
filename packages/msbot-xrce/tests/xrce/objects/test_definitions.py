"""When CREATE with REUSE finds the object it wants: the comparison rules of the genuine agent, and one deviation."""

from __future__ import annotations

from dataclasses import replace

import pytest

from msbot_xrce.messages import Format, ObjectKind, ObjectVariant
from msbot_xrce.objects import (
    Definition,
    EndpointQos,
    ParticipantDef,
    PublisherDef,
    ReaderDef,
    ReplierDef,
    RequesterDef,
    SubscriberDef,
    TopicDef,
    WriterDef,
    parse_variant,
    participant_variant,
    publisher_variant,
    reader_variant,
    requester_variant,
    topic_variant,
    writer_variant,
)

WRITER = WriterDef(0x12, None, None, reliable=True, transient_local=False)
NAMED_WRITER = WriterDef(None, "T", "Type", reliable=True, transient_local=False)
SERVICE = RequesterDef("svc", "ReqT", "RepT", "rq", "rr")

EQUAL: list[tuple[str, Definition, Definition]] = [
    ("participant", ParticipantDef(0, "p"), ParticipantDef(0, "p")),
    ("topic", TopicDef("T", "Type"), TopicDef("T", "Type")),
    ("publishers always", PublisherDef("a"), PublisherDef("b")),
    ("subscribers always", SubscriberDef("a"), SubscriberDef("")),
    ("writer", WRITER, replace(WRITER)),
    ("writer, type not compared", NAMED_WRITER, replace(NAMED_WRITER, type_name="Other")),
    ("requester, service name not compared", SERVICE, replace(SERVICE, service_name="other")),
]

DIFFERENT: list[tuple[str, Definition, Definition]] = [
    ("participant's domain", ParticipantDef(0, "p"), ParticipantDef(1, "p")),
    ("participant's name", ParticipantDef(0, "p"), ParticipantDef(0, "q")),
    ("topic's name", TopicDef("T", "Type"), TopicDef("U", "Type")),
    ("topic's type", TopicDef("T", "Type"), TopicDef("T", "Other")),
    ("topic's history", TopicDef("T", "Type"), TopicDef("T", "Type", keep_all=True)),
    ("publisher and subscriber", PublisherDef(), SubscriberDef()),
    ("writer's reliability", WRITER, replace(WRITER, reliable=False)),
    ("writer's durability", WRITER, replace(WRITER, transient_local=True)),
    ("writer's history", WRITER, replace(WRITER, keep_all=True)),
    ("writer's depth", WRITER, replace(WRITER, depth=3)),
    ("writer's deadline", WRITER, replace(WRITER, deadline_s=0.005)),
    ("writer's partitions", WRITER, replace(WRITER, partitions=("a",))),
    ("writer's other quality", WRITER, replace(WRITER, further=(("user_data", "05"),))),
    ("writer's topic by id", WRITER, replace(WRITER, topic_id=0x22)),
    ("writer's topic by name", NAMED_WRITER, replace(NAMED_WRITER, topic_name="U")),
    ("writer and reader", WRITER, ReaderDef(0x12, None, None, reliable=True, transient_local=False)),
    ("requester's request type", SERVICE, replace(SERVICE, request_type="x")),
    ("requester's reply type", SERVICE, replace(SERVICE, reply_type="x")),
    ("requester's request topic", SERVICE, replace(SERVICE, request_topic="x")),
    ("requester's reply topic", SERVICE, replace(SERVICE, reply_topic="x")),
    ("requester and replier", SERVICE, ReplierDef("svc", "ReqT", "RepT", "rq", "rr")),
]


@pytest.mark.parametrize(("name", "old", "new"), EQUAL, ids=[row[0] for row in EQUAL])
def test_matched(name: str, old: Definition, new: Definition) -> None:
    assert old == new


@pytest.mark.parametrize(("name", "old", "new"), DIFFERENT, ids=[row[0] for row in DIFFERENT])
def test_mismatch(name: str, old: Definition, new: Definition) -> None:
    assert old != new


def xml(kind: ObjectKind, text: str, parent: int = 0x13) -> ObjectVariant:
    return ObjectVariant(kind, Format.XML, text, parent_id=parent)


TOPIC_XML = "<kind>NO_KEY</kind><name>T</name><dataType>Type</dataType>"

SAME_OBJECT = [
    ("the parent is not compared", topic_variant("T", "Type", 0x11), topic_variant("T", "Type", 0x21)),
    ("publishers", publisher_variant(0x11), ObjectVariant(ObjectKind.PUBLISHER, Format.XML, "", parent_id=0x11)),
    (
        "two forms of one topic",
        topic_variant("T", "Type", 0x11),
        xml(ObjectKind.TOPIC, "<dds><topic><name>T</name><dataType>Type</dataType></topic></dds>", 0x11),
    ),
    (
        "two forms of one participant",
        participant_variant("p", 3),
        ObjectVariant(
            ObjectKind.PARTICIPANT,
            Format.XML,
            "<dds><participant><rtps><name>p</name></rtps></participant></dds>",
            domain_id=3,
        ),
    ),
    (
        "defaults said and not said",
        xml(ObjectKind.DATAWRITER, f"<dds><data_writer><topic>{TOPIC_XML}</topic></data_writer></dds>"),
        xml(
            ObjectKind.DATAWRITER,
            f"<dds><data_writer><qos><reliability><kind>RELIABLE</kind></reliability></qos><topic>{TOPIC_XML}"
            "<historyQos><kind>KEEP_LAST</kind></historyQos></topic></data_writer></dds>",
        ),
    ),
]

OTHER_OBJECT = [
    ("domain", participant_variant("p", 3), participant_variant("p", 4)),
    ("depth", writer_variant(0x12, 0x13, EndpointQos(depth=3)), writer_variant(0x12, 0x13, EndpointQos(depth=4))),
    ("reliability", reader_variant(0x12, 0x14), reader_variant(0x12, 0x14, EndpointQos(reliable=False))),
    (
        "reply topic",
        requester_variant("s", "Q", "P", "rq", "rr", 0x11),
        requester_variant("s", "Q", "P", "rq", "r2", 0x11),
    ),
    (
        "deadline in XML",
        xml(ObjectKind.DATAREADER, f"<dds><data_reader><topic>{TOPIC_XML}</topic></data_reader></dds>"),
        xml(
            ObjectKind.DATAREADER,
            f"<dds><data_reader><qos><deadline><period><sec>1</sec></period></deadline></qos><topic>{TOPIC_XML}</topic>"
            "</data_reader></dds>",
        ),
    ),
]


@pytest.mark.parametrize(("name", "old", "new"), SAME_OBJECT, ids=[row[0] for row in SAME_OBJECT])
def test_descriptions_of_the_same_object(name: str, old: ObjectVariant, new: ObjectVariant) -> None:
    assert parse_variant(old) == parse_variant(new)


@pytest.mark.parametrize(("name", "old", "new"), OTHER_OBJECT, ids=[row[0] for row in OTHER_OBJECT])
def test_descriptions_of_different_objects(name: str, old: ObjectVariant, new: ObjectVariant) -> None:
    assert parse_variant(old) != parse_variant(new)
