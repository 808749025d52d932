"""The SQL statements of a running robot: who its parts are, what they may do, and what happened.

Every function works on an open connection and leaves the transaction to its caller. Together with
`blueprint_store` these are all SQL statements of the project; they run on SQLite and on PostgreSQL.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING

from sqlalchemy import Connection, Row, Table, and_, bindparam, delete, func, or_, select, update
from sqlalchemy.dialects import sqlite

from msbot.config import PartType, Slot
from msbot.pnp import Claim, PartEvent, PartState
from msbot.registry.database.tables import journal, library, node_ids, parts, robots, slots
from msbot.registry.records import JournalEntry, PartRecord, RobotRecord, uid_text
from msbot_agent.text.sentence import from_json, to_json

if TYPE_CHECKING:
    from sqlalchemy.dialects import postgresql

_REGISTERED = [state.value for state in PartState if state.is_registered]
_OVER = [state.value for state in PartState if state.is_over]
STATES = {state.value: state for state in PartState}
"""The states of parts by the words of the tables."""


def upsert(
    connection: Connection, table: Table, key: Mapping[str, object], values: Mapping[str, object], **first: object
) -> None:
    """Update the row with this key, or insert it; `first` are columns that only a new row gets."""
    statement = _upsert(connection.dialect.name, table, tuple(key), tuple(values))
    connection.execute(statement, {**key, **values, **first})


@lru_cache(maxsize=64)
def _upsert(
    dialect: str, table: Table, key: tuple[str, ...], values: tuple[str, ...]
) -> sqlite.Insert | postgresql.Insert:
    """The statement of `upsert`. Cached: building it costs several times as much as executing it."""
    statement = _insert(dialect, table)
    return statement.on_conflict_do_update(
        index_elements=list(key), set_={name: statement.excluded[name] for name in values}
    )


def upsert_many(
    connection: Connection, table: Table, key: Sequence[str], rows: Sequence[Mapping[str, object]], *, first: str = ""
) -> None:
    """Update or insert many rows at once; all have the same columns, and `first` is one that only a new row gets."""
    if not rows:
        return
    statement = _insert(connection.dialect.name, table)
    changing = {name: statement.excluded[name] for name in rows[0] if name not in (*key, first)}
    connection.execute(statement.on_conflict_do_update(index_elements=list(key), set_=changing), list(rows))


def _insert(dialect: str, table: Table) -> sqlite.Insert | postgresql.Insert:
    """An INSERT that can update an existing row; PostgreSQL's takes long to import, and few need it."""
    if dialect != "postgresql":
        return sqlite.insert(table)
    from sqlalchemy.dialects import postgresql

    return postgresql.insert(table)


def list_robots(connection: Connection) -> list[RobotRecord]:
    """All robots, the most recently used first."""
    return [_robot(row) for row in connection.execute(select(robots).order_by(robots.c.applied_ns.desc()))]


def find_robot(connection: Connection, name: str, serial_number: str) -> RobotRecord | None:
    """The robot with this name and serial number."""
    query = select(robots).where(robots.c.name == name, robots.c.serial_number == serial_number)
    row = connection.execute(query).one_or_none()
    return None if row is None else _robot(row)


_TYPE_QUERY = select(
    library.c.number,
    library.c.name,
    library.c.description,
    library.c.specification,
    library.c.compatible_with,
    library.c.versions,
)


def read_part_types(connection: Connection) -> dict[str, tuple[PartType, str]]:
    """All part types of the library: by number, with the versions they describe."""
    return {
        row.number: (
            PartType(
                row.number,
                row.name,
                description=row.description,
                specification=row.specification,
                compatible_with=tuple(row.compatible_with),
            ),
            row.versions,
        )
        for row in connection.execute(_TYPE_QUERY)
    }


def list_slots(connection: Connection, robot_id: int) -> tuple[Slot, ...]:
    """The slots of the robot's blueprint, in its order."""
    query = select(slots).where(slots.c.robot_id == robot_id, slots.c.in_blueprint).order_by(slots.c.position)
    return tuple(Slot(row.name, row.part_number, row.local_name) for row in connection.execute(query))


