"""From the description in a CREATE to a definition: by reference, by XML, or in binary form.

A binary description is CDR of its own: alignment counts from its first octet, the byte order is that of the CREATE
(XRCE 1.0 §7.7.3, as eProsima's client writes it; seen on the wire).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from msbot_xrce.errors import RemoteProtocolError
from msbot_xrce.identity_cache import IdentityCache
from msbot_xrce.messages.cdr import CdrReader
from msbot_xrce.messages.ids import Format, ObjectKind
from msbot_xrce.messages.objects import KEPT, KEPT_OCTETS, ObjectVariant
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
from msbot_xrce.objects.references import References, resolve
from msbot_xrce.objects.xml import Element, parse_xml
from msbot_xrce.objects.xml_profiles import DEFAULT_PARTICIPANT_NAME, define, locate, service_topics, topic_name

FLAG_RELIABLE = 0x01
FLAG_KEEP_LAST = 0x02
FLAG_EXCLUSIVE = 0x04
FLAG_TRANSIENT_LOCAL = 0x08
FLAG_TRANSIENT = 0x10
FLAG_PERSISTENT = 0x20

_REFERENCE = Format.REFERENCE.value
_KNOWN = FLAG_RELIABLE | FLAG_KEEP_LAST | FLAG_EXCLUSIVE | FLAG_TRANSIENT_LOCAL
_DURABLE = FLAG_TRANSIENT_LOCAL | FLAG_TRANSIENT | FLAG_PERSISTENT


def parse_variant(
    variant: ObjectVariant, references: References | None = None, *, little_endian: bool = True
) -> Definition:
    """What the client wants, from any of the three forms.

    Raises:
        RemoteProtocolError: a kind that cannot be created, an unknown form, or contents that make no sense.
    """
    known = (_kept_little if little_endian else _kept_big).kept.get(id(variant))
    if known is not None:
        return known[1]
    if variant.format == _REFERENCE and variant.text is not None:
        return resolve(_kind_of(variant), variant.text, variant.domain_id, references)
    if len(variant.blob or variant.text or "") > KEPT_OCTETS:
        return _parse(variant, little_endian=little_endian)
    return (_kept_little if little_endian else _kept_big)(variant)


def _kind_of(variant: ObjectVariant) -> ObjectKind:
    try:
        return ObjectKind(variant.kind)
    except ValueError:
        raise RemoteProtocolError(f"an object of kind {variant.kind}: there is no such kind") from None


def _parse(variant: ObjectVariant, *, little_endian: bool) -> Definition:
    kind = _kind_of(variant)
    if variant.format == Format.XML and variant.text is not None:
        return _from_xml(kind, variant.text, variant.domain_id)
    if variant.format == Format.BINARY and variant.blob is not None and kind in _BINARY:
        return _BINARY[kind](CdrReader(variant.blob, little_endian=little_endian), variant)
    raise RemoteProtocolError(f"a {kind.name.lower()} in form {variant.format}: not understood")


# Equal descriptions are one object (`ObjectVariant` is kept by the octets of the CREATE).
_kept_little = IdentityCache(partial(_parse, little_endian=True), KEPT)
_kept_big = IdentityCache(partial(_parse, little_endian=False), KEPT)


def _from_xml(kind: ObjectKind, text: str, domain_id: int) -> Definition:
    if kind > ObjectKind.REPLIER:
        raise RemoteProtocolError(f"objects of kind {kind.name} are not made")
    # No XML at all means defaults; kinds that need a name then fail because it is missing.
    element = locate(kind, parse_xml(text)) if text else Element("", {}, 1)
    return define(kind, element, domain_id)


def _participant(reader: CdrReader, variant: ObjectVariant) -> ParticipantDef:
    _optional_string(reader)
    return ParticipantDef(variant.domain_id, _optional_string(reader) or DEFAULT_PARTICIPANT_NAME)


def _topic(reader: CdrReader, variant: ObjectVariant) -> TopicDef:  # noqa: ARG001 - one signature for all kinds
    name = topic_name(reader.string())
    _optional_string(reader)
    return TopicDef(name, _optional_string(reader) or "")


def _publisher(reader: CdrReader, variant: ObjectVariant) -> PublisherDef:  # noqa: ARG001
    # What follows the name is not read: eProsima's client and agent disagree about its form, and nobody sends it.
    return PublisherDef(_optional_string(reader) or "")


def _subscriber(reader: CdrReader, variant: ObjectVariant) -> SubscriberDef:  # noqa: ARG001
    return SubscriberDef(_optional_string(reader) or "")


def _writer(reader: CdrReader, variant: ObjectVariant) -> WriterDef:  # noqa: ARG001
    topic_id = int.from_bytes(reader.octets(2), "big")
    if not reader.boolean():
        return WriterDef(topic_id, None, None, reliable=True, transient_local=False)
    qos = _endpoint_qos(reader)
    if reader.boolean():
        qos["strength"] = reader.u32() & 0x7FFFFFFF
    return WriterDef(topic_id, None, None, **qos)


def _reader(reader: CdrReader, variant: ObjectVariant) -> ReaderDef:  # noqa: ARG001
    topic_id = int.from_bytes(reader.octets(2), "big")
    if not reader.boolean():
        return ReaderDef(topic_id, None, None, reliable=False, transient_local=False)
    qos = _endpoint_qos(reader)
    if reader.boolean():
        qos["separation_s"] = reader.u32() / 1000
    if reader.boolean():
        qos["further"] += (("contentbased_filter", reader.string()),)
    return ReaderDef(topic_id, None, None, **qos)


def _requester(reader: CdrReader, variant: ObjectVariant) -> RequesterDef:  # noqa: ARG001
    return RequesterDef(*_service(reader))


def _replier(reader: CdrReader, variant: ObjectVariant) -> ReplierDef:  # noqa: ARG001
    return ReplierDef(*_service(reader))


_BINARY: dict[ObjectKind, Callable[[CdrReader, ObjectVariant], Definition]] = {
    ObjectKind.PARTICIPANT: _participant,
    ObjectKind.TOPIC: _topic,
    ObjectKind.PUBLISHER: _publisher,
    ObjectKind.SUBSCRIBER: _subscriber,
    ObjectKind.DATAWRITER: _writer,
    ObjectKind.DATAREADER: _reader,
    ObjectKind.REQUESTER: _requester,
    ObjectKind.REPLIER: _replier,
}


def _endpoint_qos(reader: CdrReader) -> dict[str, Any]:
    """The common part, as the arguments of a definition."""
    flags = reader.u16()
    depth = reader.u16() if reader.boolean() else None
    deadline_ms = reader.u32() if reader.boolean() else 0
    lifespan_ms = reader.u32() if reader.boolean() else 0
    user_data = reader.octet_sequence().hex() if reader.boolean() else None
    # The durabilities beyond transient local are served as transient local, but do not compare equal to it.
    further = [] if not flags & ~_KNOWN else [("qos_flags", f"0x{flags:04X}")]
    if user_data is not None:
        further.append(("user_data", user_data))
    return {
        "reliable": bool(flags & FLAG_RELIABLE),
        "transient_local": bool(flags & _DURABLE),
        "keep_all": not flags & FLAG_KEEP_LAST,
        "depth": depth or None if flags & FLAG_KEEP_LAST else None,
        "deadline_s": deadline_ms / 1000 or None,
        "lifespan_s": lifespan_ms / 1000 or None,
        "exclusive": bool(flags & FLAG_EXCLUSIVE),
        "further": tuple(further),
    }


def _service(reader: CdrReader) -> tuple[str, str, str, str, str]:
    name, request_type, reply_type = reader.string(), reader.string(), reader.string()
    topics = service_topics(name, _optional_string(reader), _optional_string(reader))
    return name, request_type, reply_type, *topics


def _optional_string(reader: CdrReader) -> str | None:
    return reader.string() if reader.boolean() else None
