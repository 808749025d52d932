"""The statements that bring a robot's tables in line with its blueprint, and leave everything else alone.

Slots keep their number, settings made by hand and memory of parts; a slot that is taken out of the blueprint is
kept aside in case it comes back. Slots and wires that people have made stay. A slot's configuration gets a new
version only when it has changed.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict

from sqlalchemy import ColumnElement, Connection, delete, insert, select, update

from msbot.config import (
    SHIPPED,
    Blueprint,
    Difference,
    InDds,
    Library,
    Parameter,
    PartType,
    Port,
    RosOptions,
    Scalar,
    Slot,
)
from msbot.part.join.pnp_messages import safe_setting
from msbot.registry.configurations import read_configurations
from msbot.registry.database.statements import bump_versions, find_robot, upsert, upsert_many
from msbot.registry.database.tables import (
    BRIDGES,
    ROBOT,
    STOP_GROUP,
    WRITTEN_LIBRARY,
    bindings,
    library,
    robots,
    settings,
    slots,
)
from msbot.registry.records import RobotRecord


def apply(
    connection: Connection, blueprint: Blueprint, part_types: Library, now_ns: int, *, slot_by_hand: str = ""
) -> RobotRecord:
    """Store or update a robot, its slots, bindings and settings, and the library.

    Args:
        connection: an open connection.
        blueprint: what the robot is from now on, besides the slots and wires that people have made.
        part_types: what it was checked against.
        now_ns: the time, nanoseconds since 1970.
        slot_by_hand: the slot that a person makes, if the blueprint has it, or takes out, if it has not.
    """
    robot = _put_robot(connection, blueprint, now_ns)
    before = read_configurations(connection, robot.id)
    _put_library(connection, part_types)
    kept = _slots_by_hand(connection, robot.id, {slot_by_hand, *(slot.name for slot in blueprint.slots)})
    in_force = (*blueprint.slots, *kept)
    slot_ids = _put_slots(connection, robot.id, in_force, by_hand={slot_by_hand, *(slot.name for slot in kept)})
    _put_settings(connection, robot.id, slot_ids, in_force, part_types, now_ns=now_ns)
    _put_bindings(connection, robot.id, slot_ids, blueprint)
    after = read_configurations(connection, robot.id)
    changed = [name for name, old in before.items() if name in after and after[name] != old]
    bump_versions(connection, robot.id, changed)
    return robot


def _put_robot(connection: Connection, blueprint: Blueprint, now_ns: int) -> RobotRecord:
    profile, timing = blueprint.robot, blueprint.timing
    key = {"name": profile.name, "serial_number": profile.serial_number}
    values = {
        "version": profile.version,
        "released": profile.released,
        "manufacturer": profile.manufacturer,
        "beat_period_s": timing.beat_period_s,
        "tick_period_s": timing.tick_period_s,
        "life": timing.life,
        "profile_period_s": timing.profile_period_s,
        "explain": blueprint.options.explain,
        "free_topics": list(blueprint.options.free_topics),
        "authentication": blueprint.options.authentication,
        "in_dds": {
            **({} if blueprint.ros == RosOptions() else {ROBOT: asdict(blueprint.ros)}),
            **({STOP_GROUP: profile.stop_group} if profile.stop_group else {}),
            **({BRIDGES: [asdict(one) for one in blueprint.bridges]} if blueprint.bridges else {}),
            **({WRITTEN_LIBRARY: list(blueprint.library)} if blueprint.library else {}),
            **{binding.topic: asdict(binding.in_dds) for binding in blueprint.bindings if binding.in_dds != InDds()},
        },
        "applied_ns": now_ns,
    }
    upsert(connection, robots, key, values)
    robot = find_robot(connection, profile.name, profile.serial_number)
    assert robot is not None
    return robot


def _slots_by_hand(connection: Connection, robot_id: int, besides: Collection[str]) -> tuple[Slot, ...]:
    """The slots that people have made, besides those with these names; what is set of them, is set by hand."""
    mine = select(slots).where(slots.c.robot_id == robot_id, slots.c.in_blueprint, slots.c.origin == "hand")
    rows = connection.execute(mine.order_by(slots.c.position)).all()
    return tuple(
        Slot(row.name, row.part_number, row.local_name, row.description) for row in rows if row.name not in besides
    )


def _put_slots(
    connection: Connection, robot_id: int, in_force: Sequence[Slot], by_hand: Collection[str]
) -> dict[str, int]:
    """Returns the number of each slot that is in force, by name."""
    connection.execute(update(slots).where(slots.c.robot_id == robot_id).values(in_blueprint=False))
    rows = [
        {
            "robot_id": robot_id,
            "name": slot.name,
            "position": position,
            "part_number": slot.part_number,
            "local_name": slot.local_name,
            "description": slot.description,
            "in_blueprint": True,
            "origin": "hand" if slot.name in by_hand else "blueprint",
            "configuration_version": 1,
        }
        for position, slot in enumerate(in_force)
    ]
    upsert_many(connection, slots, ("robot_id", "name"), rows, first="configuration_version")
    query = select(slots.c.name, slots.c.id).where(slots.c.robot_id == robot_id, slots.c.in_blueprint)
    return {row.name: row.id for row in connection.execute(query)}


def _put_settings(
    connection: Connection,
    robot_id: int,
    slot_ids: Mapping[str, int],
    in_force: Sequence[Slot],
    part_types: Library,
    *,
    now_ns: int,
) -> None:
    """Write what differs; a value set by hand stays as long as the part type accepts it."""
    query = select(settings).join(slots, settings.c.slot_id == slots.c.id)
    rows_there = connection.execute(query.where(slots.c.robot_id == robot_id, slots.c.in_blueprint))
    present: dict[_Setting, Scalar] = {(row.slot_id, row.name, row.origin): row.value for row in rows_there}
    wanted: dict[_Setting, Scalar] = {}
    parameters: dict[tuple[int, str], Parameter] = {}
    for slot in in_force:
        slot_id, part_type = slot_ids[slot.name], part_types.get(slot.part_number)
        for parameter in () if part_type is None else part_type.parameters:
            wanted[slot_id, parameter.name, "library"] = parameter.default
            parameters[slot_id, parameter.name] = parameter
        stated = {
            safe_setting(port, field): value for port, values in slot.safe.items() for field, value in values.items()
        }
        wanted |= {(slot_id, name, "blueprint"): value for name, value in {**slot.settings, **stated}.items()}
    for setting in present.keys() - wanted.keys():
        known = parameters.get(setting[:2])
        if setting[2] != "hand" or known is None or known.fault(present[setting]) is not None:
            connection.execute(delete(settings).where(*_is(setting)))
    rows = [
        {"slot_id": slot_id, "name": name, "origin": origin, "value": value, "changed_ns": now_ns}
        for (slot_id, name, origin), value in wanted.items()
        if not _same(present.get((slot_id, name, origin)), value)
    ]
    upsert_many(connection, settings, ("slot_id", "name", "origin"), rows)


_Setting = tuple[int, str, str]
"""Slot, parameter, origin."""


def _is(setting: _Setting) -> tuple[ColumnElement[bool], ...]:
    return (settings.c.slot_id == setting[0], settings.c.name == setting[1], settings.c.origin == setting[2])


def _same(old: Scalar | None, new: Scalar) -> bool:
    """Whether a value is the same and of the same kind: 1 is not True."""
    return old == new and isinstance(old, bool) == isinstance(new, bool)


def _put_bindings(connection: Connection, robot_id: int, slot_ids: Mapping[str, int], blueprint: Blueprint) -> None:
    """Write the blueprint's wires; wires removed by hand stay removed, wires made by hand stay if possible."""
    wanted: dict[_End, dict[str, object]] = {}
    for binding in blueprint.bindings:
        for endpoint in binding.ends:
            # Several senders of one topic may name the same receiver.
            publishes = endpoint is binding.source
            wanted[slot_ids[endpoint.slot], endpoint.port, binding.topic, publishes] = {
                "robot_id": robot_id,
                "topic": binding.topic,
                "type_name": binding.type_name,
                "slot_id": slot_ids[endpoint.slot],
                "port": endpoint.port,
                "publishes": publishes,
                "reliable": binding.reliable,
                "origin": "blueprint",
                "in_use": True,
            }
    here = select(bindings).where(bindings.c.robot_id == robot_id).order_by(bindings.c.id)
    others: list[Mapping[str, object]] = []
    for row in connection.execute(here).all():
        end = (row.slot_id, row.port, row.topic, row.publishes)
        if end in wanted:
            wanted[end]["in_use"] = row.in_use
        elif row.origin == "hand" and row.slot_id in slot_ids.values():
            others.append(row._asdict())
    held = [one for one in wanted.values() if one["in_use"]]
    by_hand = [
        {name: value for name, value in row.items() if name != "id"} for row in others if not _contradicts(row, held)
    ]
    connection.execute(delete(bindings).where(bindings.c.robot_id == robot_id))
    if wanted or by_hand:
        connection.execute(insert(bindings), [*wanted.values(), *by_hand])


