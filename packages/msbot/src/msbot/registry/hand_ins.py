"""The work that people hand in: of a lesson, with a program and answers; a teacher comments and returns it."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

from sqlalchemy import (
    Column,
    ColumnElement,
    Connection,
    LargeBinary,
    Row,
    Select,
    case,
    cast,
    delete,
    func,
    insert,
    literal,
    select,
    update,
)

from msbot.registry.database.storage import Storage
from msbot.registry.database.tables import hand_ins
from msbot_agent.text.sentence import said
from msbot_xrce.errors import ConfigError, NotThere
from msbot_xrce.lazy import dataclass

MOST_OF_LESSON = 5
"""How many hand-ins of one person for one lesson are kept: the newest ones."""
MOST_OF_ALL = 32 * 1024 * 1024
"""Octets of all programs that were handed in; of more, those that were returned longest ago give way."""
MOST_RECORDED_OF_ONE = 8 * 1024 * 1024
"""Octets of the recordings of one person; for a newer one, the oldest of the same person give way."""
MOST_RECORDED = 128 * 1024 * 1024
"""Octets of the recordings of a class; for a newer one, those give way that were returned longest ago."""
MOST_LISTED = 500
"""How many are listed: those that wait for an answer before the others."""


@dataclass(frozen=True, slots=True)
class HandIn:
    """Something that a person has handed in."""

    person: str
    lesson: str
    at_ns: int
    """Nanoseconds since 1970, as all times here."""
    from_ns: int
    """When the person began: the recording from there to `at_ns` belongs to it."""
    program: str = ""
    """The name of the program; empty: none."""
    text: str = ""
    """The program as it was then."""
    note: str = ""
    """What the person says of it."""
    answers: Mapping[str, str] | None = None
    """The last answer to each question, by the name of its check."""
    number: int = 0
    """0: not kept yet."""
    returned_ns: int = 0
    """0: not returned yet."""
    returned_by: str = ""
    comment: str = ""
    """What the teacher says of it."""
    recording_octets: int = 0
    """How large the copy of the robot's recording is; 0: there is none."""
    recorded_from_ns: int = 0
    """When that copy begins."""
    recorded_to_ns: int = 0
    """When it ends."""


class HandIns:
    """See the module's docstring. Every method waits for the database."""

    def __init__(self, storage: Storage) -> None:
        self._storage = storage

    def of(self, person: str | None = None) -> list[HandIn]:
        """What a person has handed in, or everybody, without the texts of the programs.

        What was not returned comes first, then the newest.

        Raises:
            RegistryError: the database cannot be read.
        """
        return self._storage.read(partial(_of, person=person))

    def get(self, number: int) -> HandIn:
        """The one of that number.

        Raises:
            NotThere: there is none.
            RegistryError: the database cannot be read.
        """
        return self._storage.read(partial(_get, number=number))

    def recording(self, number: int) -> bytes:
        """The copy of the robot's recording that belongs to the one of that number: an MCAP file.

        Raises:
            NotThere: there is none, or it has given way to newer ones.
            RegistryError: the database cannot be read.
        """
        return self._storage.read(partial(_recording, number=number))

    def store(self, work: HandIn, recording: bytes = b"") -> int:
        """Keep what somebody hands in; returns its number.

        Args:
            work: what is handed in, with the times of the recording.
            recording: the copy of the robot's recording; empty: there is none. It is left out if the recordings of work
                that was not returned fill the class's share already.

        Raises:
            ConfigError: too much is kept that was not returned.
            RegistryError: the database cannot be written; nothing has changed.
        """
        return self._storage.change(partial(_keep, work=work, recording=recording))

    def give_back(self, number: int, who: str, comment: str, at_ns: int) -> HandIn:
        """Return one with a comment; what was returned can be returned again with another one.

        Raises:
            NotThere: there is none of that number.
            RegistryError: the database cannot be written; nothing has changed.
        """
        return self._storage.change(partial(_give_back, number=number, who=who, comment=comment, at_ns=at_ns))


def remove_hand_ins_of(connection: Connection, person: str) -> None:
    """Delete what a person who is removed has handed in."""
    connection.execute(delete(hand_ins).where(hand_ins.c.person == person))


def _of(connection: Connection, person: str | None) -> list[HandIn]:
    columns = [*_columns_but("text", "recording"), _recorded(connection)]
    is_returned = case((hand_ins.c.returned_ns > 0, 1), else_=0)
    query = select(*columns).order_by(is_returned, hand_ins.c.at_ns.desc(), hand_ins.c.id.desc()).limit(MOST_LISTED)
    if person is not None:
        query = query.where(hand_ins.c.person == person)
    return [_hand_in(row, "") for row in connection.execute(query)]


def _get(connection: Connection, number: int) -> HandIn:
    query = select(*_columns_but("recording"), _recorded(connection)).where(hand_ins.c.id == number)
    row = connection.execute(query).one_or_none()
    if row is None:
        raise NotThere(said("nothing with the number {number} was handed in", number=number))
    return _hand_in(row, row.text)


