"""Wires made and taken away by hand: topics between ports, checked like those of a blueprint.

A wire that the blueprint asks for and a person takes away stays in the table, not in use, so that the next start of
the master does not bring it back. A wire that a person makes stays until the blueprint says otherwise.
"""

from __future__ import annotations

from collections.abc import Sequence

from sqlalchemy import ColumnElement, Connection, delete, insert, select, update

from msbot.config import Direction, Endpoint, Library, PartType, Port, Slot, binding_faults
from msbot.errors import ConfigError
from msbot.registry.blueprint_reader import read_bindings
from msbot.registry.store import bump_versions
from msbot.registry.tables import bindings, library, slots
from msbot.registry.values import find_slot, read_parameters

End = list[object]
"""A row of `bindings` about one topic, as an edit keeps it: slot, port, type, publishes, reliable, origin, in use."""


def read_topic(connection: Connection, robot_id: int, topic: str) -> list[End]:
    """All ends of a topic, also those not in use."""
    query = (
        select(bindings, slots.c.name)
        .join(slots, bindings.c.slot_id == slots.c.id)
        .where(bindings.c.robot_id == robot_id, bindings.c.topic == topic)
    )
    return [
        [row.name, row.port, row.type_name, row.publishes, row.reliable, row.origin, row.in_use]
        for row in connection.execute(query.order_by(bindings.c.id))
    ]


def write_topic(connection: Connection, robot_id: int, topic: str, ends: Sequence[End]) -> list[str]:
    """Put the ends of a topic in place of those it has; gives the slots whose configuration that changes.

    Raises:
        ConfigError: a slot is no more.
    """
    before = read_topic(connection, robot_id, topic)
    here = (bindings.c.robot_id == robot_id, bindings.c.topic == topic)
    kept = [_place_of(end) for end in ends]
    # Rows that stay keep their place: the order of wires is that of the blueprint, then that in which they were made.
    for end in before:
        if _place_of(end) not in kept:
            connection.execute(delete(bindings).where(*here, *_is_at(connection, robot_id, end)))
    for end in ends:
        values = dict(zip(_CHANGING, (end[2], *end[4:]), strict=True))
        if _place_of(end) in map(_place_of, before):
            connection.execute(update(bindings).where(*here, *_is_at(connection, robot_id, end)).values(values))
        else:
            slot_id, _ = find_slot(connection, robot_id, str(end[0]))
            key = {"robot_id": robot_id, "topic": topic, "slot_id": slot_id, "port": end[1], "publishes": end[3]}
            connection.execute(insert(bindings).values({**key, **values}))
    changed = sorted({str(end[0]) for end in (*before, *ends) if end not in before or end not in ends})
    bump_versions(connection, robot_id, changed)
    return changed


_CHANGING = ("type_name", "reliable", "origin", "in_use")


def _place_of(end: End) -> End:
    """Slot, port and direction: what makes it the same end."""
    return [end[0], end[1], end[3]]


def _is_at(connection: Connection, robot_id: int, end: End) -> tuple[ColumnElement[bool], ...]:
    slot_id, _ = find_slot(connection, robot_id, str(end[0]))
    return (bindings.c.slot_id == slot_id, bindings.c.port == end[1], bindings.c.publishes == end[3])


def join(
    connection: Connection,
    robot_id: int,
    topic: str,
    *,
    type_name: str,
    source: Endpoint | None,
    targets: Sequence[Endpoint],
    reliable: bool,
) -> list[str]:
    """Let a port publish a topic and others subscribe to it, besides those that do; gives the slots it changes.

    Raises:
        ConfigError: a port does not exist, has another direction or type, or is bound to another topic.
    """
    wanted = [] if source is None else [(source, True)]
    wanted += [(target, False) for target in targets]
    if not wanted:
        raise ConfigError(f"topic {topic!r}: name a port that publishes it or one that subscribes, as SLOT.port")
    ends = [[*end[:4], reliable, *end[5:]] for end in read_topic(connection, robot_id, topic)]
    for endpoint, publishes in wanted:
        find_slot(connection, robot_id, endpoint.slot)
        place = [endpoint.slot, endpoint.port]
        old = next((end for end in ends if end[:2] == place and end[3] == publishes), None)
        if old is None:
            ends.append([*place, type_name, publishes, reliable, "hand", True])
        else:
            old[2], old[6] = type_name, True
    changed = write_topic(connection, robot_id, topic, ends)
    _check(connection, robot_id, topic)
    return changed


def part_ends(connection: Connection, robot_id: int, topic: str, endpoint: Endpoint | None) -> list[str]:
    """Take a port off a topic, or all ports; gives the slots it changes.

    Raises:
        ConfigError: there is no such topic, or the port is not bound to it.
    """
    ends = read_topic(connection, robot_id, topic)
    here = [end for end in ends if end[6] and (endpoint is None or end[:2] == [endpoint.slot, endpoint.port])]
    if not here:
        bound = sorted({f"{end[0]}.{end[1]}" for end in ends if end[6]})
        if not bound:
            query = select(bindings.c.topic).where(bindings.c.robot_id == robot_id, bindings.c.in_use).distinct()
            known = sorted(connection.execute(query).scalars())
            raise ConfigError(f"no port is bound to topic {topic!r}; topics: {', '.join(known) or 'none'}")
        raise ConfigError(f"{endpoint} is not bound to topic {topic!r}; {', '.join(bound)} are")
    left = [[*end[:6], end[6] and end not in here] for end in ends]
    return write_topic(connection, robot_id, topic, [end for end in left if end[6] or end[5] == "blueprint"])


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
            ports=tuple(Port(port["name"], Direction(port["direction"]), port["type"]) for port in row.ports),
            parameters=read_parameters(connection, row.number),
        )
        for row in connection.execute(query).all()
    )


def _check(connection: Connection, robot_id: int, topic: str) -> None:
    """All wires are as a blueprint's must be; they were before this topic was changed."""
    types = set(
        connection.execute(
            select(bindings.c.type_name).where(
                bindings.c.robot_id == robot_id, bindings.c.topic == topic, bindings.c.in_use
            )
        ).scalars()
    )
    if len(types) > 1:
        raise ConfigError(f'topic "{topic}" carries "{min(types)}" and "{max(types)}": a topic has one type')
    faults = binding_faults(
        read_bindings(connection, robot_id), read_slots(connection, robot_id), read_library(connection, robot_id)
    )
    if faults:
        raise ConfigError(f'topic "{topic}": {faults[0]}')
