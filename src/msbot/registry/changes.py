"""Each thing a person can change, done and recorded in one transaction."""

from __future__ import annotations

from collections.abc import Sequence

from sqlalchemy import Connection

from msbot.config import Blueprint, Endpoint, Library, Scalar
from msbot.errors import ConfigError
from msbot.registry import blueprint_store, places, snapshot, store, values, wires
from msbot.registry.edits import Author, Cells, read_cells, record, write_cells
from msbot.registry.records import EditRecord, RobotRecord


def set_value(connection: Connection, author: Author, slot: str, name: str, value: Scalar | None) -> EditRecord:
    """Set a parameter of a slot by hand; None takes that back.

    Raises:
        ConfigError: no such slot or parameter, or the value is not allowed.
    """
    old = values.check_value(connection, _robot(author), slot, name, value)
    after: Cells = {"of": "value", "slot": slot, "name": name, "value": value}
    before = read_cells(connection, author, after)
    write_cells(connection, author, after)
    (new,) = [found for found in values.read_values(connection, _robot(author), slot) if found.name == name]
    words = f"{name} of {slot}: {values.value_words(old.value, old.unit)} -> {values.value_words(new.value, new.unit)}"
    if value is None:
        words += f" (the {new.origin}'s)"
    return record(connection, author, "value", words, slot=slot, before=before, after=after)


def place(
    connection: Connection,
    author: Author,
    uid: bytes,
    slot: str | None,
    *,
    words: str,
    by_hand: bool,
    before: dict[bytes, str | None] | None,
) -> EditRecord:
    """Let a part belong in a slot, or in none; others that belonged there belong nowhere.

    Args:
        connection: an open transaction.
        author: who does it.
        uid: the part.
        slot: where it belongs from now on.
        words: what happened, for people; empty: made from the rest.
        by_hand: whether it goes before all rules.
        before: what an undo shall bring back where it differs from what is stored now.

    Raises:
        ConfigError: the part was never seen, has no UID, or there is no such slot.
    """
    robot_id = _robot(author)
    identity = places.check_known(connection, robot_id, uid)
    there = [] if slot is None else places.read_slot(connection, robot_id, slot)
    after: dict[str, places.Place] = {
        **dict.fromkeys(there, places.NOWHERE),
        identity: (slot, slot if by_hand else None),
    }
    name = places.name_of(connection, robot_id, identity)
    words = words or (f"{name} belongs in no slot" if slot is None else f"{name} belongs in slot {slot}")
    return _place(connection, author, after, slot=slot or "", words=words, told=before)


def place_swap(connection: Connection, author: Author, uid: bytes, slot: str, *, other: bytes) -> EditRecord:
    """Let a part belong in a slot, and the one that was there where the first came from.

    Raises:
        ConfigError: a part was never seen, has no UID, or there is no such slot.
    """
    robot_id = _robot(author)
    identity = places.check_known(connection, robot_id, uid)
    came_from = places.read(connection, robot_id, [identity])[identity][0]
    after: dict[str, places.Place] = dict.fromkeys(places.read_slot(connection, robot_id, slot), places.NOWHERE)
    name, whose = places.name_of(connection, robot_id, identity), ""
    if other:
        identity_there = places.check_known(connection, robot_id, other)
        goes_to = None if came_from == slot else came_from
        after[identity_there] = (goes_to, goes_to)
        whose = f" in place of {places.name_of(connection, robot_id, identity_there)}"
    after[identity] = (slot, slot)
    return _place(connection, author, after, slot=slot, words=f"{name} is swapped into slot {slot}{whose}", told=None)


def _place(
    connection: Connection,
    author: Author,
    places_after: dict[str, places.Place],
    *,
    slot: str,
    words: str,
    told: dict[bytes, str | None] | None,
) -> EditRecord:
    after: Cells = {"of": "place", "parts": {uid: list(place) for uid, place in places_after.items()}}
    before = read_cells(connection, author, after)
    if told:
        found = before["parts"]
        assert isinstance(found, dict)
        before = {"of": "place", "parts": {**found, **{uid.hex(): [where, where] for uid, where in told.items()}}}
    write_cells(connection, author, after)
    return record(connection, author, "place", words, slot=slot, before=before, after=after)


def block(connection: Connection, author: Author, kind: str, key: str, reason: str) -> EditRecord:
    """Let a UID or a part number in no more; an empty reason lets it in again.

    Raises:
        ConfigError: it shall be let in again and is not blocked.
    """
    after: Cells = {"of": "block", "kind": kind, "key": key, "reason": reason}
    before = read_cells(connection, author, after)
    what = f"part number {key}" if kind == "number" else f"part with UID {key}"
    if not reason and not before["reason"]:
        raise ConfigError(f"{what} is not blocked")
    write_cells(connection, author, after)
    words = f"{what} is blocked: {reason}" if reason else f"{what} is let in again"
    return record(connection, author, "block", words, before=before, after=after)


def bind(
    connection: Connection,
    author: Author,
    topic: str,
    *,
    type_name: str,
    source: Endpoint | None,
    targets: Sequence[Endpoint],
    reliable: bool,
) -> EditRecord:
    """Join ports by a topic, besides those that are.

    Raises:
        ConfigError: a port does not exist, has another direction or type, or is bound to another topic.
    """
    before = read_cells(connection, author, {"of": "bind", "topic": topic})
    wires.join(
        connection,
        _robot(author),
        topic,
        type_name=type_name,
        source=source,
        targets=targets,
        reliable=reliable,
    )
    ends = [str(end) for end in (source, *targets) if end is not None]
    return _bound(connection, author, topic, before, f"topic {topic} joins {', '.join(ends)}")


def unbind(connection: Connection, author: Author, topic: str, endpoint: Endpoint | None) -> EditRecord:
    """Take a port off a topic, or all ports.

    Raises:
        ConfigError: there is no such topic, or the port is not bound to it.
    """
    before = read_cells(connection, author, {"of": "bind", "topic": topic})
    wires.part_ends(connection, _robot(author), topic, endpoint)
    words = f"topic {topic} is taken away" if endpoint is None else f"{endpoint} is taken off topic {topic}"
    return _bound(connection, author, topic, before, words)


def apply_blueprint(
    connection: Connection, blueprint: Blueprint, library: Library, *, who: str, now_ns: int
) -> RobotRecord:
    """Apply a blueprint; what it changes about a robot that was there is an edit."""
    old = store.find_robot(connection, blueprint.robot.name, blueprint.robot.serial_number)
    before = None if old is None else snapshot.read(connection, old.id)
    robot = blueprint_store.apply(connection, blueprint, library, now_ns)
    if before is not None and before != (after := snapshot.read(connection, robot.id)):
        words = f"the blueprint of {robot.name} is applied: {snapshot.difference_words(before, after)}"
        cells = ({"of": "apply", "robot": before}, {"of": "apply", "robot": after})
        record(connection, Author(robot.id, who, now_ns), "apply", words, before=cells[0], after=cells[1])
    return robot


def _bound(connection: Connection, author: Author, topic: str, before: Cells, words: str) -> EditRecord:
    after = read_cells(connection, author, {"of": "bind", "topic": topic})
    return record(connection, author, "bind", words, before=before, after=after)


def _robot(author: Author) -> int:
    assert author.robot_id is not None
    return author.robot_id
