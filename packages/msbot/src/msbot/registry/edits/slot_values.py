"""The parameters of slots: the value in force, where it comes from, and setting one by hand."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Self

from sqlalchemy import Connection, delete, select

from msbot.config import Parameter, ParameterKind, Scalar, scalar_text
from msbot.registry.configurations import ORIGINS
from msbot.registry.database.statements import bump_versions, upsert
from msbot.registry.database.tables import library, settings, slots
from msbot.registry.edits.edit_log import Author, record
from msbot.registry.records import EditKind, EditRecord, ValueRecord
from msbot_agent.text.sentence import said
from msbot_agent.text.similar_names import instead_of
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

HAND = "hand"


@dataclass(frozen=True, slots=True)
class UndoableSetting:
    """The value set by hand for a parameter of a slot."""

    slot: str
    name: str
    value: Scalar | None
    """None: not set by hand."""

    def as_json(self) -> dict[str, object]:
        """See `UndoableChange.as_json`."""
        return {"of": "value", "slot": self.slot, "name": self.name, "value": self.value}

    def as_it_is(self, connection: Connection, robot_id: int) -> Self:
        """See `UndoableChange.as_it_is`."""
        return replace(self, value=hand_value(connection, robot_id, self.slot, self.name))

    def write(self, connection: Connection, author: Author) -> None:
        """See `UndoableChange.write`."""
        write_hand_value(
            connection, author.robot, self.slot, self.name, self.value, who=author.who, now_ns=author.now_ns
        )
        bump_versions(connection, author.robot, [self.slot])


def set_value(connection: Connection, author: Author, slot: str, name: str, value: Scalar | None) -> EditRecord:
    """Set a parameter of a slot by hand; None clears it, so that the value of blueprint or library holds again.

    Raises:
        ConfigError: there is no such slot or parameter, or the value is not allowed.
    """
    old = check_value(connection, author.robot, slot, name, value)
    after = UndoableSetting(slot, name, value)
    before = after.as_it_is(connection, author.robot)
    after.write(connection, author)
    (new,) = [found for found in read_values(connection, author.robot, slot) if found.name == name]
    words = said(
        "{name} of {slot}: {before} -> {after}",
        name=name,
        slot=slot,
        before=value_words(old.value, old.unit),
        after=value_words(new.value, new.unit),
    )
    if value is None:
        words = said("{change} (the {origin}'s)", change=words, origin=said(new.origin))
    return record(connection, author, EditKind.VALUE, words, slot=slot, before=before, after=after)


def set_values(connection: Connection, author: Author, slot: str, values: Mapping[str, Scalar | None]) -> EditRecord:
    """Set several parameters of a slot by hand, one edit each; returns the last edit.

    Raises:
        ConfigError: as `set_value`; the transaction must not be committed then.
    """
    return [set_value(connection, author, slot, name, value) for name, value in values.items()][-1]


def find_slot(connection: Connection, robot_id: int, name: str) -> tuple[int, str]:
    """Number and part number of a slot of the blueprint.

    Raises:
        ConfigError: there is none of that name.
    """
    query = select(slots.c.id, slots.c.part_number).where(
        slots.c.robot_id == robot_id, slots.c.name == name, slots.c.in_blueprint
    )
    row = connection.execute(query).one_or_none()
    if row is None:
        order = (
            select(slots.c.name).where(slots.c.robot_id == robot_id, slots.c.in_blueprint).order_by(slots.c.position)
        )
        known = connection.execute(order).scalars().all()
        raise ConfigError(said("there is no slot {name!r}; {hint}", name=name, hint=instead_of(name, known)))
    return row.id, row.part_number


def read_parameters(connection: Connection, part_number: str) -> tuple[Parameter, ...]:
    """The parameters of a part type, as the library has them."""
    rows = connection.execute(select(library.c.parameters).where(library.c.number == part_number)).scalar() or []
    return tuple(
        Parameter(
            name=row["name"],
            kind=ParameterKind(row["type"]),
            default=row["default"],
            unit=row["unit"],
            least=row["min"],
            most=row["max"],
            description=row["description"],
        )
        for row in rows
    )


def read_values(connection: Connection, robot_id: int, slot: str) -> tuple[ValueRecord, ...]:
    """The parameters of a slot, in the library's order.

    Raises:
        ConfigError: there is no such slot.
    """
    slot_id, part_number = find_slot(connection, robot_id, slot)
    rows = connection.execute(select(settings).where(settings.c.slot_id == slot_id)).all()
    holding = {row.name: row for row in sorted(rows, key=lambda row: ORIGINS.index(row.origin))}
    return tuple(
        ValueRecord(
            name=parameter.name,
            kind=parameter.kind.value,
            unit=parameter.unit,
            least=parameter.least,
            most=parameter.most,
            default=parameter.default,
            value=holding[parameter.name].value,
            origin=holding[parameter.name].origin,
            description=parameter.description,
            changed_ns=holding[parameter.name].changed_ns,
            who=holding[parameter.name].who,
        )
        for parameter in read_parameters(connection, part_number)
        if parameter.name in holding
    )


def check_value(connection: Connection, robot_id: int, slot: str, name: str, value: Scalar | None) -> ValueRecord:
    """The parameter as it is now, provided that it may be set to this value by hand.

    Raises:
        ConfigError: no such slot or parameter, the value is not allowed, or it is None and nothing was set by hand.
    """
    known = {record.name: record for record in read_values(connection, robot_id, slot)}
    record = known.get(name)
    if record is None:
        hint = instead_of(name, known)
        raise ConfigError(said("slot {slot} has no parameter {name!r}; {hint}", slot=slot, name=name, hint=hint))
    if value is None:
        if record.origin != HAND:
            raise ConfigError(
                said(
                    "{name} of slot {slot} is not set by hand: its value is the {origin}'s already",
                    name=name,
                    slot=slot,
                    origin=said(record.origin),
                )
            )
        return record
    parameter = Parameter(name, ParameterKind(record.kind), record.default, record.unit, record.least, record.most)
    if fault := parameter.fault(value):
        raise ConfigError(said("{name} of slot {slot}: {fault}", name=name, slot=slot, fault=fault))
    return record


def hand_value(connection: Connection, robot_id: int, slot: str, name: str) -> Scalar | None:
    """The value set by hand, or None."""
    query = (
        select(settings.c.value)
        .join(slots, settings.c.slot_id == slots.c.id)
        .where(slots.c.robot_id == robot_id, slots.c.name == slot, settings.c.name == name, settings.c.origin == HAND)
    )
    value: Scalar | None = connection.execute(query).scalar()
    return value


def write_hand_value(
    connection: Connection, robot_id: int, slot: str, name: str, value: Scalar | None, *, who: str, now_ns: int
) -> None:
    """Set a value by hand, or clear it with None; the caller has checked it.

    Raises:
        ConfigError: the slot no longer exists.
    """
    slot_id, _ = find_slot(connection, robot_id, slot)
    key = {"slot_id": slot_id, "name": name, "origin": HAND}
    if value is None:
        this = (settings.c.slot_id == slot_id, settings.c.name == name, settings.c.origin == HAND)
        connection.execute(delete(settings).where(*this))
    else:
        upsert(connection, settings, key, {"value": value, "changed_ns": now_ns, "who": who})


def value_words(value: Scalar, unit: str) -> str:
    """A value with its unit, for example `0.5 s`."""
    return f"{scalar_text(value)} {unit}".rstrip()
