"""Any text is a topic's name."""

from __future__ import annotations

import pytest

from msbot_xrce.errors import RemoteProtocolError
from msbot_xrce.messages import Format, ObjectKind, ObjectVariant
from msbot_xrce.objects import ParticipantDef, PublisherDef, ReaderDef, SubscriberDef, TopicDef, WriterDef, named_by


@pytest.mark.parametrize("form", [Format.REFERENCE, Format.XML])
@pytest.mark.parametrize(
    ("kind", "definition"),
    [
        (ObjectKind.PARTICIPANT, ParticipantDef(0, "<a text>")),
        (ObjectKind.TOPIC, TopicDef("<a text>", "")),
        (ObjectKind.PUBLISHER, PublisherDef("<a text>")),
        (ObjectKind.SUBSCRIBER, SubscriberDef("<a text>")),
        (ObjectKind.DATAWRITER, WriterDef(None, "<a text>", None, reliable=True, transient_local=False)),
        (ObjectKind.DATAREADER, ReaderDef(None, "<a text>", None, reliable=False, transient_local=False)),
    ],
)
def test_a_text_is_a_name(form: Format, kind: ObjectKind, definition: object) -> None:
    assert named_by(ObjectVariant(kind, form, text="<a text>")) == definition


def test_binary_forms_and_services_have_no_name() -> None:
    with pytest.raises(RemoteProtocolError, match="no text"):
        named_by(ObjectVariant(ObjectKind.TOPIC, Format.BINARY, blob=b"light"))
    with pytest.raises(RemoteProtocolError, match="no name"):
        named_by(ObjectVariant(ObjectKind.REQUESTER, Format.XML, text="add"))
