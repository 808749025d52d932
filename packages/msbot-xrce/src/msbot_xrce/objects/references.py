"""Profiles by name, for clients that create their objects by reference (the file behind `--refs`)."""

from __future__ import annotations

from typing import Self

from msbot_xrce.errors import ConfigError, RemoteProtocolError
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
from msbot_xrce.objects.xml import Element, parse_xml
from msbot_xrce.objects.xml_profiles import TAGS, define, domain_of

MAX_FILE_OCTETS = 4_000_000
MAX_FILE_ELEMENTS = 100_000

DOMAIN_OF_PROFILE = 255
"""Domain id that means: take the domain from the profile of the participant."""

_KINDS = (
    ObjectKind.PARTICIPANT,
    ObjectKind.TOPIC,
    ObjectKind.DATAWRITER,
    ObjectKind.DATAREADER,
    ObjectKind.REQUESTER,
    ObjectKind.REPLIER,
)
"""Kinds that can be created by reference."""


class References:
    """The profiles of one file; never changes."""

    def __init__(self, profiles: dict[tuple[ObjectKind, str], Definition] | None = None) -> None:
        self._profiles = dict(profiles or {})

    def __len__(self) -> int:
        return len(self._profiles)

    @classmethod
    def parse(cls, text: str, source: str) -> Self:
        """Read a profile file in the form of eProsima's agent; `source` names it in error texts.

        Raises:
            ConfigError: it is not XML, or a profile is wrong; the text says where.
        """
        try:
            root = parse_xml(text, max_octets=MAX_FILE_OCTETS, max_elements=MAX_FILE_ELEMENTS)
        except RemoteProtocolError as error:
            raise ConfigError(f"{source}: {error}") from error
        if root.tag == "dds":
            root = root.child("profiles") or root
        if root.tag not in ("profiles", "dds"):
            raise ConfigError(f"{source}, line {root.line}: <{root.tag}> where <profiles> is needed")
        profiles: dict[tuple[ObjectKind, str], Definition] = {}
        for element in root.children:
            kind = next((kind for kind in _KINDS if element.tag in TAGS[kind]), None)
            if kind is None:
                continue
            name = _name_of(element, source)
            if (kind, name) in profiles:
                raise ConfigError(f"{source}, line {element.line}: a second <{element.tag}> profile {name!r}")
            profiles[kind, name] = _definition(kind, element, source)
        return cls(profiles)

    def get(self, kind: ObjectKind, name: str) -> Definition | None:
        """The profile of that kind and name, or None."""
        return self._profiles.get((kind, name))


def resolve(kind: ObjectKind, name: str, domain_id: int, references: References | None) -> Definition:
    """The definition that a reference stands for.

    Without a profile file, a participant may have any name, and a topic, writer or reader may be named after its topic
    (`Name__t`, `Name__dw`, `Name__dr`), as the genuine agent's in-memory middleware understands it.

    Raises:
        RemoteProtocolError: there is no such profile.
    """
    found = _by_name(kind, name) if references is None else references.get(kind, name)
    if found is None:
        where = "there is no profile file" if references is None else "the profile file has none of that name"
        raise RemoteProtocolError(f"reference {name[:80]!r} to a {kind.name.lower()}: {where}")
    if isinstance(found, ParticipantDef):
        leave = domain_id == DOMAIN_OF_PROFILE and references is not None
        return found if leave else ParticipantDef(domain_id, found.name)
    return found


def _by_name(kind: ObjectKind, name: str) -> Definition | None:
    if kind == ObjectKind.PARTICIPANT:
        return ParticipantDef(0, name)
    suffix = {ObjectKind.TOPIC: "__t", ObjectKind.DATAWRITER: "__dw", ObjectKind.DATAREADER: "__dr"}.get(kind)
    if suffix is None:
        return None
    topic, found, _ = name.partition(suffix)
    if not topic or not found:
        return None
    if kind == ObjectKind.TOPIC:
        return TopicDef(topic, "")
    make = WriterDef if kind == ObjectKind.DATAWRITER else ReaderDef
    return make(None, topic, None, reliable=True, transient_local=False)


def _name_of(element: Element, source: str) -> str:
    name = element.attributes.get("profile_name")
    if not name:
        raise ConfigError(f"{source}, line {element.line}: <{element.tag}> needs a profile_name")
    return name


def _definition(kind: ObjectKind, element: Element, source: str) -> Definition:
    try:
        domain_id = domain_of(element) if kind == ObjectKind.PARTICIPANT else None
        return define(kind, element, DOMAIN_OF_PROFILE if domain_id is None else domain_id)
    except RemoteProtocolError as error:
        raise ConfigError(f"{source}, line {element.line}: {error}") from error


# Objects described by any text, as the genuine agent accepts them with `-m ced`: the text is the topic's name.


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