def remember(connection: Connection, robot_id: int, claim: Claim, slot: str, now_ns: int) -> None:
    """Note that the UID of a claim now sits in a slot."""
    uid = uid_text(claim.uid)
    seen = {"part_number": claim.part_number, "local_name": claim.local_name, "uid": uid}
    first = {"state": PartState.CHECKING.value, "reason": "", "address": "", "first_seen_ns": now_ns}
    key = {"robot_id": robot_id, "identity": uid}
    upsert(
        connection, parts, key, {**seen, "slot_id": _slot_id(connection, robot_id, slot), "changed_ns": now_ns}, **first
    )


def note_state(connection: Connection, robot_id: int, event: PartEvent, now_ns: int) -> None:
    """Bring a part's row up to date after a change of its state."""
    uid = uid_text(event.uid)
    values: dict[str, object] = {
        "uid": uid,
        "part_number": event.part_number,
        "local_name": event.local_name,
        "state": event.to_state.value,
        "address": event.address,
    }
    first: dict[str, object] = {"first_seen_ns": now_ns}
    why = {"reason": event.reason, "changed_ns": now_ns}
    (first if event.from_state is event.to_state else values).update(why)  # a note is no reason of the state
    if event.slot is not None:
        values["slot_id"] = _slot_id(connection, robot_id, event.slot)
    key = {"robot_id": robot_id, "identity": uid or f"{event.part_number}/{event.local_name}"}
    upsert(connection, parts, key, values, **first)


def end_run(connection: Connection, robot_id: int, reason: str, now_ns: int) -> None:
    """Mark the parts that are there when a run ends, in a slot or not, as lost, until they claim again."""
    query = _PART_QUERY.where(parts.c.robot_id == robot_id, parts.c.state.not_in(_OVER))
    for record in [_part(row) for row in connection.execute(query)]:
        event = PartEvent(
            at=now_ns / 1e9,
            part=record.name,
            slot=record.slot,
            from_state=STATES[record.state],
            to_state=PartState.LOST,
            reason=reason,
            part_number=record.part_number,
            local_name=record.local_name,
            uid=record.uid,
            address=record.address,
        )
        note_state(connection, robot_id, event, now_ns)
        write_journal(connection, robot_id, event, now_ns)


_SLOT_QUERY = select(slots.c.id).where(slots.c.robot_id == bindparam("of"), slots.c.name == bindparam("called"))


def _slot_id(connection: Connection, robot_id: int, name: str) -> int | None:
    return connection.execute(_SLOT_QUERY, {"of": robot_id, "called": name}).scalar()


def list_parts(connection: Connection, robot_id: int) -> list[PartRecord]:
    """All parts of a robot; those in slots first."""
    order = (slots.c.position.is_(None), slots.c.position, parts.c.first_seen_ns)
    query = _PART_QUERY.where(parts.c.robot_id == robot_id).order_by(*order)
    return [_part(row) for row in connection.execute(query)]


_JOURNAL_LINE = journal.insert()


def write_journal(connection: Connection, robot_id: int, event: PartEvent, now_ns: int) -> None:
    """Add one line to the journal."""
    row = {
        "robot_id": robot_id,
        "at_ns": now_ns,
        "part": event.part,
        "uid": uid_text(event.uid),
        "part_number": event.part_number,
        "local_name": event.local_name,
        "slot": event.slot or "",
        "from_state": "" if event.from_state is None else event.from_state.value,
        "to_state": event.to_state.value,
        "reason": event.reason,
        "evidence": [list(pair) for pair in event.evidence],
        "address": event.address,
        "said": [to_json(event.reason), [[to_json(rule), to_json(outcome)] for rule, outcome in event.evidence]],
    }
    connection.execute(_JOURNAL_LINE, row)


def read_journal(
    connection: Connection, robot_id: int | None, part: str | None, limit: int, *, by_name: bool = False
) -> list[JournalEntry]:
    """The newest lines, the oldest of them first; only those of one part if its name, slot or number is given, or (but
    not with `by_name`) its UID or address."""
    query = select(journal, robots.c.name.label("robot")).join(robots, journal.c.robot_id == robots.c.id)
    if robot_id is not None:
        query = query.where(journal.c.robot_id == robot_id)
    if part is not None:
        names = [journal.c.part, journal.c.slot, journal.c.local_name, journal.c.part_number]
        if by_name:  # who has not said a name is called by the address
            query = query.where(or_(journal.c.part != journal.c.address, journal.c.part != part))
        else:
            names.append(journal.c.uid)
        # SQLite's lower() knows ASCII only, so the word itself is compared as well.
        query = query.where(or_(*(or_(name == part, func.lower(name) == part.lower()) for name in names)))
    rows = connection.execute(query.order_by(journal.c.id.desc()).limit(limit)).all()
    return [journal_entry(row) for row in reversed(rows)]


