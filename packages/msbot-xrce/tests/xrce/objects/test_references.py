"""Profile files, and what a reference means with and without one."""

from __future__ import annotations

import pytest

from msbot_xrce import References
from msbot_xrce.errors import ConfigError, RemoteProtocolError
from msbot_xrce.messages import Format, ObjectKind, ObjectVariant
from msbot_xrce.objects import (
    Definition,
    ParticipantDef,
    ReaderDef,
    RequesterDef,
    TopicDef,
    WriterDef,
    parse_variant,
)

FILE = """<profiles>
    <participant profile_name="default_xrce_participant"><domainId>9</domainId>
        <rtps><name>default_xrce_participant</name></rtps></participant>
    <participant profile_name="plain"><rtps><name>plain</name></rtps></participant>
    <topic profile_name="shapetype_topic"><kind>WITH_KEY</kind><name>Square</name><dataType>ShapeType</dataType></topic>
    <data_writer profile_name="shapetype_data_writer">
        <topic><kind>WITH_KEY</kind><name>Square</name><dataType>ShapeType</dataType></topic></data_writer>
    <data_reader profile_name="shapetype_data_reader">
        <topic><kind>WITH_KEY</kind><name>Square</name><dataType>ShapeType</dataType></topic></data_reader>
    <requester profile_name="shapetype_requester" service_name="shapetype_service"
        request_type="request_type" reply_type="reply_type"/>
    <transport_descriptors/>
</profiles>"""

REFERENCES = References.parse(FILE, "refs.xml")


def ref(kind: ObjectKind, name: str, domain_id: int = 0) -> ObjectVariant:
    return ObjectVariant(kind, Format.REFERENCE, name, domain_id=domain_id)


WITH_FILE: list[tuple[ObjectVariant, Definition]] = [
    (ref(ObjectKind.PARTICIPANT, "default_xrce_participant"), ParticipantDef(0, "default_xrce_participant")),
    (ref(ObjectKind.PARTICIPANT, "default_xrce_participant", 255), ParticipantDef(9, "default_xrce_participant")),
    (ref(ObjectKind.PARTICIPANT, "plain", 255), ParticipantDef(255, "plain")),
    (ref(ObjectKind.TOPIC, "shapetype_topic"), TopicDef("Square", "ShapeType")),
    (ref(ObjectKind.DATAWRITER, "shapetype_data_writer"), WriterDef(None, "Square", "ShapeType", True, False)),
    (ref(ObjectKind.DATAREADER, "shapetype_data_reader"), ReaderDef(None, "Square", "ShapeType", False, False)),
    (
        ref(ObjectKind.REQUESTER, "shapetype_requester"),
        RequesterDef(
            "shapetype_service", "request_type", "reply_type", "shapetype_service_Request", "shapetype_service_Reply"
        ),
    ),
]

WITHOUT_FILE: list[tuple[ObjectVariant, Definition]] = [
    (ref(ObjectKind.PARTICIPANT, "anything", 4), ParticipantDef(4, "anything")),
    (ref(ObjectKind.PARTICIPANT, "anything", 255), ParticipantDef(255, "anything")),
    (ref(ObjectKind.TOPIC, "HelloWorldTopic__t"), TopicDef("HelloWorldTopic", "")),
    (ref(ObjectKind.DATAWRITER, "HelloWorldTopic__dw"), WriterDef(None, "HelloWorldTopic", None, True, False)),
    (ref(ObjectKind.DATAREADER, "HelloWorldTopic__dr"), ReaderDef(None, "HelloWorldTopic", None, True, False)),
]


@pytest.mark.parametrize(("variant", "definition"), WITH_FILE)
def test_reference_to_a_profile(variant: ObjectVariant, definition: Definition) -> None:
    assert parse_variant(variant, REFERENCES) == definition


@pytest.mark.parametrize(("variant", "definition"), WITHOUT_FILE)
def test_reference_without_a_profile_file_may_name_the_topic(variant: ObjectVariant, definition: Definition) -> None:
    # As the genuine agent's in-memory middleware takes it.
    assert parse_variant(variant) == definition


@pytest.mark.parametrize("variant", [ref(ObjectKind.TOPIC, "no_such_profile"), ref(ObjectKind.TOPIC, "__t")])
def test_unknown_reference_without_a_profile_file(variant: ObjectVariant) -> None:
    with pytest.raises(RemoteProtocolError, match="there is no profile file"):
        parse_variant(variant)


@pytest.mark.parametrize(
    "variant", [ref(ObjectKind.TOPIC, "HelloWorldTopic__t"), ref(ObjectKind.PARTICIPANT, "unknown")]
)
def test_unknown_reference_with_a_profile_file(variant: ObjectVariant) -> None:
    with pytest.raises(RemoteProtocolError, match="the profile file has none of that name"):
        parse_variant(variant, REFERENCES)


@pytest.mark.parametrize("kind", [ObjectKind.REQUESTER, ObjectKind.QOSPROFILE])
def test_kinds_that_need_a_profile_file(kind: ObjectKind) -> None:
    with pytest.raises(RemoteProtocolError, match="there is no profile file"):
        parse_variant(ref(kind, "x"))


def test_what_a_file_may_look_like() -> None:
    assert len(REFERENCES) == 6
    assert len(References.parse(f"<dds>{FILE}</dds>", "refs.xml")) == 6
    assert len(References.parse("<dds><topic profile_name='t'><name>T</name></topic></dds>", "refs.xml")) == 1
    assert len(References()) == 0
    assert REFERENCES.get(ObjectKind.TOPIC, "shapetype_data_writer") is None


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<profiles>\n<topic>", "refs.xml: XML, line 2"),
        ("<other/>", "refs.xml, line 1: <other> where <profiles> is needed"),
        ("<profiles>\n<topic/></profiles>", "refs.xml, line 2: <topic> needs a profile_name"),
        ("<profiles>\n\n<topic profile_name='t'/></profiles>", "refs.xml, line 3: a topic without a name"),
        (
            "<profiles><participant profile_name='p'/>\n<participant profile_name='p'/></profiles>",
            "refs.xml, line 2: a second <participant> profile 'p'",
        ),
        (
            "<profiles><participant profile_name='p'><domainId>x</domainId></participant></profiles>",
            "refs.xml, line 1: XML domainId is 'x'",
        ),
    ],
)
def test_wrong_file_is_named_with_the_line(text: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        References.parse(text, "refs.xml")
