"""Reads a lesson: a Markdown file with a small header, and checks between its lines."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from msbot.config import SAMPLES
from msbot.operations.fault_request import FaultRequest
from msbot_agent.text.sentence import said
from msbot_agent.text.untrusted_input import open_input_text
from msbot_agent.toml.document import MOST_BYTES, parse_document
from msbot_agent.toml.problems import FileLocation, Problems, suggestion
from msbot_agent.toml.table import Table
from msbot_school.lessons.conditions import Condition, read_lesson_condition
from msbot_school.lessons.lesson import Lesson, LessonCheck, LessonQuestion, Step
from msbot_xrce.errors import ConfigError

FOR_TEACHERS: Final = ("For the teacher", "Answers", "Für die Lehrkraft", "Antworten")
"""Sections that only teachers read."""
MOST_CHECKS: Final = 100
LONGEST_S: Final = 600.0
_FENCE: Final = re.compile(r"^```(?P<kind>check|question)\s*$")
_HEADER: Final = "+++"


def read_lesson(path: Path) -> Lesson:
    """Read a lesson.

    Raises:
        ConfigError: the file cannot be read, or is wrong; the text names every problem with line and remedy.
    """
    problems = Problems()
    try:
        with open_input_text(path, encoding="utf-8-sig") as stream:
            text = stream.read(MOST_BYTES + 1)  # it may be a device without an end
        if len(text) > MOST_BYTES or path.stat().st_size > MOST_BYTES:
            raise ConfigError(said("{path}: a lesson has at most {most} bytes", path=str(path), most=MOST_BYTES))
    except OSError as error:
        raise ConfigError(
            said("{path}: cannot be read ({reason})", path=str(path), reason=error.strerror or "")
        ) from None
    except UnicodeDecodeError:
        raise ConfigError(said("{path}: is no text in UTF-8; save it as UTF-8", path=str(path))) from None
    lesson = _Reader(path, text.splitlines(), problems).read()
    problems.raise_if_any()
    assert lesson is not None
    return lesson


class _Reader:
    def __init__(self, path: Path, lines: Sequence[str], problems: Problems) -> None:
        self._path = path
        self._lines = lines
        self._problems = problems

    def read(self) -> Lesson | None:
        """The lesson; None after a problem that leaves nothing to read."""
        end = next((at for at, line in enumerate(self._lines[1:], 1) if line.strip() == _HEADER), None)
        if not self._lines or self._lines[0].strip() != _HEADER or end is None:
            self._problem(1, said("a lesson begins with a header between two lines {header}", header=_HEADER))
            return None
        header = self._toml(1, end)
        steps = self._steps(end + 1)
        if header is None:
            return None
        title = header.name("title", "Your first part")
        robot = header.text("robot", "rover")
        blueprint = header.text("blueprint", "robots/ring.toml")
        if not robot and not blueprint:
            header.report(said('is missing; add robot = "rover", or blueprint = "FILE" for one of your own'), "robot")
        if robot and robot not in SAMPLES:
            header.report(
                said(
                    "there is no sample {robot!r}; {right}",
                    robot=robot,
                    right=suggestion(robot, sorted(SAMPLES), none_known=""),
                ),
                "robot",
            )
        if blueprint and not (self._path.parent / blueprint).is_file():
            header.report(said("there is no such file beside the lesson"), "blueprint")
        lesson = Lesson(
            name=self._path.stem,
            title=title,
            minutes=header.whole("minutes", default=45, least=1, most=600),
            number=header.whole("number", default=100, least=0, most=10_000),
            steps=tuple(steps),
            robot=robot,
            blueprint=self._path.parent / blueprint if blueprint else None,
            world=header.text("world", "line"),
            unplugged=tuple(header.names("unplugged", "knob")),
            spares=tuple(header.names("spares", "knob")),
            settings=self._settings(header.table("settings")),
            faults=tuple(_fault(table) for table in header.tables("fault")),
            hint_after_s=header.number("hint_after_s", default=60.0, least=1.0, most=3600.0, unit="s"),
            file=self._path,
            topic=header.text("topic", "slots, ports, beats"),
            age=header.whole("age", default=0, least=0, most=99),
            needs=tuple(header.names("needs", "first_part")),
        )
        header.finish()
        if not lesson.checks:
            self._problem(end + 1, said("no step has a check: nothing would ever tick"))
        return lesson

    def _steps(self, begin: int) -> list[Step]:
        steps: list[Step] = []
        title, blocks, text = "", list[str | LessonCheck](), list[str]()
        count = 0
        at = begin

        def close_text() -> None:
            if words := "\n".join(text).strip("\n"):
                blocks.append(words)
            text.clear()

        def close_step() -> None:
            close_text()
            if title or blocks:
                steps.append(Step(title, tuple(blocks), for_teachers=title in FOR_TEACHERS))
            blocks.clear()

        inside = False
        while at < len(self._lines):
            line = self._lines[at]
            found = None if inside else _FENCE.match(line)
            if found is not None:
                end = next((one for one in range(at + 1, len(self._lines)) if self._lines[one].strip() == "```"), None)
                if end is None:
                    self._problem(at + 1, said("this block does not end: add a line ```"))
                    break
                count += 1
                close_text()
                number = sum(isinstance(block, LessonCheck) for block in blocks) + 1
                check = self._check(
                    found["kind"], f"{1 + sum(1 for step in steps if step.checks)}.{number}", at + 1, end
                )
                if check is not None and count <= MOST_CHECKS:
                    blocks.append(check)
                at = end + 1
                continue
            if line.startswith("```"):
                inside = not inside
            if not inside and line.startswith("## "):
                close_step()
                title = line.removeprefix("## ").strip()
            else:
                text.append(line)
            at += 1
        close_step()
        if count > MOST_CHECKS:
            self._problem(begin, said("a lesson has at most {most} checks", most=MOST_CHECKS))
        return steps

    def _check(self, kind: str, name: str, begin: int, end: int) -> LessonCheck | None:
        table = self._toml(begin, end)
        if table is None:
            return None
        says = table.name("say", "The knob is active.")
        hint = table.text("hint", "Look at the card of the knob.")
        if kind == "question":
            question = self._question(table)
            table.finish()
            return LessonCheck(name, says, question=question, hint=hint, line=begin)
        texts = table.one_or_more("when", "knob is active")
        conditions: list[Condition] = []
        for text in texts:
            try:
                conditions.append(read_lesson_condition(text))
            except ConfigError as error:
                table.report(str(error), "when")
        for_s = table.number("for", default=0.0, least=0.0, most=LONGEST_S, unit="s")
        table.finish()
        return LessonCheck(name, says, tuple(conditions), for_s, hint=hint, line=begin)

    @staticmethod
    def _question(table: Table) -> LessonQuestion:
        right = table.one_or_more("answer", "42")
        choices = table.names("choices", "active")
        for one in right:
            if choices and one not in choices:
                table.report(said("the right answer {one!r} is none of the choices", one=one), "choices")
        tolerance = table.number("tolerance", default=0.0, least=0.0, most=1e12)
        return LessonQuestion(tuple(right), tolerance, tuple(choices), table.text("unit", "s"))

    def _toml(self, begin: int, end: int) -> Table | None:
        """The lines `begin` up to `end`, counted from 0, `end` excluded; mistakes have the lines of the whole file."""
        document = parse_document(
            "\n" * begin + "\n".join(self._lines[begin:end]) + "\n", str(self._path), self._problems
        )
        if document is None:
            return None
        # What is missing is missing in this block, not anywhere in the file.
        document = replace(document, begins=begin)
        return Table(document, self._problems, document.values)

    @staticmethod
    def _settings(table: Table) -> dict[str, dict[str, str]]:
        return {
            slot: {name: str(value) for name, value in table.scalars(slot).items()} for slot in table.present_keys()
        }

    def _problem(self, line: int, sentence: str) -> None:
        self._problems.add(FileLocation(str(self._path), line), sentence)


def _fault(table: Table) -> FaultRequest:
    wish = FaultRequest(
        kind=table.name("kind", "loss"),
        at=table.text("at", "knob"),
        amount=table.number("amount", default=0.0, least=-1e9, most=1e9) if "amount" in table else None,
        port=table.text("port", "level"),
        after_s=table.number("after", default=0.0, least=0.0, most=3600.0, unit="s"),
        for_s=table.number("for", default=600.0, least=0.1, most=3600.0, unit="s"),
        when=table.text("when", "knob.level > 60"),
        hidden=table.flag("hidden", default=True),
    )
    table.finish()
    return wish
