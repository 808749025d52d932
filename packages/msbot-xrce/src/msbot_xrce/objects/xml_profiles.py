"""From an XML element to a definition: the same elements are in a CREATE and in a profile file.

The names are those of Fast DDS profiles, which eProsima's clients send. Unknown elements and attributes are ignored.
"""

from __future__ import annotations

from collections.abc import Callable

from msbot_xrce.errors import RemoteProtocolError
from msbot_xrce.messages.ids import ObjectKind
from msbot_xrce.objects.definitions import (
    Definition,
    FurtherQos,
    ParticipantDef,
    PublisherDef,
    ReaderDef,
    ReplierDef,
    RequesterDef,
    SubscriberDef,
    TopicDef,
    WriterDef,
)
from msbot_xrce.objects.xml import Element

DEFAULT_PARTICIPANT_NAME = "MicroXRCEParticipant"
"""What the genuine agent calls a participant without a name."""

TAGS: dict[ObjectKind, tuple[str, ...]] = {
    ObjectKind.PARTICIPANT: ("participant",),
    ObjectKind.TOPIC: ("topic",),
    ObjectKind.PUBLISHER: ("publisher",),
    ObjectKind.SUBSCRIBER: ("subscriber",),
    ObjectKind.DATAWRITER: ("data_writer", "publisher"),
    ObjectKind.DATAREADER: ("data_reader", "subscriber"),
    ObjectKind.REQUESTER: ("requester",),
    ObjectKind.REPLIER: ("replier",),
}
"""How the element of each kind is called; the second name is that of old profiles."""

_HONOURED = frozenset(
    [
        "name",
        "kind",
        "dataType",
        "historyQos/kind",
        "historyQos/depth",
        "topic/name",
        "topic/kind",
        "topic/dataType",
        "topic/historyQos/kind",
        "topic/historyQos/depth",
        "qos/reliability/kind",
        "qos/durability/kind",
        "qos/durabilityService/history_kind",
        "qos/durabilityService/history_depth",
        "qos/deadline/period/sec",
        "qos/deadline/period/nanosec",
        "qos/lifespan/duration/sec",
        "qos/lifespan/duration/nanosec",
        "qos/ownership/kind",
        "qos/ownershipStrength/value",
        "qos/partition/names/name",
        "qos/timeBasedFilter/minimum_separation/sec",
        "qos/timeBasedFilter/minimum_separation/nanosec",
    ]
)

_RELIABILITY = {"RELIABLE": True, "BEST_EFFORT": False}
_DURABILITY = {"VOLATILE": False, "TRANSIENT_LOCAL": True, "TRANSIENT": True, "PERSISTENT": True}
_HISTORY = {"KEEP_LAST": False, "KEEP_ALL": True}
_OWNERSHIP = {"SHARED": False, "EXCLUSIVE": True}

_ENDLESS = ("DURATION_INFINITY", "DURATION_INFINITE_SEC", "DURATION_INFINITE_NSEC")
_MOST_SECONDS = 0x7FFFFFFF
_MAX_PARTITIONS = 16
_LONGEST_PARTITION = 256

_MAX_DEPTH = 0x7FFFFFFF


def define(kind: ObjectKind, element: Element, domain_id: int = 0) -> Definition:
    """The object that an element describes; `domain_id` is for participants.

    Raises:
        RemoteProtocolError: a name is missing, or a value is not one of those allowed.
    """
    match kind:
        case ObjectKind.PARTICIPANT:
            return ParticipantDef(domain_id, element.find("rtps/name") or DEFAULT_PARTICIPANT_NAME)
        case ObjectKind.TOPIC:
            keep_all, depth = _history(element, "historyQos")
            name = topic_name(element.find("name"))
            return TopicDef(name, element.find("dataType") or "", keep_all, depth, _further(element))
        case ObjectKind.PUBLISHER:
            return PublisherDef()
        case ObjectKind.SUBSCRIBER:
            return SubscriberDef()
        case ObjectKind.DATAWRITER:
            # By default a writer is reliable and a reader is not (as in Fast DDS).
            return _endpoint(WriterDef, element, reliable=True)
        case ObjectKind.DATAREADER:
            return _endpoint(ReaderDef, element, reliable=False)
        case ObjectKind.REQUESTER:
            return _service(RequesterDef, element)
        case ObjectKind.REPLIER:
            return _service(ReplierDef, element)
    raise RemoteProtocolError(f"objects of kind {kind.name} are not made")


def locate(kind: ObjectKind, root: Element) -> Element:
    """The element of that kind in a CREATE: the root itself, or below `<dds>`, with or without `<profiles>` between.

    Raises:
        RemoteProtocolError: there is none.
    """
    tags = TAGS[kind]
    element: Element | None = root
    while element is not None and element.tag not in tags:
        element = element.child(*tags, "profiles") if element.tag in ("dds", "profiles") else None
    if element is None:
        raise RemoteProtocolError(f"XML without <{tags[0]}>")
    return element


