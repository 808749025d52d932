"""XML elements as definitions."""

from __future__ import annotations

import pytest

from msbot_xrce.errors import RemoteProtocolError
from msbot_xrce.messages import ObjectKind
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
)
from msbot_xrce.objects.xml import parse_xml
from msbot_xrce.objects.xml_profiles import define, domain_of, locate

QOS = "<qos><reliability><kind>{}</kind></reliability><durability><kind>{}</kind></durability></qos>"
TOPIC = "<topic><kind>NO_KEY</kind><name>T</name><dataType>Type</dataType>{}</topic>"
HISTORY = "<historyQos><kind>{}</kind><depth>{}</depth></historyQos>"

TABLE: list[tuple[ObjectKind, str, Definition]] = [
    (ObjectKind.PARTICIPANT, "<participant><rtps><name>p</name></rtps></participant>", ParticipantDef(3, "p")),
    (ObjectKind.PARTICIPANT, "<participant/>", ParticipantDef(3, "MicroXRCEParticipant")),
    (ObjectKind.TOPIC, "<topic><name>T</name><dataType>Type</dataType></topic>", TopicDef("T", "Type")),
    (ObjectKind.TOPIC, f"<topic><name>T</name>{HISTORY.format('KEEP_LAST', 7)}</topic>", TopicDef("T", "", depth=7)),
    (ObjectKind.TOPIC, f"<topic><name>T</name>{HISTORY.format('KEEP_ALL', 7)}</topic>", TopicDef("T", "", True)),
    (
        ObjectKind.TOPIC,
        "<topic><name>T</name><resourceLimitsQos><max_samples>5</max_samples></resourceLimitsQos></topic>",
        TopicDef("T", "", further=(("resourceLimitsQos/max_samples", "5"),)),
    ),
    (ObjectKind.PUBLISHER, "<publisher/>", PublisherDef()),
    (ObjectKind.SUBSCRIBER, "<subscriber/>", SubscriberDef()),
    (
        ObjectKind.DATAWRITER,
        f"<data_writer>{TOPIC.format('')}</data_writer>",
        WriterDef(None, "T", "Type", reliable=True, transient_local=False),
    ),
    (
        ObjectKind.DATAREADER,
        f"<data_reader>{TOPIC.format('')}</data_reader>",
        ReaderDef(None, "T", "Type", reliable=False, transient_local=False),
    ),
    (
        ObjectKind.DATAWRITER,
        f"<data_writer>{QOS.format('BEST_EFFORT', 'PERSISTENT')}{TOPIC.format(HISTORY.format('KEEP_LAST', 3))}"
        "</data_writer>",
        WriterDef(None, "T", "Type", reliable=False, transient_local=True, depth=3),
    ),
    (
        ObjectKind.DATAREADER,
        f"<data_reader><historyMemoryPolicy>DYNAMIC</historyMemoryPolicy>{QOS.format('RELIABLE', 'TRANSIENT_LOCAL')}"
        f"{TOPIC.format(HISTORY.format('KEEP_ALL', 0))}</data_reader>",
        ReaderDef(None, "T", "Type", True, True, keep_all=True, further=(("historyMemoryPolicy", "DYNAMIC"),)),
    ),
    (
        ObjectKind.DATAWRITER,
        f"<data_writer>{TOPIC.format('')}<qos><ownership><kind>EXCLUSIVE</kind></ownership>"
        "<ownershipStrength><value>9</value></ownershipStrength>"
        "<deadline><period><sec>1</sec><nanosec>500000000</nanosec></period></deadline>"
        "<lifespan><duration><sec>DURATION_INFINITY</sec></duration></lifespan>"
        "<partition><names><name>a</name><name>b*</name></names></partition>"
        "<durabilityService><history_kind>KEEP_LAST</history_kind><history_depth>4</history_depth></durabilityService>"
        "</qos></data_writer>",
        WriterDef(
            None,
            "T",
            "Type",
            True,
            False,
            late_depth=4,
            partitions=("a", "b*"),
            deadline_s=1.5,
            exclusive=True,
            strength=9,
        ),
    ),
    (
        ObjectKind.DATAREADER,
        f"<data_reader>{TOPIC.format('')}<qos><lifespan><duration><sec>2</sec></duration></lifespan>"
        "<timeBasedFilter><minimum_separation><nanosec>250000000</nanosec></minimum_separation></timeBasedFilter>"
        "<deadline><period><sec>2147483647</sec></period></deadline></qos></data_reader>",
        ReaderDef(None, "T", "Type", False, False, lifespan_s=2.0, separation_s=0.25),
    ),
    (
        ObjectKind.REQUESTER,
        '<requester profile_name="p" service_name="s" request_type="Q" reply_type="P"/>',
        RequesterDef("s", "Q", "P", "s_Request", "s_Reply"),
    ),
    (
        ObjectKind.REPLIER,
        '<replier service_name="s" request_type="Q" reply_type="P">'
        "<request_topic_name>rq</request_topic_name><reply_topic_name>rr</reply_topic_name></replier>",
        ReplierDef("s", "Q", "P", "rq", "rr"),
    ),
]


