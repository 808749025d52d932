"""Wires made and removed by hand: topics between ports, checked like those of a blueprint.

A wire that the blueprint asks for and a person removes stays in the table, marked as not in use, so that the next start
of the master does not bring it back. A wire that a person makes stays until the blueprint says otherwise.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import astuple, replace
from typing import Any, Self

from sqlalchemy import ColumnElement, Connection, delete, insert, select, update

from msbot.config import Direction, Library, PartType, Port, Slot, SlotPort, binding_faults
from msbot.registry.blueprint.blueprint_reader import read_bindings
from msbot.registry.database.statements import bump_versions
from msbot.registry.database.tables import bindings, library, slots
from msbot.registry.edits.edit_log import Author, record
from msbot.registry.edits.slot_values import find_slot, read_parameters
from msbot.registry.records import EditKind, EditRecord
from msbot_agent.text.sentence import said
from msbot_agent.text.similar_names import instead_of
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass


class NothingToChange(ConfigError):
    """What somebody asks for is so already; the text says it."""


@dataclass(frozen=True, slots=True)
class WireEnd:
    """One port that is, or was, bound to a topic."""

    slot: str
    port: str
    type_name: str
    publishes: bool
    reliable: bool
    origin: str
    """`blueprint` or `hand`."""
    in_use: bool

    @property
    def at(self) -> tuple[str, str, bool]:
        """Slot, port and direction: what identifies the end."""
        return (self.slot, self.port, self.publishes)

    @property
    def endpoint(self) -> SlotPort:
        """The port."""
        return SlotPort(self.slot, self.port)


@dataclass(frozen=True, slots=True)
class UndoableTopic:
    """The ends of a topic, including those that are not in use."""

    topic: str
    ends: tuple[WireEnd, ...] = ()

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> Self:
        """The cell from the result of `as_json`, even of an older MsBOT: each end is a list of the seven fields."""
        return cls(str(content["topic"]), tuple(WireEnd(*end) for end in content["ends"]))

    def as_json(self) -> dict[str, object]:
        """See `UndoableChange.as_json`."""
        return {"of": "bind", "topic": self.topic, "ends": [list(astuple(end)) for end in self.ends]}

    def as_it_is(self, connection: Connection, robot_id: int) -> Self:
        """See `UndoableChange.as_it_is`."""
        query = (
            select(bindings, slots.c.name)
            .join(slots, bindings.c.slot_id == slots.c.id)
            .where(bindings.c.robot_id == robot_id, bindings.c.topic == self.topic)
        )
        ends = (
            WireEnd(row.name, row.port, row.type_name, row.publishes, row.reliable, row.origin, row.in_use)
            for row in connection.execute(query.order_by(bindings.c.id))
        )
        return replace(self, ends=tuple(ends))

    def write(self, connection: Connection, author: Author) -> None:
        """See `UndoableChange.write`."""
        robot_id, old = author.robot, self.as_it_is(connection, author.robot).ends
        here = (bindings.c.robot_id == robot_id, bindings.c.topic == self.topic)
        kept, known = {end.at for end in self.ends}, {end.at for end in old}
        # Rows that stay keep their place: wires are in the order of the blueprint, then in the order they were made.
        for end in old:
            if end.at not in kept:
                connection.execute(delete(bindings).where(*here, *_is_at(connection, robot_id, end)))
        for end in self.ends:
            values = {"type_name": end.type_name, "reliable": end.reliable, "origin": end.origin, "in_use": end.in_use}
            if end.at in known:
                connection.execute(update(bindings).where(*here, *_is_at(connection, robot_id, end)).values(values))
            else:
                slot_id, _ = find_slot(connection, robot_id, end.slot)
                key = {"slot_id": slot_id, "port": end.port, "publishes": end.publishes}
                row = {"robot_id": robot_id, "topic": self.topic, **key, **values}
                connection.execute(insert(bindings).values(row))
        changed = {end.slot for end in (*old, *self.ends) if end not in old or end not in self.ends}
        bump_versions(connection, robot_id, sorted(changed))


@dataclass(frozen=True, slots=True)
class UndoableTopics:
    """Several topics that one change concerns: a wire was moved from one to another."""

    topics: tuple[UndoableTopic, ...]

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> Self:
        """The cell from the result of `as_json`."""
        return cls(tuple(UndoableTopic.from_json(topic) for topic in content["topics"]))

    def as_json(self) -> dict[str, object]:
        """See `UndoableChange.as_json`."""
        return {"of": "binds", "topics": [topic.as_json() for topic in self.topics]}

    def as_it_is(self, connection: Connection, robot_id: int) -> Self:
        """See `UndoableChange.as_it_is`."""
        return replace(self, topics=tuple(topic.as_it_is(connection, robot_id) for topic in self.topics))

    def write(self, connection: Connection, author: Author) -> None:
        """See `UndoableChange.write`."""
        for topic in self.topics:
            topic.write(connection, author)


def _is_at(connection: Connection, robot_id: int, end: WireEnd) -> tuple[ColumnElement[bool], ...]:
    slot_id, _ = find_slot(connection, robot_id, end.slot)
    return (bindings.c.slot_id == slot_id, bindings.c.port == end.port, bindings.c.publishes == end.publishes)


def bind(
    connection: Connection,
    author: Author,
    topic: str,
    *,
    type_name: str,
    source: SlotPort | None,
    targets: Sequence[SlotPort] = (),
    reliable: bool = True,
    move: bool = False,
) -> EditRecord:
    """Connect ports by a topic, in addition to those it already connects; all its ports then have this reliability.

    With `move`, the targets leave the topics that they hear so far.

    Without a type, it is that of the topic, or of the first port that the library knows.

    Raises:
        NothingToChange: it is so already.
        ConfigError: a port does not exist, has another direction or type, or is bound to another topic.
    """
    wanted = [] if source is None else [(source, True)]
    wanted += [(target, False) for target in targets]
    if not wanted:
        raise ConfigError(
            said("topic {topic!r}: name a port that publishes it or one that subscribes, as SLOT.port", topic=topic)
        )
    moved = set(targets) if move else set()
    left = _other_topics(connection, author.robot, topic, moved)
    for cell in left:
        gone = [end for end in cell.ends if end.endpoint in moved and not end.publishes]
        replace(cell, ends=_without(cell.ends, gone)).write(connection, author)
    before = UndoableTopic(topic).as_it_is(connection, author.robot)
    type_name = type_name or _type_of(connection, author.robot, before, [port for port, _ in wanted])
    ends = {end.at: replace(end, reliable=reliable) for end in before.ends}
    for port, publishes in wanted:
        new = WireEnd(port.slot, port.port, type_name, publishes, reliable, "hand", in_use=True)
        old = ends.get(new.at)
        ends[new.at] = new if old is None else replace(old, type_name=type_name, in_use=True)
    if not left and tuple(ends.values()) == before.ends:
        raise NothingToChange(said("topic {topic} joins these ports already", topic=topic))
    UndoableTopic(topic, tuple(ends.values())).write(connection, author)
    _check(connection, author.robot, topic)
    return _bound(
        connection,
        author,
        UndoableTopics((before, *left)) if left else before,
        said("topic {topic} joins {value}", topic=topic, value=", ".join((str(port) for port, _ in wanted))),
    )


def _type_of(connection: Connection, robot_id: int, topic: UndoableTopic, ports: Sequence[SlotPort]) -> str:
    """The type that a topic has, or gets from one of these ports."""
    if used := next((end.type_name for end in topic.ends if end.in_use), ""):
        return used
    numbers = {slot.name: slot.part_number for slot in read_slots(connection, robot_id)}
    known = read_library(connection, robot_id)
    for end in ports:
        part_type = known.get(numbers.get(end.slot, ""))
        port = None if part_type is None else part_type.port(end.port)
        if port is not None:
            return port.type_name
    raise ConfigError(
        said(
            "topic {topic!r}: the library does not know {port}: name the type, --type", topic=topic.topic, port=ports[0]
        )
    )


def unbind(connection: Connection, author: Author, topic: str, endpoint: SlotPort | None) -> EditRecord:
    """Unbind a port from a topic, or all its ports.

    Raises:
        ConfigError: there is no such topic, or the port is not bound to it.
    """
    before = UndoableTopic(topic).as_it_is(connection, author.robot)
    bound = [end for end in before.ends if end.in_use]
    gone = [end for end in bound if endpoint in (None, end.endpoint)]
    if not bound:
        query = select(bindings.c.topic).where(bindings.c.robot_id == author.robot, bindings.c.in_use).distinct()
        known = sorted(connection.execute(query).scalars())
        raise ConfigError(
            said(
                "no port is bound to topic {topic!r}; {hint}",
                topic=topic,
                hint=instead_of(topic, known),
            )
        )
    if not gone:
        names = sorted({str(end.endpoint) for end in bound})
        raise ConfigError(
            said(
                "{endpoint} is not bound to topic {topic!r}; {names} are",
                endpoint=endpoint,
                topic=topic,
                names=", ".join(names),
            )
        )
    UndoableTopic(topic, _without(before.ends, gone)).write(connection, author)
    words = (
        said("topic {topic} is taken away", topic=topic)
        if endpoint is None
        else said("{endpoint} is taken off topic {topic}", endpoint=endpoint, topic=topic)
    )
    return _bound(connection, author, before, words)


def _other_topics(
    connection: Connection, robot_id: int, topic: str, heard_by: Collection[SlotPort]
) -> tuple[UndoableTopic, ...]:
    """The other topics that one of these ports hears."""
    here = select(bindings.c.topic).where(bindings.c.robot_id == robot_id, bindings.c.in_use, ~bindings.c.publishes)
    names = connection.execute(here.where(bindings.c.topic != topic).distinct()).scalars().all() if heard_by else ()
    cells = (UndoableTopic(name).as_it_is(connection, robot_id) for name in sorted(names))
    return tuple(
        cell
        for cell in cells
        if any(end.in_use and not end.publishes and end.endpoint in heard_by for end in cell.ends)
    )


def _without(ends: Sequence[WireEnd], gone: Sequence[WireEnd]) -> tuple[WireEnd, ...]:
    """The ends that stay; of what the blueprint asks for it is remembered that it is not in use, so that the master's
    next start does not bring it back."""
    left = (replace(end, in_use=end.in_use and end not in gone) for end in ends)
    return tuple(end for end in left if end.in_use or end.origin == "blueprint")


def _bound(connection: Connection, author: Author, before: UndoableTopic | UndoableTopics, words: str) -> EditRecord:
    after = before.as_it_is(connection, author.robot)
    return record(connection, author, EditKind.BIND, words, before=before, after=after)


def read_slots(connection: Connection, robot_id: int) -> tuple[Slot, ...]:
    """The slots of the blueprint, without their settings."""
    query = select(slots).where(slots.c.robot_id == robot_id, slots.c.in_blueprint).order_by(slots.c.position)
    return tuple(Slot(row.name, row.part_number, row.local_name, row.description) for row in connection.execute(query))


def read_library(connection: Connection, robot_id: int) -> Library:
    """The part types that the robot's slots ask for, with what wires and settings need of them."""
    numbers = select(slots.c.part_number).where(slots.c.robot_id == robot_id, slots.c.in_blueprint)
    query = select(library.c.number, library.c.name, library.c.ports).where(library.c.number.in_(numbers))
    return Library(
        PartType(
            row.number,
            row.name,
            ports=tuple(
                Port(port["name"], Direction(port["direction"]), port["type"], port["rate_hz"]) for port in row.ports
            ),
            parameters=read_parameters(connection, row.number),
        )
        for row in connection.execute(query).all()
    )


def _check(connection: Connection, robot_id: int, topic: str) -> None:
    """Check that all wires obey the rules of a blueprint, as they did before this topic was changed."""
    types = set(
        connection.execute(
            select(bindings.c.type_name).where(
                bindings.c.robot_id == robot_id, bindings.c.topic == topic, bindings.c.in_use
            )
        ).scalars()
    )
    if len(types) > 1:
        raise ConfigError(
            said(
                'topic "{topic}" carries "{min}" and "{max}": a topic has one type',
                topic=topic,
                min=min(types),
                max=max(types),
            )
        )
    faults = binding_faults(
        read_bindings(connection, robot_id), read_slots(connection, robot_id), read_library(connection, robot_id)
    )
    if faults:
        raise ConfigError(said('topic "{topic}": {faults}', topic=topic, faults=faults[0]))