_End = tuple[int, str, str, bool]
"""Slot, port, topic, whether it publishes: what identifies a row of `bindings`."""


def _contradicts(row: Mapping[str, object], held: Sequence[Mapping[str, object]]) -> bool:
    """Whether the blueprint has the topic with another type or reliability, or the port on another topic.

    Only what is in use of it counts: a wire that was moved by hand has taken the place of the blueprint's own.
    """
    return any(
        (other["topic"] == row["topic"] and any(other[key] != row[key] for key in ("type_name", "reliable")))
        or (other["slot_id"] == row["slot_id"] and other["port"] == row["port"])
        for other in held
    )


def _put_library(connection: Connection, part_types: Library) -> None:
    """Write the types that are new or changed; delete those that are gone and that no other robot's slots need."""
    present = {row.number: row.digest for row in connection.execute(select(library.c.number, library.c.digest))}
    rows = [_library_row(part_type) for part_type in part_types]
    changed = [row for row in rows if present.pop(str(row["number"]), None) != row["digest"]]
    upsert_many(connection, library, ("number",), changed)
    in_use = set(connection.execute(select(slots.c.part_number).distinct()).scalars())
    for number in present.keys() - in_use:
        connection.execute(delete(library).where(library.c.number == number))


def type_differences(connection: Connection, part_types: Library) -> tuple[Difference, ...]:
    """What `apply` would change of part types, besides those that MsBOT brings; it does not matter where files are."""
    present = {row.number: row._asdict() for row in connection.execute(select(library))}
    found = []
    for row in (_library_row(one) for one in part_types if not one.source.startswith(SHIPPED)):
        where, name = f"part type {row['number']}", str(row["name"])
        before = present.get(str(row["number"]))
        if before is None:
            found.append(Difference("added", where, "", name))
        elif any(before[column] != value for column, value in row.items() if column not in ("source", "digest")):
            found.append(Difference("changed", where, f"{before['name']}, as it was", f"{name}, as its file says now"))
    return tuple(found)


def _library_row(part_type: PartType) -> dict[str, object]:
    row: dict[str, object] = {
        "number": part_type.number,
        "name": part_type.name,
        "manufacturer": part_type.manufacturer,
        "description": part_type.description,
        "specification": part_type.specification,
        "resolution": part_type.resolution,
        "compatible_with": list(part_type.compatible_with),
        "ports": [_port(port) for port in part_type.ports],
        "parameters": [_parameter(parameter) for parameter in part_type.parameters],
        "source": part_type.source,
        "versions": str(part_type.versions),
    }
    row["digest"] = hashlib.sha256(json.dumps(row, sort_keys=True).encode()).hexdigest()
    return row


def _port(port: Port) -> dict[str, object]:
    return {
        "name": port.name,
        "direction": port.direction.value,
        "type": port.type_name,
        "rate_hz": port.rate_hz,
        "safe": None if port.safe is None else dict(port.safe),
    }


def _parameter(parameter: Parameter) -> dict[str, object]:
    return {
        "name": parameter.name,
        "type": parameter.kind.value,
        "default": parameter.default,
        "unit": parameter.unit,
        "min": parameter.least,
        "max": parameter.most,
        "description": parameter.description,
    }
