"""The configurations of all slots at once: bindings, settings in force, safe values."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence

from sqlalchemy import Connection, select

from msbot.config import Scalar, scalar_text
from msbot.part.join.pnp_messages import SAFE_MARK, safe_setting
from msbot.pnp import Configuration, SlotBinding
from msbot.registry.database.tables import bindings, library, settings, slots

ORIGINS = ("library", "blueprint", "hand")
"""Where the value of a setting can come from; a later one takes precedence."""


def read_configurations(connection: Connection, robot_id: int) -> dict[str, Configuration]:
    """The configurations of all slots of a robot, including those that are not in its blueprint."""
    query = (
        select(slots.c.id, slots.c.name, slots.c.configuration_version, library.c.ports)
        .outerjoin(library, slots.c.part_number == library.c.number)
        .where(slots.c.robot_id == robot_id)
    )
    of_bindings = _bindings(connection, robot_id)
    of_settings = _settings(connection, robot_id)
    return {
        row.name: Configuration(
            version=row.configuration_version,
            slot=row.name,
            bindings=tuple(of_bindings[row.id]),
            settings=_as_text(_safe_values(row.ports or [], of_bindings[row.id], of_settings[row.id])),
        )
        for row in connection.execute(query)
    }


def _bindings(connection: Connection, robot_id: int) -> defaultdict[int, list[SlotBinding]]:
    query = select(bindings).where(bindings.c.robot_id == robot_id, bindings.c.in_use).order_by(bindings.c.id)
    found: defaultdict[int, list[SlotBinding]] = defaultdict(list)
    for row in connection.execute(query):
        found[row.slot_id].append(SlotBinding(row.port, row.topic, row.type_name, row.publishes, row.reliable))
    return found


def _settings(connection: Connection, robot_id: int) -> defaultdict[int, dict[str, Scalar]]:
    """The values in force: those set by hand before the blueprint's before the library's."""
    query = (
        select(settings.c.slot_id, settings.c.name, settings.c.origin, settings.c.value)
        .join(slots, settings.c.slot_id == slots.c.id)
        .where(slots.c.robot_id == robot_id)
    )
    found: defaultdict[int, dict[str, Scalar]] = defaultdict(dict)
    for row in sorted(connection.execute(query), key=lambda row: ORIGINS.index(row.origin)):
        found[row.slot_id][row.name] = row.value
    return found


def _safe_values(
    ports: Sequence[Mapping[str, object]], of: Sequence[SlotBinding], stated: Mapping[str, Scalar]
) -> dict[str, Scalar]:
    """The settings with the safe values of ports, `PORT.safe.FIELD`: those that the slot's type declares for its bound
    ports, unless the blueprint states others; what that states, holds without a wire, too."""
    concerned = {binding.port for binding in of if not binding.publishes}
    concerned |= {name.partition(SAFE_MARK)[0] for name in stated if SAFE_MARK in name}
    values: dict[str, Scalar] = {}
    for port in ports:
        safe = port["safe"]
        if port["name"] in concerned and isinstance(safe, dict):
            values |= {safe_setting(str(port["name"]), field): value for field, value in safe.items()}
    return values | dict(stated)


def _as_text(values: Mapping[str, Scalar]) -> tuple[tuple[str, str], ...]:
    return tuple(sorted((name, scalar_text(value)) for name, value in values.items()))
