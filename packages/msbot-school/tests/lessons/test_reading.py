"""Lesson files: what a teacher may write, and what is said of mistakes."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest

from msbot_agent.toml.problems import InvalidFileError
from msbot_school.lessons.catalog import LessonCatalog
from msbot_school.lessons.conditions import EXAMPLES, read_lesson_condition
from msbot_school.lessons.lesson import Lesson, LessonCheck
from msbot_school.lessons.lesson_reader import read_lesson
from msbot_xrce.errors import ConfigError

HEAD = '+++\ntitle = "T"\nrobot = "rover"\n+++\n'
CHECK = '```check\nsay = "The fan runs."\nwhen = "fan is active"\n```\n'


def lesson(folder: Path, text: str) -> Path:
    path = folder / "mine.md"
    path.write_text(text)
    return path


def test_a_small_lesson(tmp_path: Path) -> None:
    path = lesson(
        tmp_path,
        HEAD + "Before.\n\n## One\n\nText.\n" + CHECK + "More.\n"
        '```question\nsay = "How many?"\nanswer = ["ten", "10"]\ntolerance = 0.5\n```\n'
        "```python\n## no heading\n```\n## For the teacher\nSecret.\n",
    )
    read = read_lesson(path)
    assert (read.name, read.title, read.minutes, read.hint_after_s) == ("mine", "T", 45, 60.0)
    before, one, teacher = read.steps
    assert before.blocks == ("Before.",)
    assert [check.name for check in one.checks] == ["1.1", "1.2"]
    assert one.checks[0].says == "The fan runs."
    assert [str(one) for one in one.checks[0].conditions] == ["fan is active"]
    question = one.checks[1].question
    assert question is not None
    assert [question.is_right(text) for text in ("10", " TEN ", "10,4", "10.6", "nine")] == [
        True,
        True,
        True,
        False,
        False,
    ]
    assert one.blocks[-1] == "```python\n## no heading\n```"
    assert teacher.for_teachers
    assert not one.for_teachers


BODY = "## A\n" + CHECK
MISTAKES = {
    "no header": ("Text\n" + CHECK, 1, "begins with a header between two lines +++"),
    "header without end": ("+++\ntitle = 'T'\n", 1, "begins with a header"),
    "no title": ('+++\nrobot = "rover"\n+++\n' + BODY, 1, "title: is missing; add a line such as title ="),
    "no robot": ('+++\ntitle = "T"\n+++\n' + BODY, 1, 'robot: is missing; add robot = "rover"'),
    "unknown robot": (HEAD.replace("rover", "rovr") + BODY, 3, "there is no sample 'rovr'; did you mean \"rover\"?"),
    "no blueprint": (HEAD.replace("robot =", "blueprint =") + BODY, 3, "there is no such file beside the lesson"),
    "unknown key": (HEAD.replace("robot", "minuts = 4\nrobot") + BODY, 3, 'no such key here; did you mean "minutes"?'),
    "nothing ticks": (HEAD + "## A\nText\n", 4, "no step has a check: nothing would ever tick"),
    "no end": (HEAD + "## A\n```check\nsay = 'x'\n", 6, "this block does not end: add a line ```"),
    "no condition": (HEAD + "## A\n```check\nsay = 'x'\n```\n", 6, "when: is missing"),
    "strange condition": (HEAD + BODY.replace("is active", "runs"), 8, "'fan runs' cannot be read; write for"),
    "strange state": (HEAD + BODY.replace("active", "aktiv"), 8, "there is no state 'aktiv'; there are empty, new"),
    "too long": (HEAD + BODY.replace("say =", "for = 6000\nsay ="), 7, "must be"),
    "no answer": (HEAD + "## A\n```question\nsay = 'x'\n```\n", 6, "answer: is missing"),
    "answer is no choice": (
        HEAD + "## A\n```question\nsay = 'x'\nanswer = 'a'\nchoices = ['b']\n```\n", 9,
        "the right answer 'a' is none of the choices",
    ),
    "no TOML": (HEAD + "## A\n```check\nsay = \n```\n", 7, ""),
}  # fmt: skip


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_told_with_its_line(name: str, tmp_path: Path) -> None:
    text, line, words = MISTAKES[name]
    with pytest.raises(InvalidFileError) as found:
        read_lesson(lesson(tmp_path, text))
    assert any(
        problem.place.line == line and words in f"{problem.place}: {problem.sentence}"
        for problem in found.value.problems
    ), str(found.value)


def test_a_file_that_is_none(tmp_path: Path) -> None:
    for octets, words in ((b"\xff\xfe\x00", "is no text in UTF-8"), (b"x" * 300_000, "at most 256000 bytes")):
        path = tmp_path / "bad.md"
        path.write_bytes(octets)
        with pytest.raises(ConfigError, match=words):
            read_lesson(path)
    with pytest.raises(ConfigError, match="cannot be read"):
        read_lesson(tmp_path / "none.md")


def test_every_kind_of_condition_is_read_and_written_alike() -> None:
    for text in EXAMPLES:
        assert str(read_lesson_condition(text)) == text
    assert str(read_lesson_condition("not BB has DD")) == "not BB has DD"
    with pytest.raises(ConfigError, match="at most 200 characters"):
        read_lesson_condition("x" * 201)


def test_a_teachers_lesson_goes_before_one_of_ours_and_a_wrong_one_is_named(tmp_path: Path) -> None:
    mine = tmp_path / "ring.md"
    mine.write_text(HEAD + "## A\n" + CHECK)
    (tmp_path / "wrong.md").write_text("no lesson")
    shelf = LessonCatalog([tmp_path])
    assert shelf.get("ring").title == "T"
    lessons, wrong = shelf.all()
    assert "T" in {one.title for one in lessons}
    assert len(wrong) == 1
    assert "wrong.md" in wrong[0]
    mine.write_text(HEAD.replace('"T"', '"U"') + "## A\n" + CHECK)
    os.utime(mine, ns=(0, 0))  # another time of change, however quick the test is
    assert shelf.get("ring").title == "T"
    shelf.refresh()
    assert shelf.get("ring").title == "U"
    with pytest.raises(ConfigError, match="there is no lesson 'none'; there are"):
        shelf.get("none")
    with pytest.raises(ConfigError, match="there is no such folder"):
        LessonCatalog([tmp_path / "nowhere"])


def test_a_translation_is_shown_only_if_it_asks_the_same(tmp_path: Path) -> None:
    question = '```question\nsay = "Who?"\nanswer = "nobody"\nchoices = ["nobody", "all"]\n```\n'
    (tmp_path / "mine.md").write_text(HEAD + "## A\n" + CHECK + question)
    (tmp_path / "de").mkdir()
    german = tmp_path / "de" / "mine.md"
    german.write_text((HEAD + "## A\n" + CHECK + question).replace("nobody", "niemand").replace('"T"', '"D"'))
    shelf = LessonCatalog([tmp_path])
    lesson = shelf.get("mine")
    assert shelf.translated(lesson, "de").title == "D"
    assert shelf.translated(lesson, "fr") is lesson
    assert [one.is_right("niemand") for one in shelf.questions(lesson, "1.2")] == [True]
    german.write_text((HEAD + "## A\n" + CHECK.replace("fan", "ear") + question).replace('"T"', '"D"'))
    assert LessonCatalog([tmp_path]).translated(lesson, "de") is lesson


def test_an_easy_text_goes_back_to_the_ordinary_one_and_teachers_read_that(tmp_path: Path) -> None:
    teachers = "## For the teacher\nSecret.\n"
    (tmp_path / "mine.md").write_text(HEAD + "## A\n" + CHECK + teachers)
    (tmp_path / "de").mkdir()
    (tmp_path / "de" / "mine.md").write_text((HEAD + "## A\n" + CHECK + teachers).replace("Secret", "Geheim"))
    shelf = LessonCatalog([tmp_path])
    lesson = shelf.get("mine")
    assert shelf.translated(lesson, "en-simple") is lesson
    assert shelf.translated(lesson, "de-simple") is shelf.translated(lesson, "de")
    (tmp_path / "de-simple").mkdir()
    easy = tmp_path / "de-simple" / "mine.md"
    easy.write_text(HEAD.replace('"T"', '"E"') + "## A\nKurz.\n" + CHECK)
    shelf.refresh()
    found = shelf.translated(lesson, "de-simple")
    assert (found.title, found.steps[0].blocks[0], found.steps[-1].blocks) == ("E", "Kurz.", ("Geheim.",))
    shelf.refresh()
    assert shelf.translated(shelf.get("mine"), "de-simple") is found, "the same until a file has changed"
    easy.write_text(HEAD + "## A\n" + CHECK.replace("fan", "ear"))
    os.utime(easy, ns=(0, 0))
    shelf.refresh()
    assert shelf.translated(lesson, "de-simple") is shelf.translated(lesson, "de"), "it asks something else"


@pytest.mark.parametrize("language", ["de", "en-simple", "de-simple"])
def test_our_own_lessons_are_in_every_language_of_the_page_and_easy(language: str) -> None:
    shelf = LessonCatalog()
    for lesson in shelf.all()[0]:
        found = shelf.translated(lesson, language)
        assert found not in (lesson, shelf.translated(lesson, "de" if language != "de" else "")), lesson.name
        assert all(check.hint for check in found.checks), f"{language}/{lesson.name}.md: each check has a hint"
        if language.endswith("simple"):
            sentences = [one for text in _told(found) for one in re.split(r"[.:?!](?:\s|$)", text)]
            longest = max(sentences, key=lambda one: len(one.split()))
            assert len(longest.split()) <= 15, f"{language}/{lesson.name}.md: a long sentence: {longest}"


def _told(lesson: Lesson) -> list[str]:
    """What pupils read, without programs."""
    found = []
    for step in lesson.steps:
        for block in () if step.for_teachers else step.blocks:
            if isinstance(block, LessonCheck):
                found += [block.says, block.hint]
            else:
                found += re.sub(r"```.*?```", "", block, flags=re.DOTALL).splitlines()
    return found