def prune(connection: Connection, robot_id: int, journal_rows: int, strangers: int, strangers_rows: int) -> None:
    """Delete the oldest lines of the journal, and strangers that came once and were never let in.

    Lines about parts in slots and lines about others are counted separately: however many strangers come, their lines
    displace only lines about strangers.
    """
    for about, rows in ((journal.c.slot != "", journal_rows), (journal.c.slot == "", strangers_rows)):
        these = and_(journal.c.robot_id == robot_id, about)
        last = select(journal.c.id).where(these).order_by(journal.c.id.desc()).offset(rows).limit(1)
        oldest = connection.execute(last).scalar()
        if oldest is not None:
            connection.execute(delete(journal).where(these, journal.c.id <= oldest))
    never_in = and_(parts.c.robot_id == robot_id, parts.c.slot_id.is_(None), parts.c.state.not_in(_REGISTERED))
    changed = select(parts.c.changed_ns).where(never_in).order_by(parts.c.changed_ns.desc()).offset(strangers).limit(1)
    until = connection.execute(changed).scalar()
    if until is not None:
        connection.execute(delete(parts).where(never_in, parts.c.changed_ns <= until))


def read_node_ids(connection: Connection, robot_id: int, link: str) -> list[tuple[int, str, int]]:
    """(node id, UID, kept_ns) of a CAN bus, the least recently stored first."""
    query = select(node_ids).where(node_ids.c.robot_id == robot_id, node_ids.c.link == link)
    return [(row.node_id, row.uid, row.kept_ns) for row in connection.execute(query.order_by(node_ids.c.kept_ns))]


def keep_node_id(connection: Connection, robot_id: int, link: str, *, node_id: int, uid: str, kept_ns: int) -> None:
    """Give an address to a UID; its previous owner and the UID's previous address are released."""
    here = and_(node_ids.c.robot_id == robot_id, node_ids.c.link == link)
    connection.execute(delete(node_ids).where(here, or_(node_ids.c.node_id == node_id, node_ids.c.uid == uid)))
    row = {"robot_id": robot_id, "link": link, "node_id": node_id, "uid": uid, "kept_ns": kept_ns}
    connection.execute(node_ids.insert().values(row))


def bump_versions(connection: Connection, robot_id: int, names: Sequence[str]) -> None:
    """Give the configurations of these slots a new version."""
    if names:
        changed = and_(slots.c.robot_id == robot_id, slots.c.name.in_(names))
        connection.execute(update(slots).where(changed).values(configuration_version=slots.c.configuration_version + 1))


_PART_QUERY = (
    select(parts, robots.c.name.label("robot"), slots.c.name.label("slot"))
    .join(robots, parts.c.robot_id == robots.c.id)
    .outerjoin(slots, parts.c.slot_id == slots.c.id)
)


def _robot(row: Row[tuple[object, ...]]) -> RobotRecord:
    return RobotRecord(
        id=row.id,
        name=row.name,
        serial_number=row.serial_number,
        version=row.version,
        released=row.released,
        manufacturer=row.manufacturer,
        applied_ns=row.applied_ns,
    )


def _part(row: Row[tuple[object, ...]]) -> PartRecord:
    return PartRecord(
        robot=row.robot,
        uid=bytes.fromhex(row.uid),
        part_number=row.part_number,
        local_name=row.local_name,
        slot=row.slot,
        state=row.state,
        reason=row.reason,
        address=row.address,
        first_seen_ns=row.first_seen_ns,
        changed_ns=row.changed_ns,
    )


def journal_entry(row: Row[tuple[object, ...]]) -> JournalEntry:
    """A line of the journal, from its row with the robot's name."""
    reason, evidence = row.said or (row.reason, row.evidence)
    event = PartEvent(
        at=row.at_ns / 1e9,
        part=row.part,
        slot=row.slot or None,
        from_state=STATES.get(row.from_state),
        to_state=STATES[row.to_state],
        reason=from_json(reason),
        evidence=tuple((from_json(rule), from_json(outcome)) for rule, outcome in evidence),
        part_number=row.part_number,
        local_name=row.local_name,
        uid=bytes.fromhex(row.uid),
        address=row.address,
    )
    return JournalEntry(row.id, row.robot, row.at_ns, event)
