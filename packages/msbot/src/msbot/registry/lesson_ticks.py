"""What people have done of lessons: who has begun which, and when each of its checks ticked for them."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial

from sqlalchemy import Connection, delete, func, insert, select

from msbot.registry.database.storage import Storage
from msbot.registry.database.tables import lesson_ticks
from msbot_agent.text.sentence import said
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

BEGUN = ""
"""In place of a check: the person has begun the lesson."""
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

    def note(self, people: Iterable[str], lesson: str, check: str, at_ns: int) -> None:
        """Keep that a check ticked for these people; whoever has the tick already keeps the first one.

        Raises:
            ConfigError: there are too many.
            RegistryError: the database cannot be written; nothing has changed.
        """
        self._storage.change(partial(_note, people=tuple(people), lesson=lesson, check=check, at_ns=at_ns))


def remove_ticks_of(connection: Connection, person: str) -> None:
    """Delete what a person who is removed has done."""
    connection.execute(delete(lesson_ticks).where(lesson_ticks.c.person == person))


def _all(connection: Connection) -> list[Tick]:
    query = select(lesson_ticks).order_by(lesson_ticks.c.at_ns, lesson_ticks.c.person)
    return [Tick(row.person, row.lesson, row.check, row.at_ns) for row in connection.execute(query)]


def _note(connection: Connection, people: tuple[str, ...], lesson: str, check: str, at_ns: int) -> None:
    columns = lesson_ticks.c
    query = select(columns.person).where(columns.lesson == lesson, columns.check == check)
    have = {row.person for row in connection.execute(query)}
    if missing := [person for person in people if person not in have]:
        count = connection.execute(select(func.count()).select_from(lesson_ticks)).scalar_one()
        if count + len(missing) > MOST_TICKS:
            raise ConfigError(said("more than {most} ticks of lessons are not kept", most=MOST_TICKS))
        connection.execute(
            insert(lesson_ticks),
            [{"person": person, "lesson": lesson, "check": check, "at_ns": at_ns} for person in missing],
        )
