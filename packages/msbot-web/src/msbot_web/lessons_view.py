"""Lessons as the page Learn shows them: the texts as HTML, the lesson that runs, and how far everybody is."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from functools import cache
from typing import Final

from msbot.operations.rights import Right
from msbot.operations.teaching_operations import people_stop
from msbot.registry import Registry
from msbot.registry.lesson_ticks import Tick
from msbot_agent.text.sentence import said
from msbot_school.lessons.lesson import Lesson
from msbot_school.lessons.lesson_controller import LessonController
from msbot_school.lessons.lesson_run import LessonRun
from msbot_school.lessons.progress import LessonProgress, progress_of
from msbot_web.access.accounts import Accounts
from msbot_web.access.sessions import Session
from msbot_xrce.errors import ConfigError

DONE_LOOK_S: Final = 0.5
"""Period in which the database is asked whether the last check, which has ticked, is kept there."""
DONE_LOOKS: Final = 6
"""How often it is asked."""
PROGRESS_S: Final = 2.0
"""How old the class table may be."""
_ATTRIBUTES: Final = {
    "*": {"class"},
    "a": {"href", "title"},
    "img": {"src", "alt", "title"},
    "td": {"style"},
    "th": {"style"},
}
_STYLES: Final = {"text-align"}
_SCHEMES: Final = {"http", "https", "mailto"}
"""Where a link of a lesson may lead."""


class LessonsView:
    """What can be seen of lessons.

    Args:
        desk: the lesson desk of the robot; None: it has none.
        registry: where progress is kept; None: nowhere.
        accounts: who is signed in.
    """

    def __init__(self, desk: LessonController | None, registry: Registry | None, accounts: Accounts) -> None:
        self._desk = desk
        self.registry = registry
        """Where progress is kept; None: nowhere."""
        self._accounts = accounts
        self._reading = asyncio.Lock()
        self._ticks: tuple[float, list[Tick]] | None = None

    def lesson(self, language: str) -> Lesson | None:
        """The lesson that runs, in that language if there is a translation."""
        if self._desk is None or self._desk.lesson is None:
            return None
        return self._desk.shelf.translated(self._desk.lesson, language)

    def now(self) -> dict[str, object]:
        """What has ticked, who takes part, who asks for help."""
        return {"lesson": None} if self._desk is None else dict(self._desk.as_json())

    def forget(self, person: str) -> None:
        """A person is removed."""
        self._ticks = None
        if self._desk is not None:
            self._desk.forget(person)

    def of(self, session: Session) -> Mapping[str, object] | None:
        """How far a person is in the lesson that runs; None: they do not take part, or none runs."""
        people = self.now().get("progress", [])
        assert isinstance(people, list)
        return next((one for one in people if one["person"] == session.name), None)

    def run_of(self, session: Session) -> LessonRun | None:
        """The run of a person; None: they do not take part in a lesson."""
        return None if self._desk is None else self._desk.run_of(session.name)

    def seconds_of(self, session: Session) -> float:
        """For how long a person has taken part, seconds."""
        return 0.0 if self._desk is None else self._desk.seconds_of(session.name)

    def ticks_of_others(self, session: Session) -> Mapping[str, str]:
        """Checks that do not tick for a person because somebody else has done them -> who."""
        run = self.run_of(session)
        if run is None:
            return {}
        found = {check.name: run.ticks_of_others(check.name) for check in run.lesson.checks}
        return {name: who for name, who in found.items() if who}

    def is_right(self, lesson: str, check: str, answer: str) -> bool:
        """Whether that is a right answer to a question, in any language."""
        if self._desk is None:
            return False
        try:
            found = self._desk.shelf.get(lesson)
        except ConfigError:
            return False
        asked = found.check(check)
        questions = [] if asked is None or asked.question is None else [asked.question]
        return any(one.is_right(answer) for one in (*questions, *self._desk.shelf.questions(found, check)))

    def lessons(self, language: str = "en") -> tuple[list[Lesson], list[str]] | None:
        """All lessons, in that language where there is a translation; and what is wrong with files that are none.

        None: they are being read, ask again.
        """
        if self._desk is None:
            return [], []
        self._desk.look_again()
        shelf = self._desk.shelf
        if not shelf.is_read:
            return None
        lessons, wrong = shelf.all()
        return [shelf.translated(lesson, language) for lesson in lessons], wrong

    def lesson_named(self, name: str) -> Lesson:
        """The lesson of that name, once the files are read.

        Raises:
            ConfigError: there is none, or its file is wrong.
        """
        if self._desk is None:
            raise ConfigError(said("this robot runs without lessons"))
        return self._desk.shelf.get(name)

    def obstacle(self, lesson: Lesson) -> str:
        """See `LessonController.obstacle`."""
        return "" if self._desk is None else self._desk.obstacle(lesson)

    async def who_stops(self, lesson: str) -> str:
        """Whose programs and parts stop when that lesson begins, in words; empty: nobody's."""
        return "" if self._desk is None else people_stop(await self._desk.who_stops(lesson))

    def is_missing(self, lesson: Lesson, language: str) -> bool:
        """See `LessonCatalog.is_missing`."""
        return self._desk is not None and self._desk.shelf.is_missing(lesson, language)

    async def progress(self, session: Session, language: str = "en") -> list[LessonProgress]:
        """How far everybody is, for a teacher; how far one is oneself, for everybody else.

        Raises:
            RegistryError: the database does not answer.
        """
        self._accounts.require(session, Right.SEE)
        if self.registry is None:
            return []
        async with self._reading:  # once for all pages that ask
            now = asyncio.get_running_loop().time()
            if self._ticks is None or now - self._ticks[0] >= PROGRESS_S:
                ticks = await self.registry.storage.in_time(self.registry.lesson_ticks.all)
                self._ticks = now, ticks
            ticks = self._ticks[1]
        if self._desk is not None and not self._desk.shelf.is_read:
            await asyncio.to_thread(self._desk.shelf.refresh)
        found = self.lessons(language)
        rows = progress_of(ticks, [] if found is None else found[0])
        return rows if session.may(Right.ARRANGE) else [row for row in rows if row.person == session.name]

    async def done(self, session: Session, lesson: str, language: str) -> LessonProgress:
        """What somebody has done of a lesson to its end, for the certificate.

        Raises:
            ConfigError: it is not done yet.
        """
        for _ in range(DONE_LOOKS):
            for row in await self.progress(session, language):
                if (row.person, row.lesson) == (session.name, lesson) and row.is_done:
                    return row
            run = self.run_of(session)
            if run is None or run.lesson.name != lesson or not run.is_done:
                break
            # The last check has ticked just now: the database has it in a moment.
            await asyncio.sleep(DONE_LOOK_S)
            self._ticks = None
        raise ConfigError(said("{who} has not done this lesson to its end yet", who=session.name))


@cache
def text_html(text: str) -> str:
    """A piece of a lesson as HTML; what is no Markdown is shown as it is written.

    Lessons come from anybody. What Markdown has made of one is sifted: elements of a text, links to pages, and no
    pictures from elsewhere, which would tell somebody who looks at the lesson.
    """
    import markdown2  # only who reads a lesson needs them
    import nh3

    html = str(markdown2.markdown(text, extras=["fenced-code-blocks", "tables"], safe_mode="escape"))
    return nh3.clean(
        html,
        attributes=_ATTRIBUTES,
        attribute_filter=_own_pictures,
        filter_style_properties=_STYLES,
        url_schemes=_SCHEMES,
        link_rel=None,
    )


def _own_pictures(element: str, name: str, value: str) -> str | None:
    is_elsewhere = element == "img" and name == "src" and (":" in value or value.replace("\\", "/").startswith("//"))
    return None if is_elsewhere else value