def domain_of(element: Element) -> int | None:
    """The domain that a participant's profile names, or None.

    Raises:
        RemoteProtocolError: it is not a number from 0 to 255.
    """
    text = element.find("domainId") or element.attributes.get("domain_id")
    return None if not text else _number("domainId", text, 0xFF)


def topic_name(name: str | None) -> str:
    """The name, if there is one.

    Raises:
        RemoteProtocolError: it is missing or empty.
    """
    if not name:
        raise RemoteProtocolError("a topic without a name")
    return name


def service_topics(service_name: str, request_topic: str | None, reply_topic: str | None) -> tuple[str, str]:
    """The two topics of a service: as given, or made from its name as Fast DDS does.

    Raises:
        RemoteProtocolError: neither is given.
    """
    if not service_name and not (request_topic and reply_topic):
        raise RemoteProtocolError("a service without a name")
    return request_topic or f"{service_name}_Request", reply_topic or f"{service_name}_Reply"


def _endpoint(
    make: Callable[..., WriterDef] | Callable[..., ReaderDef], element: Element, *, reliable: bool
) -> WriterDef | ReaderDef:
    keep_all, depth = _history(element, "topic/historyQos")
    return make(
        topic_id=None,
        topic_name=topic_name(element.find("topic/name")),
        type_name=element.find("topic/dataType"),
        reliable=_choice(element, "qos/reliability/kind", _RELIABILITY, default=reliable),
        transient_local=_choice(element, "qos/durability/kind", _DURABILITY, default=False),
        keep_all=keep_all,
        depth=depth,
        late_depth=_late_depth(element),
        partitions=_partitions(element),
        deadline_s=_duration(element, "qos/deadline/period"),
        lifespan_s=_duration(element, "qos/lifespan/duration"),
        exclusive=_choice(element, "qos/ownership/kind", _OWNERSHIP, default=False),
        strength=_number("ownershipStrength", element.find("qos/ownershipStrength/value") or "0", _MAX_DEPTH),
        separation_s=_duration(element, "qos/timeBasedFilter/minimum_separation") or 0.0,
        further=_further(element),
    )


def _late_depth(element: Element) -> int | None:
    """The depth of the durability service; KEEP_ALL counts as the largest depth there is."""
    if _choice(element, "qos/durabilityService/history_kind", _HISTORY, default=False):
        return _MAX_DEPTH
    depth = element.find("qos/durabilityService/history_depth")
    return _number("history_depth", depth, _MAX_DEPTH) or None if depth else None


def _partitions(element: Element) -> tuple[str, ...]:
    names: Element | None = element
    for tag in ("qos", "partition", "names"):
        names = names.child(tag) if names is not None else None
    found = [] if names is None else [child.text for child in names.children if child.tag == "name"]
    if len(found) > _MAX_PARTITIONS or any(len(name) > _LONGEST_PARTITION for name in found):
        raise RemoteProtocolError(
            f"XML partition: {_MAX_PARTITIONS} names of {_LONGEST_PARTITION} characters are the most"
        )
    return tuple(found)


def _duration(element: Element, path: str) -> float | None:
    """Seconds; None if it is missing, infinite or zero."""
    seconds, nanoseconds = element.find(f"{path}/sec") or "0", element.find(f"{path}/nanosec") or "0"
    if seconds in _ENDLESS or nanoseconds in _ENDLESS:
        return None
    whole = _number(f"{path}/sec", seconds, 0xFFFFFFFF)
    if whole >= _MOST_SECONDS:
        return None  # how DDS writes "for ever" as a number
    return whole + _number(f"{path}/nanosec", nanoseconds, 0xFFFFFFFF) / 1e9 or None


def _service(
    make: Callable[[str, str, str, str, str], RequesterDef] | Callable[[str, str, str, str, str], ReplierDef],
    element: Element,
) -> RequesterDef | ReplierDef:
    attributes = element.attributes
    name = attributes.get("service_name", "")
    topics = service_topics(name, element.find("request_topic_name"), element.find("reply_topic_name"))
    return make(name, attributes.get("request_type", ""), attributes.get("reply_type", ""), *topics)


def _history(element: Element, path: str) -> tuple[bool, int | None]:
    keep_all = _choice(element, f"{path}/kind", _HISTORY, default=False)
    depth = element.find(f"{path}/depth")
    if keep_all or not depth:
        return keep_all, None
    return False, _number("depth", depth, _MAX_DEPTH) or None


def _choice(element: Element, path: str, choices: dict[str, bool], *, default: bool) -> bool:
    text = element.find(path)
    if text is None:
        return default
    if text not in choices:
        raise RemoteProtocolError(f"XML {path} is {text[:40]!r}: one of {', '.join(choices)} is needed")
    return choices[text]


def _number(name: str, text: str, largest: int) -> int:
    if not (text.isascii() and text.isdigit() and len(text) <= 10 and int(text) <= largest):
        raise RemoteProtocolError(f"XML {name} is {text[:40]!r}: a number from 0 to {largest} is needed")
    return int(text)


def _further(element: Element) -> FurtherQos:
    return tuple(sorted((path, text) for path, text in element.leaves() if path not in _HONOURED))
