"""What people have done of lessons: who has begun which, and when each of its checks ticked for them."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial

from sqlalchemy import Connection, delete, func, insert, select, update

from msbot.registry.database.storage import Storage
from msbot.registry.database.tables import lesson_ticks
from msbot_agent.text.sentence import said
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

BEGUN = ""
"""In place of a check: the person has begun the lesson."""
OWN = "own"
"""The person did it."""
MOST_TICKS = 200_000
"""Most rows that are kept: a class of 30 with 8 lessons of 20 checks has 5,000."""


@dataclass(frozen=True, slots=True)
class Tick:
    """One check that ticked for one person."""

    person: str
    lesson: str
    check: str
    """Its name; empty: the lesson was begun."""
    at_ns: int
    """Nanoseconds since 1970."""
    doing: str = OWN
    """Whose hand it was: `own`, `group`, `helped` or `robot`."""
    by: str = ""
    """Who did it, if it was not the person."""


class LessonTicks:
    """See the module's docstring. Every method waits for the database."""

    def __init__(self, storage: Storage) -> None:
        self._storage = storage

    def all(self) -> list[Tick]:
        """Every tick of everybody, the oldest first.

        Raises:
            RegistryError: the database cannot be read.
        """
        return self._storage.read(_all)

    def note(
        self, people: Iterable[str], lesson: str, check: str, at_ns: int, *, doing: str = OWN, by: str = ""
    ) -> None:
        """Keep that a check ticked for these people; whoever has the tick already keeps the first one, unless this is
        the first that the person has done alone.

        Raises:
            ConfigError: there are too many.
            RegistryError: the database cannot be written; nothing has changed.
        """
        tick = Tick("", lesson, check, at_ns, doing, by)
        self._storage.change(partial(_note, people=tuple(people), tick=tick))


def remove_ticks_of(connection: Connection, person: str) -> None:
    """Delete what a person who is removed has done."""
    connection.execute(delete(lesson_ticks).where(lesson_ticks.c.person == person))


def _all(connection: Connection) -> list[Tick]:
    query = select(lesson_ticks).order_by(lesson_ticks.c.at_ns, lesson_ticks.c.person)
    return [
        Tick(row.person, row.lesson, row.check, row.at_ns, row.doing, row.done_by) for row in connection.execute(query)
    ]


def _note(connection: Connection, people: tuple[str, ...], tick: Tick) -> None:
    columns = lesson_ticks.c
    query = select(columns.person, columns.doing).where(columns.lesson == tick.lesson, columns.check == tick.check)
    have = {row.person: row.doing for row in connection.execute(query)}
    values: dict[str, object] = {"at_ns": tick.at_ns, "doing": tick.doing, "done_by": tick.by}
    if missing := [person for person in people if person not in have]:
        count = connection.execute(select(func.count()).select_from(lesson_ticks)).scalar_one()
        if count + len(missing) > MOST_TICKS:
            raise ConfigError(said("more than {most} ticks of lessons are not kept", most=MOST_TICKS))
        connection.execute(
            insert(lesson_ticks),
            [{"person": person, "lesson": tick.lesson, "check": tick.check, **values} for person in missing],
        )
    if tick.doing == OWN and tick.check != BEGUN:
        again = [person for person in people if have.get(person, OWN) != OWN]
        own = update(lesson_ticks).where(columns.lesson == tick.lesson, columns.check == tick.check)
        connection.execute(own.where(columns.person.in_(again)).values(values))
