"""Objects described by any text, as the genuine agent accepts them with `-m ced`: the text is the topic's name."""

from __future__ import annotations

from msbot_xrce.errors import RemoteProtocolError
from msbot_xrce.messages.ids import Format, ObjectKind
from msbot_xrce.messages.objects import ObjectVariant
from msbot_xrce.objects.definitions import (
    Definition,
    ParticipantDef,
    PublisherDef,
    ReaderDef,
    SubscriberDef,
    TopicDef,
    WriterDef,
)


def named_by(variant: ObjectVariant) -> Definition:
    """The definition that results from reading a reference or XML as a topic's name.

    Raises:
        RemoteProtocolError: it is in binary form, or its kind has no name.
    """
    text = variant.text
    if text is None or variant.format not in (Format.REFERENCE, Format.XML):
        raise RemoteProtocolError("no text that could be a name")
    match variant.kind:
        case ObjectKind.PARTICIPANT:
            return ParticipantDef(variant.domain_id, text)
        case ObjectKind.TOPIC:
            return TopicDef(text, "")
        case ObjectKind.PUBLISHER:
            return PublisherDef(text)
        case ObjectKind.SUBSCRIBER:
            return SubscriberDef(text)
        case ObjectKind.DATAWRITER:
            return WriterDef(None, text, None, reliable=True, transient_local=False)
        case ObjectKind.DATAREADER:
            return ReaderDef(None, text, None, reliable=False, transient_local=False)
    raise RemoteProtocolError("an object of this kind has no name")
