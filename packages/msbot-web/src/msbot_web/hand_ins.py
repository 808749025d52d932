"""What pupils hand in of a lesson, and teachers open, comment and return; rights are checked here, for page and API."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Final

from msbot.operations.rights import Right
from msbot.operations.teaching_operations import Lessons
from msbot.recording.recordings.bounded_copy import BoundedCopy
from msbot.registry import Registry
from msbot.registry.hand_ins import HandIn, HandIns
from msbot_agent.text.sentence import said
from msbot_web.access.accounts import Accounts
from msbot_web.access.sessions import Session
from msbot_web.lessons_view import LessonsView
from msbot_web.programs.programs import ProgramActions
from msbot_web.recorded_past import RecordedPast
from msbot_web.recorded_snapshot import RecordedSnapshot
from msbot_xrce.errors import ConfigError, NotThere

log = logging.getLogger(__name__)

NS: Final = 1_000_000_000
MOST_NOTE: Final = 2000
"""Characters of what a pupil or a teacher writes."""


class HandInActions:
    """See the module's docstring.

    Args:
        accounts: who is signed in.
        programs: the programs of people.
        learning: the lesson that runs, and where it is kept.
        lessons: notes in the journal.
        past: what the robot's recorder has; a copy of it goes with the work. None: nothing is recorded.
        epoch_ns: wall clock, nanoseconds since 1970.
    """

    def __init__(
        self,
        accounts: Accounts,
        programs: ProgramActions,
        learning: LessonsView,
        lessons: Lessons,
        past: RecordedPast | None = None,
        *,
        epoch_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self._registry = learning.registry
        self._accounts = accounts
        self._programs = programs
        self._learning = learning
        self._lessons = lessons
        self._past = past
        self._epoch_ns = epoch_ns

    async def hand_in(self, session: Session, program: str, note: str) -> int:
        """Hand in what one has of the lesson that runs; returns its number.

        Args:
            session: whose.
            program: the name of an own program; empty: none.
            note: what the teacher should know.

        Raises:
            ConfigError: no lesson runs, the person does not take part, or the note is too long.
            NotThere: there is no such program.
            RegistryError: it cannot be kept.
        """
        self._accounts.require(session, Right.OPERATE)
        _check_text(note)
        run = self._learning.run_of(session)
        if run is None:
            raise ConfigError(
                said("only who takes part in the lesson that runs can hand something in: Take part first")
            )
        text = (await self._programs.source(session, program)).text if program else ""
        now_ns = self._epoch_ns()
        began_ns = now_ns - round(1e9 * self._learning.seconds_of(session))
        answers, title = dict(run.answers), run.lesson.title  # as they are now; the recording takes a moment
        kept, registry = self._kept()
        copy = await self._copy(began_ns, now_ns)
        work = HandIn(session.name, run.lesson.name, now_ns, began_ns, program, text, note, answers)
        if copy is not None:
            work = replace(work, recorded_from_ns=copy.from_ns, recorded_to_ns=copy.to_ns)
        number = await registry.storage.in_time(kept.store, work, b"" if copy is None else copy.octets)
        self._lessons.note(said("hands in {title!r}", title=title), session.name)
        return number

    async def listed(self, session: Session) -> list[HandIn]:
        """What everybody has handed in, for a teacher, without the texts of programs; for others what is their own.

        Raises:
            RegistryError: the database does not answer.
        """
        self._accounts.require(session, Right.SEE)
        if self._registry is None:
            return []
        person = None if session.may(Right.ARRANGE) else session.name
        if person is not None and not session.is_of(person):
            return []
        return await self._registry.storage.in_time(self._registry.hand_ins.of, person)

    async def opened(self, session: Session, number: int) -> HandIn:
        """One with its program; another pupil's is as if it were not there.

        Raises:
            NotThere: there is none of that number for this person.
            RegistryError: the database does not answer.
        """
        self._accounts.require(session, Right.SEE)
        kept, registry = self._kept()
        found = await registry.storage.in_time(kept.get, number)
        if not session.may(Right.ARRANGE) and not session.is_of(found.person):
            raise NotThere(said("nothing with the number {number} was handed in", number=number))
        return found

    async def recording(self, session: Session, number: int) -> bytes:
        """The copy of the robot's recording, for teachers: it says what everybody did at the robot.

        Raises:
            NotThere: there is none.
            RegistryError: the database does not answer.
        """
        self._accounts.require(session, Right.ARRANGE)
        kept, registry = self._kept()
        return await registry.storage.in_time(kept.recording, number)

    async def moment(self, session: Session, number: int, at_s: float) -> RecordedSnapshot:
        """The robot at a moment of that copy, seconds since 1970, for whoever may open the work.

        Raises:
            ConfigError: the copy has nothing of that time, or it takes too long.
            NotThere: there is nothing of that number for this person, or no copy.
            RegistryError: the database does not answer.
        """
        found = await self.opened(session, number)
        kept, registry = self._kept()
        octets = await registry.storage.in_time(kept.recording, number)
        if self._past is None:
            raise ConfigError(said("this robot runs with `--rec off`: nothing of its past is known"))
        return await self._past.moment_of_copy(f"hand-in {number} {found.at_ns}", octets, at_s)

    async def give_back(self, session: Session, number: int, comment: str) -> HandIn:
        """Return one with a comment.

        Raises:
            ConfigError: the comment is too long.
            NotThere: there is none of that number.
            RegistryError: it cannot be kept.
        """
        self._accounts.require(session, Right.ARRANGE)
        _check_text(comment)
        kept, registry = self._kept()
        work = partial(kept.give_back, number, session.name, comment, self._epoch_ns())
        found = await registry.storage.in_time(work)
        self._lessons.note(said("returns what {person} handed in", person=found.person), session.name)
        return found

    async def _copy(self, from_ns: int, to_ns: int) -> BoundedCopy | None:
        """The robot's recording of that time; None: there is none, which the page of the work says."""
        if self._past is None:
            return None
        try:
            return await self._past.copy(from_ns / NS, to_ns / NS)
        except ConfigError as error:  # the work counts for more than its recording
            log.warning("a hand-in gets no recording: %s", error)
            return None

    def _kept(self) -> tuple[HandIns, Registry]:
        if self._registry is None:
            raise ConfigError(said("this robot has no database: nothing can be handed in"))
        return self._registry.hand_ins, self._registry


def _check_text(text: str) -> None:
    if len(text) > MOST_NOTE or "\0" in text:
        raise ConfigError(said("write at most {most} characters", most=MOST_NOTE))
    try:
        text.encode()
    except UnicodeEncodeError:  # half of a pair of surrogates
        raise ConfigError(said("this text holds characters that are none")) from None
