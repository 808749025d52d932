"""Where lessons are: those that MsBOT and its extensions bring, and those of teachers in folders of their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from msbot.carried.carried_files import carried_folder
from msbot_agent.startup.extensions import extensions
from msbot_agent.text.sentence import said
from msbot_agent.text.similar_names import instead_of
from msbot_school.lessons.lesson import Lesson, LessonQuestion
from msbot_school.lessons.lesson_reader import read_lesson
from msbot_xrce.errors import ConfigError

MOST_LESSONS = 200
"""Most files of one folder that are read."""
MOST_LANGUAGES = 20
SIMPLE = "-simple"
"""Ends the name of a language's folder with texts that are easy to read, as the subtag of RFC 5646: `de-simple`."""
ENGLISH = "en"
"""The language of lessons that have translations."""
EASY_ENGLISH = ENGLISH + SIMPLE


def shipped_folder() -> Path:
    """Where MsBOT's own lessons are."""
    return carried_folder(Path(__file__).parents[1], "lessons/carried", "lessons")


class LessonCatalog:
    """The lessons that there are; a file of a teacher's goes before one of MsBOT's with the same name, and that one
    before an extension's.

    Args:
        folders: folders of teachers.
    """

    def __init__(self, folders: Sequence[Path] = ()) -> None:
        for folder in folders:
            if not folder.is_dir():
                raise ConfigError(said("{folder}: there is no such folder with lessons", folder=str(folder)))
        self._folders = (*extensions().folders("lessons").values(), shipped_folder(), *folders)
        self._read: dict[Path, tuple[int, Lesson | ConfigError]] = {}
        self._lessons: dict[str, Lesson | ConfigError] | None = None
        self._translations: dict[tuple[str, str], Lesson] = {}
        """By the name of the lesson and its language."""
        self._easy: dict[tuple[str, str], tuple[Lesson, Lesson, Lesson]] = {}
        """Easy text, ordinary text, and what came of both: whoever shows it knows by the object whether it is new."""

    @property
    def is_read(self) -> bool:
        """The files have been looked at."""
        return self._lessons is not None

    def refresh(self) -> None:
        """Look at the files again. It reads from a disk: a robot's event loop has a thread do it."""
        lessons, translations = dict[str, Lesson | ConfigError](), dict[tuple[str, str], Lesson]()
        for folder in self._folders:
            for path in sorted(folder.glob("*.md"))[:MOST_LESSONS]:
                lessons[path.stem] = self._at(path)
                for other in sorted(folder.glob(f"*/{path.name}"))[:MOST_LANGUAGES]:
                    found = self._at(other)
                    if isinstance(found, Lesson):
                        translations[path.stem, other.parent.name] = found
        self._lessons, self._translations = lessons, translations

    def get(self, name: str) -> Lesson:
        """The lesson of that name.

        Raises:
            ConfigError: there is none, or its file is wrong.
        """
        found = self._known().get(name)
        if found is None:
            hint = instead_of(name, self._known())
            raise ConfigError(said("there is no lesson {name!r}; {hint}", name=name, hint=hint))
        if isinstance(found, ConfigError):
            raise found
        return found

    def translated(self, lesson: Lesson, language: str) -> Lesson:
        """The lesson in a language, from the folder of that name beside it; as it is where there is none.

        Its checks are those of the lesson: a translation that has others, or cannot be read, is not shown. An easy one
        that is not there is the ordinary one of its language, or the easy English one where that is none, too; what
        teachers read is always the ordinary.
        """
        found = self._translations.get((lesson.name, language))
        if found is not None and _asked(found) != _asked(lesson):
            found = None
        if not language.endswith(SIMPLE):
            return found or lesson
        ordinary = self.translated(lesson, language.removesuffix(SIMPLE))
        if found is None and ordinary is lesson and language != EASY_ENGLISH:
            return self.translated(lesson, EASY_ENGLISH)
        return ordinary if found is None else self._with_teachers_words(found, ordinary, language)

    def is_missing(self, lesson: Lesson, language: str) -> bool:
        """Whether a lesson that is in several languages is not in this one: English is shown in its place.

        Of a lesson without any translation nobody knows what language it is in.
        """
        code = language.removesuffix(SIMPLE)
        there = {other.removesuffix(SIMPLE) for name, other in self._translations if name == lesson.name}
        return bool(there) and code not in there | {ENGLISH}

    def questions(self, lesson: Lesson, check: str) -> list[LessonQuestion]:
        """A question in the other languages that the lesson has."""
        languages = [language for name, language in self._translations if name == lesson.name]
        found = [self.translated(lesson, language).check(check) for language in languages]
        return [one.question for one in found if one is not None and one.question is not None]

    def all(self) -> tuple[list[Lesson], list[str]]:
        """All lessons in their order, and what is wrong with files that are none."""
        found = self._known().values()
        lessons = [one for one in found if isinstance(one, Lesson)]
        wrong = [str(one) for one in found if isinstance(one, ConfigError)]
        return sorted(lessons, key=lambda lesson: (lesson.number, lesson.name)), wrong

    def _with_teachers_words(self, easy: Lesson, ordinary: Lesson, language: str) -> Lesson:
        if any(step.for_teachers for step in easy.steps):
            return easy
        known = self._easy.get((easy.name, language))
        if known is None or known[0] is not easy or known[1] is not ordinary:
            whole = replace(easy, steps=(*easy.steps, *(step for step in ordinary.steps if step.for_teachers)))
            known = self._easy[easy.name, language] = (easy, ordinary, whole)
        return known[2]

    def _known(self) -> dict[str, Lesson | ConfigError]:
        if self._lessons is None:
            self.refresh()
        assert self._lessons is not None
        return self._lessons

    def _at(self, path: Path) -> Lesson | ConfigError:
        try:
            changed = path.stat().st_mtime_ns
        except OSError as error:
            return ConfigError(said("{path}: cannot be read ({reason})", path=str(path), reason=error.strerror or ""))
        known = self._read.get(path)
        if known is not None and known[0] == changed:
            return known[1]
        try:
            found: Lesson | ConfigError = read_lesson(path)
        except ConfigError as error:
            found = error
        self._read[path] = changed, found
        return found


def _asked(lesson: Lesson) -> list[tuple[str, list[str], float, bool]]:
    """What the checks look at, whatever language their words are in."""
    return [
        (check.name, [str(one) for one in check.conditions], check.for_s, check.question is None)
        for check in lesson.checks
    ]
