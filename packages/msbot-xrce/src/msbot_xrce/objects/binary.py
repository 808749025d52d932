"""Descriptions of objects in binary form, the way eProsima's C client writes them. Our own client sends these."""

from __future__ import annotations

from msbot_xrce.lazy import dataclass
from msbot_xrce.messages.cdr import CdrWriter
from msbot_xrce.messages.ids import Format, ObjectKind
from msbot_xrce.messages.objects import ObjectVariant
from msbot_xrce.objects.parse import FLAG_KEEP_LAST, FLAG_RELIABLE, FLAG_TRANSIENT_LOCAL


@dataclass(frozen=True, slots=True)
class EndpointQos:
    """The quality of service that a client can ask of a writer or reader."""

    reliable: bool = True
    transient_local: bool = False
    """The writer keeps its last `depth` samples for readers that come later."""
    keep_all: bool = False
    depth: int | None = None
    """Samples to keep, 1 to 65535; None: the agent decides."""


RELIABLE_QOS = EndpointQos()
"""Nothing is lost on the way; late readers get no earlier samples."""


def participant_variant(name: str, domain: int = 0) -> ObjectVariant:
    """A participant; domain 255: the agent decides."""
    writer = CdrWriter()
    writer.boolean(False)
    _optional_string(writer, name)
    return ObjectVariant(ObjectKind.PARTICIPANT, Format.BINARY, blob=writer.finish(), domain_id=domain)


def topic_variant(name: str, type_name: str, participant_id: int) -> ObjectVariant:
    """A topic of a participant."""
    writer = CdrWriter()
    writer.string(name)
    writer.boolean(False)
    _optional_string(writer, type_name)
    return ObjectVariant(ObjectKind.TOPIC, Format.BINARY, blob=writer.finish(), parent_id=participant_id)


def publisher_variant(participant_id: int) -> ObjectVariant:
    """A publisher of a participant, without a name."""
    return ObjectVariant(ObjectKind.PUBLISHER, Format.BINARY, blob=b"\0\0", parent_id=participant_id)


def subscriber_variant(participant_id: int) -> ObjectVariant:
    """A subscriber of a participant, without a name."""
    return ObjectVariant(ObjectKind.SUBSCRIBER, Format.BINARY, blob=b"\0\0", parent_id=participant_id)


def writer_variant(topic_id: int, publisher_id: int, qos: EndpointQos = RELIABLE_QOS) -> ObjectVariant:
    """A data writer of a publisher."""
    blob = _endpoint_blob(topic_id, qos, b"\0")
    return ObjectVariant(ObjectKind.DATAWRITER, Format.BINARY, blob=blob, parent_id=publisher_id)


def reader_variant(topic_id: int, subscriber_id: int, qos: EndpointQos = RELIABLE_QOS) -> ObjectVariant:
    """A data reader of a subscriber."""
    blob = _endpoint_blob(topic_id, qos, b"\0\0")
    return ObjectVariant(ObjectKind.DATAREADER, Format.BINARY, blob=blob, parent_id=subscriber_id)


def requester_variant(  # noqa: PLR0917 - a service has five names
    service: str, request_type: str, reply_type: str, request_topic: str, reply_topic: str, participant_id: int
) -> ObjectVariant:
    """The side of a service that asks."""
    blob = _service_blob(service, request_type, reply_type, request_topic, reply_topic)
    return ObjectVariant(ObjectKind.REQUESTER, Format.BINARY, blob=blob, parent_id=participant_id)


def replier_variant(  # noqa: PLR0917 - a service has five names
    service: str, request_type: str, reply_type: str, request_topic: str, reply_topic: str, participant_id: int
) -> ObjectVariant:
    """The side of a service that answers."""
    blob = _service_blob(service, request_type, reply_type, request_topic, reply_topic)
    return ObjectVariant(ObjectKind.REPLIER, Format.BINARY, blob=blob, parent_id=participant_id)


def _endpoint_blob(topic_id: int, qos: EndpointQos, no_more: bytes) -> bytes:
    writer = CdrWriter()
    writer.octets(topic_id.to_bytes(2, "big"))
    writer.boolean(True)
    flags = FLAG_RELIABLE if qos.reliable else 0
    flags |= 0 if qos.keep_all else FLAG_KEEP_LAST
    flags |= FLAG_TRANSIENT_LOCAL if qos.transient_local else 0
    writer.u16(flags)
    writer.boolean(qos.depth is not None)
    if qos.depth is not None:
        writer.u16(qos.depth)
    # No deadline, no lifespan, no user data, and no policies that only writers or only readers have.
    writer.octets(b"\0\0\0" + no_more)
    return writer.finish()


def _service_blob(service: str, request_type: str, reply_type: str, request_topic: str, reply_topic: str) -> bytes:
    writer = CdrWriter()
    writer.string(service)
    writer.string(request_type)
    writer.string(reply_type)
    _optional_string(writer, request_topic)
    _optional_string(writer, reply_topic)
    return writer.finish()


def _optional_string(writer: CdrWriter, text: str) -> None:
    writer.boolean(bool(text))
    if text:
        writer.string(text)
