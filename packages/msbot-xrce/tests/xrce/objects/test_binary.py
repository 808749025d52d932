"""What our own client sends is what the genuine client sends, and is understood by ourselves."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot_xrce.messages import Create, Format, ObjectVariant, iter_submessages
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
    replier_variant,
    requester_variant,
    subscriber_variant,
    topic_variant,
    writer_variant,
)
from tests.xrce.captures import recorded

TABLE: list[tuple[ObjectVariant, Definition]] = [
    (participant_variant("p", 5), ParticipantDef(5, "p")),
    (participant_variant(""), ParticipantDef(0, "MicroXRCEParticipant")),
    (topic_variant("T", "Type", 0x11), TopicDef("T", "Type")),
    (topic_variant("T", "", 0x11), TopicDef("T", "")),
    (publisher_variant(0x11), PublisherDef()),
    (subscriber_variant(0x11), SubscriberDef()),
    (requester_variant("s", "Q", "P", "rq", "rr", 0x11), RequesterDef("s", "Q", "P", "rq", "rr")),
    (replier_variant("s", "Q", "P", "rq", "rr", 0x11), ReplierDef("s", "Q", "P", "rq", "rr")),
    (replier_variant("s", "Q", "P", "", "", 0x11), ReplierDef("s", "Q", "P", "s_Request", "s_Reply")),
]


@pytest.mark.parametrize(("variant", "definition"), TABLE)
def test_descriptions_say_what_they_shall(variant: ObjectVariant, definition: Definition) -> None:
    assert repr(parse_variant(variant)) == repr(definition)


@given(
    st.integers(0, 0xFFFF),
    st.builds(EndpointQos, st.booleans(), st.booleans(), st.booleans(), st.none() | st.integers(1, 0xFFFF)),
)
def test_quality_of_service_arrives(topic_id: int, qos: EndpointQos) -> None:
    depth = None if qos.keep_all else qos.depth
    for variant in (writer_variant(topic_id, 0x13, qos), reader_variant(topic_id, 0x14, qos)):
        make = WriterDef if variant.parent_id == 0x13 else ReaderDef
        assert parse_variant(variant) == make(
            topic_id, None, None, qos.reliable, qos.transient_local, qos.keep_all, depth
        )


def test_every_description_of_the_genuine_client_in_binary_form_is_made_alike() -> None:
    late = EndpointQos(transient_local=True)
    ours = {
        variant.kind: variant
        for variant in (
            participant_variant("default_xrce_participant"),
            topic_variant("HelloWorldTopic", "HelloWorld", 0x0011),
            publisher_variant(0x0011),
            subscriber_variant(0x0011),
            writer_variant(0x0012, 0x0013, late),
            reader_variant(0x0012, 0x0014, late),
        )
    }
    seen = set()
    for record in recorded("udp_bin_loop_dds"):
        if record.from_client:
            for one in iter_submessages(record.packet, 4):
                if isinstance(one, Create):
                    assert one.variant.format == Format.BINARY
                    assert one.variant.parent_id == ours[one.variant.kind].parent_id
                    assert_same_but_stale_padding(one.variant.blob or b"", ours[one.variant.kind].blob or b"")
                    seen.add(one.variant.kind)
    assert seen == set(ours)


def assert_same_but_stale_padding(theirs: bytes, ours: bytes) -> None:
    assert len(theirs) == len(ours)
    differing = [(a, b) for a, b in zip(theirs, ours, strict=True) if a != b]
    # Up to 3 octets before the type name of a topic.
    assert len(differing) <= 3
    assert all(b == 0 for _, b in differing)
