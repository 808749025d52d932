"""Descriptions of objects in all three forms: REF, XML and BIN."""

from msbot_xrce.objects.binary import (
    RELIABLE_QOS,
    EndpointQos,
    participant_variant,
    publisher_variant,
    reader_variant,
    replier_variant,
    requester_variant,
    subscriber_variant,
    topic_variant,
    writer_variant,
)
from msbot_xrce.objects.definitions import (
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
from msbot_xrce.objects.parse import parse_variant
from msbot_xrce.objects.references import named_by

__all__ = [
    "RELIABLE_QOS",
    "Definition",
    "EndpointQos",
    "ParticipantDef",
    "PublisherDef",
    "ReaderDef",
    "ReplierDef",
    "RequesterDef",
    "SubscriberDef",
    "TopicDef",
    "WriterDef",
    "named_by",
    "parse_variant",
    "participant_variant",
    "publisher_variant",
    "reader_variant",
    "replier_variant",
    "requester_variant",
    "subscriber_variant",
    "topic_variant",
    "writer_variant",
]