@pytest.mark.parametrize(("kind", "text", "definition"), TABLE)
@pytest.mark.parametrize(
    "around", ["{}", "<dds>{}</dds>", "<dds><profiles>{}</profiles></dds>", "<profiles>{}</profiles>"]
)
def test_elements(kind: ObjectKind, text: str, definition: Definition, around: str) -> None:
    found = define(kind, locate(kind, parse_xml(around.format(text))), 3)
    assert found == definition
    assert repr(found) == repr(definition)


@pytest.mark.parametrize(("kind", "tag"), [(ObjectKind.DATAWRITER, "publisher"), (ObjectKind.DATAREADER, "subscriber")])
def test_old_names_of_writers_and_readers(kind: ObjectKind, tag: str) -> None:
    definition = define(kind, locate(kind, parse_xml(f"<dds><{tag}>{TOPIC.format('')}</{tag}></dds>")))
    assert isinstance(definition, WriterDef | ReaderDef)
    assert definition.topic_name == "T"


@pytest.mark.parametrize(
    ("kind", "text", "reason"),
    [
        (ObjectKind.TOPIC, "<dds><participant/></dds>", "XML without <topic>"),
        (ObjectKind.TOPIC, "<other><topic/></other>", "XML without <topic>"),
        (ObjectKind.TOPIC, "<dds><topic/></dds>", "a topic without a name"),
        (ObjectKind.TOPIC, "<topic><name/></topic>", "a topic without a name"),
        (ObjectKind.TOPIC, f"<topic><name>T</name>{HISTORY.format('KEEP', 1)}</topic>", "one of KEEP_LAST, KEEP_ALL"),
        (ObjectKind.TOPIC, f"<topic><name>T</name>{HISTORY.format('KEEP_LAST', '-1')}</topic>", "depth is '-1'"),
        (ObjectKind.TOPIC, f"<topic><name>T</name>{HISTORY.format('KEEP_LAST', '9' * 5000)}</topic>", "depth is '999"),
        (ObjectKind.DATAWRITER, "<data_writer/>", "a topic without a name"),
        (
            ObjectKind.DATAWRITER,
            f"<data_writer>{QOS.format('MAYBE', 'VOLATILE')}{TOPIC.format('')}</data_writer>",
            "qos/reliability/kind is 'MAYBE'",
        ),
        (ObjectKind.REQUESTER, "<requester/>", "a service without a name"),
    ],
)
def test_refused(kind: ObjectKind, text: str, reason: str) -> None:
    with pytest.raises(RemoteProtocolError, match=reason):
        define(kind, locate(kind, parse_xml(text)))


def test_service_without_a_name_but_with_both_topics_is_taken() -> None:
    text = "<requester><request_topic_name>q</request_topic_name><reply_topic_name>p</reply_topic_name></requester>"
    definition = define(ObjectKind.REQUESTER, parse_xml(text))
    assert definition == RequesterDef("", "", "", "q", "p")


def test_kinds_that_are_not_made() -> None:
    with pytest.raises(RemoteProtocolError, match="QOSPROFILE are not made"):
        define(ObjectKind.QOSPROFILE, parse_xml("<x/>"))


@pytest.mark.parametrize(
    ("text", "domain"),
    [
        ("<participant/>", None),
        ("<participant><domainId>7</domainId></participant>", 7),
        ('<participant domain_id="8"/>', 8),
    ],
)
def test_domain_of_a_participant(text: str, domain: int | None) -> None:
    assert domain_of(parse_xml(text)) == domain


def test_domain_must_be_a_number_up_to_255() -> None:
    with pytest.raises(RemoteProtocolError, match="domainId is '256'"):
        domain_of(parse_xml("<participant><domainId>256</domainId></participant>"))
