"""What the database knows about a robot, as a blueprint: as it was applied, or with the changes made by hand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, select

from msbot.config import (
    SHIPPED,
    Binding,
    Blueprint,
    BridgeTable,
    InDds,
    Options,
    RobotProfile,
    RosOptions,
    Scalar,
    Slot,
    SlotPort,
    Timing,
    preset_of,
)
from msbot.part.join.pnp_messages import SAFE_MARK
from msbot.registry.configurations import ORIGINS
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
from msbot_xrce.errors import RegistryError


def read(connection: Connection, robot_id: int, *, by_hand: bool) -> Blueprint:
    """The robot's blueprint.

    Args:
        connection: an open connection.
        robot_id: the robot.
        by_hand: include what people set by hand; otherwise as the blueprint was applied.

    Raises:
        RegistryError: there is no such robot.
    """
    row = connection.execute(select(robots).where(robots.c.id == robot_id)).one_or_none()
    if row is None:
        raise RegistryError(f"there is no robot number {robot_id} in the database")
    timing = Timing("thesis", row.beat_period_s, row.tick_period_s, row.life, row.profile_period_s)
    timing = Timing(preset_of(timing), row.beat_period_s, row.tick_period_s, row.life, row.profile_period_s)
    return Blueprint(
        RobotProfile(
            row.name, row.version, row.serial_number, row.released, row.manufacturer, row.in_dds.get(STOP_GROUP, "")
        ),
        _slots(connection, robot_id, by_hand=by_hand),
        _in_dds(_bindings(connection, robot_id, by_hand=by_hand), row.in_dds),
        timing,
        Options(row.explain, tuple(row.free_topics), row.authentication),
        _own_library(connection, robot_id, row.in_dds.get(WRITTEN_LIBRARY, ())),
        ros=_ros_options(row.in_dds.get(ROBOT, {})),
        bridges=tuple(
            BridgeTable(one["world"], one["link"], one["options"], tuple(one["simulate"]))
            for one in row.in_dds.get(BRIDGES, ())
        ),
    )


def _own_library(connection: Connection, robot_id: int, written: Sequence[str]) -> tuple[str, ...]:
    """Where part types come from that are not MsBOT's own: what the blueprint names (`written`), then other folders,
    or files beside it, from which its slots have their types."""
    query = (
        select(library.c.source)
        .join(slots, slots.c.part_number == library.c.number)
        .where(slots.c.robot_id == robot_id, slots.c.in_blueprint, library.c.source.endswith(".toml"))
        .where(library.c.source.not_like(f"{SHIPPED}%"))
        .distinct()
    )
    places = [Path(source) for source in connection.execute(query).scalars()]
    found = sorted({str(place.parent if place.parent.name else place) for place in places})
    # A folder that the blueprint names is found by its path from where the command ran.
    ends = [Path(one).parts for one in written]
    others = [one for one in found if not any(Path(one).parts[-len(end) :] == end for end in ends if end)]
    return (*written, *others)


def _ros_options(entry: Mapping[str, Any]) -> RosOptions:
    return RosOptions(**{**entry, "global_topics": tuple(entry.get("global_topics", ()))})


def _in_dds(found: tuple[Binding, ...], by_topic: Mapping[str, dict[str, Any]]) -> tuple[Binding, ...]:
    """The bindings with what the blueprint says about topics in DDS; nobody can change that by hand."""

    def read(entry: dict[str, Any]) -> InDds:
        return InDds(**{**entry, "ros_fields": tuple((ours, theirs) for ours, theirs in entry["ros_fields"])})

    return tuple(
        replace(binding, in_dds=read(by_topic[binding.topic])) if binding.topic in by_topic else binding
        for binding in found
    )


def read_notes(connection: Connection, robot_id: int) -> dict[tuple[str, str], str]:
    """What was set or made by hand, and by whom."""
    query = (
        select(slots.c.name.label("slot"), settings.c.name, settings.c.who)
        .join(slots, settings.c.slot_id == slots.c.id)
        .where(slots.c.robot_id == robot_id, settings.c.origin == "hand")
    )
    notes = {(row.slot, row.name): f"set by hand by {row.who or 'somebody'}" for row in connection.execute(query)}
    made = select(bindings.c.topic).where(bindings.c.robot_id == robot_id, bindings.c.origin == "hand")
    taken = select(bindings.c.topic).where(bindings.c.robot_id == robot_id, bindings.c.in_use.is_(False))
    topics = {*connection.execute(made).scalars(), *connection.execute(taken).scalars()}
    slots_made = select(slots.c.name).where(
        slots.c.robot_id == robot_id, slots.c.in_blueprint, slots.c.origin == "hand"
    )
    made_slots = {("", name): "made by hand" for name in connection.execute(slots_made).scalars()}
    return notes | {(topic, ""): "changed by hand" for topic in topics} | made_slots


def _slots(connection: Connection, robot_id: int, *, by_hand: bool) -> tuple[Slot, ...]:
    origins = ORIGINS[1:] if by_hand else ORIGINS[1:2]
    mine = select(slots).where(slots.c.robot_id == robot_id, slots.c.in_blueprint).order_by(slots.c.position)
    found = connection.execute(mine if by_hand else mine.where(slots.c.origin == "blueprint")).all()
    values: dict[int, dict[str, Scalar]] = {row.id: {} for row in found}
    safe: dict[int, dict[str, dict[str, Scalar]]] = {row.id: {} for row in found}
    query = (
        select(settings)
        .join(slots, settings.c.slot_id == slots.c.id)
        .where(slots.c.robot_id == robot_id, slots.c.in_blueprint, settings.c.origin.in_(origins))
        .order_by(settings.c.name)
    )
    rows = sorted(connection.execute(query).all(), key=lambda row: ORIGINS.index(row.origin))
    for row in rows:
        port, is_safe, field = row.name.partition(SAFE_MARK)
        if row.slot_id not in values:
            continue
        if is_safe:
            safe[row.slot_id].setdefault(port, {})[field] = row.value
        else:
            values[row.slot_id][row.name] = row.value
    return tuple(
        Slot(row.name, row.part_number, row.local_name, row.description, values[row.id], safe[row.id]) for row in found
    )


def _bindings(connection: Connection, robot_id: int, *, by_hand: bool) -> tuple[Binding, ...]:
    """One binding for each sender of a topic; for a topic without a sender, the source has no name."""
    held = bindings.c.in_use if by_hand else bindings.c.origin == "blueprint"
    query = (
        select(bindings, slots.c.name.label("slot"))
        .join(slots, bindings.c.slot_id == slots.c.id)
        .where(bindings.c.robot_id == robot_id, held, slots.c.in_blueprint)
        .order_by(bindings.c.id)
    )
    topics: dict[str, tuple[str, bool, list[SlotPort], list[SlotPort]]] = {}
    for row in connection.execute(query):
        _, _, sources, targets = topics.setdefault(row.topic, (row.type_name, row.reliable, [], []))
        (sources if row.publishes else targets).append(SlotPort(row.slot, row.port))
    return tuple(
        Binding(topic, type_name, source, tuple(targets), reliable)
        for topic, (type_name, reliable, sources, targets) in topics.items()
        for source in sources or [SlotPort("", "")]
    )


def read_bindings(connection: Connection, robot_id: int) -> tuple[Binding, ...]:
    """The wires in use."""
    return _bindings(connection, robot_id, by_hand=True)