def _recording(connection: Connection, number: int) -> bytes:
    found = connection.execute(select(hand_ins.c.recording).where(hand_ins.c.id == number)).scalar_one_or_none()
    if not found:
        raise NotThere(said("no recording is kept with the hand-in {number}", number=number))
    return bytes(found)


def _columns_but(*names: str) -> list[Column[Any]]:
    """All columns but those, which may be large."""
    return [column for column in hand_ins.c if column.name not in names]


def _recorded(connection: Connection) -> ColumnElement[int]:
    return _octets(connection, hand_ins.c.recording).label("recording_octets")


def _hand_in(row: Row[*tuple[Any, ...]], text: str) -> HandIn:
    return HandIn(
        row.person,
        row.lesson,
        row.at_ns,
        row.from_ns,
        row.program,
        text,
        row.note,
        dict(row.answers),
        row.id,
        row.returned_ns,
        row.returned_by,
        row.comment,
        int(row.recording_octets),
        row.recorded_from_ns,
        row.recorded_to_ns,
    )


def _keep(connection: Connection, work: HandIn, recording: bytes) -> int:
    columns = hand_ins.c
    values = {
        "person": work.person,
        "lesson": work.lesson,
        "at_ns": work.at_ns,
        "from_ns": work.from_ns,
        "program": work.program,
        "text": work.text,
        "note": work.note,
        "answers": dict(work.answers or {}),
        "recording": b"",
        "recorded_from_ns": work.recorded_from_ns,
        "recorded_to_ns": work.recorded_to_ns,
    }
    own = select(columns.id).where(columns.person == work.person, columns.lesson == work.lesson)
    older = connection.execute(own.order_by(columns.id.desc()).offset(MOST_OF_LESSON - 1)).scalars().all()
    connection.execute(delete(hand_ins).where(columns.id.in_(older)))
    number = connection.execute(
        insert(hand_ins).values(**values, returned_ns=0, returned_by="", comment="").returning(columns.id)
    ).scalar_one()
    _make_room(connection)
    if recording and _has_room_for(connection, work.person, len(recording)):
        connection.execute(update(hand_ins).where(columns.id == number).values(recording=recording))
    return int(number)


def _has_room_for(connection: Connection, person: str, size: int) -> bool:
    """Make room for a recording: a person's oldest give way, then what was returned longest ago; False: not enough."""
    columns, octets = hand_ins.c, _recorded(connection)
    everything = select(columns.id, octets).where(octets > 0)
    own = everything.where(columns.person == person).order_by(columns.id)
    if not _dropped(connection, own, MOST_RECORDED_OF_ONE - size, _used(connection, columns.person == person)):
        return False
    returned = everything.where(columns.returned_ns > 0).order_by(columns.returned_ns)
    return _dropped(connection, returned, MOST_RECORDED - size, _used(connection, literal(value=True)))


def _used(connection: Connection, where: ColumnElement[bool]) -> int:
    """Octets of recordings."""
    total = func.coalesce(func.sum(_octets(connection, hand_ins.c.recording)), 0)
    return int(connection.execute(select(total).where(where)).scalar_one())


def _dropped(connection: Connection, candidates: Select[tuple[Any, int]], most: int, used: int) -> bool:
    """Drop recordings in this order until at most so many octets are used; False: that is not enough."""
    gone: list[int] = []
    for number, size in connection.execute(candidates):
        if used <= most:
            break
        gone.append(number)
        used -= size
    if used > most:
        return False
    connection.execute(update(hand_ins).where(hand_ins.c.id.in_(gone)).values(recording=b""))
    return True


def _make_room(connection: Connection) -> None:
    """Of too much, what was returned longest ago goes.

    Raises:
        ConfigError: too much is left that was not returned.
    """
    columns = hand_ins.c
    used = int(connection.execute(select(func.coalesce(func.sum(_size(connection)), 0))).scalar_one())
    returned = select(columns.id, _size(connection)).where(columns.returned_ns > 0).order_by(columns.returned_ns)
    gone: list[int] = []
    for number, size in connection.execute(returned):
        if used <= MOST_OF_ALL:
            break
        gone.append(number)
        used -= size
    connection.execute(delete(hand_ins).where(columns.id.in_(gone)))
    if used > MOST_OF_ALL:
        raise ConfigError(
            said(
                "what was handed in has {most} MB: a teacher returns some of it first, on the page Learn",
                most=MOST_OF_ALL >> 20,
            )
        )


def _size(connection: Connection) -> ColumnElement[int]:
    """Octets of a row's program."""
    return _octets(connection, hand_ins.c.text)


def _octets(connection: Connection, column: Column[Any]) -> ColumnElement[int]:
    """Octets of a value; SQLite counts the characters of a text unless it is cast."""
    return func.octet_length(column) if connection.dialect.name != "sqlite" else func.length(cast(column, LargeBinary))


def _give_back(connection: Connection, number: int, who: str, comment: str, at_ns: int) -> HandIn:
    values = {"returned_ns": at_ns, "returned_by": who, "comment": comment}
    connection.execute(update(hand_ins).where(hand_ins.c.id == number).values(values))
    return _get(connection, number)
