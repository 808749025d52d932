"""The lesson that runs, as one person does it: its steps, the checks that tick, the questions, hints."""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Mapping, Sequence
from contextlib import nullcontext
from functools import partial
from typing import TYPE_CHECKING, Final
from urllib.parse import quote

from nicegui import ui

from msbot.operations.rights import Right
from msbot_school.lessons.check_authors import Doing
from msbot_school.lessons.conditions import Wired, places
from msbot_school.lessons.lesson import Lesson, LessonCheck, Step
from msbot_school.lessons.lesson_run import others_words
from msbot_web.html import render
from msbot_web.pages.hand_in_dialog import hand_in_dialog
from msbot_web.pages.lesson_code import show_text
from msbot_web.pages.page_elements import ask_first, heading, panel, set_html

if TYPE_CHECKING:
    from msbot_web.pages.page import Page

MOST_SLOTS: Final = 6
"""Most cards that are pointed at."""


class LessonView:
    """The lesson that runs, as one person does it.

    Args:
        page: where.
        beside: it stands beside the robot: one step at a time, and what the step names is pointed at.
    """

    def __init__(self, page: Page, *, beside: bool = False) -> None:
        self._page = page
        self._beside = beside
        self._told: object = None
        """What the browser was told to point at."""
        self._box = ui.column().classes("w-full").style("gap:1rem")
        self._shown: Lesson | None = None
        self._marks: dict[str, ui.html] = {}
        self._says: dict[str, str] = {}
        self._looks: dict[str, str] = {}
        self._wrong: set[str] = set()
        """Questions that this person has answered wrongly."""
        self._hints: dict[str, ui.label] = {}
        self._answers: dict[str, ui.element] = {}
        self._head: ui.html | None = None
        self._now: ui.label | None = None
        self._certificate: ui.link | None = None
        self._buttons: dict[str, ui.button] = {}
        self._steps: OneByOne | None = None
        """Shows one step at a time to who reads easily."""
        page.every_look(self._show)

    def _show(self) -> None:
        lesson = self._page.service.learning.lesson(self._page.reads)
        if lesson is not self._shown:
            self._shown = lesson
            self._box.clear()
            self._marks.clear()
            self._hints.clear()
            self._answers.clear()
            self._buttons.clear()
            self._head = self._now = self._certificate = self._steps = None
            self._told = None
            if lesson is not None:
                with self._box:
                    self._build(lesson)
        if lesson is not None:
            self._follow(self._page.service.learning.now())

    def _build(self, lesson: Lesson) -> None:
        page = self._page
        if self._beside:
            self._bar(lesson)
        else:
            self._title(lesson)
        panels: list[tuple[Step, ui.element]] = []
        for step in lesson.steps:
            if step.for_teachers and (self._beside or not page.may(Right.ARRANGE)):
                continue
            with panel() as shown:
                panels.append((step, shown))
                with _folded(step.title) if step.for_teachers else nullcontext(heading(step.title)):
                    for block in step.blocks:
                        if isinstance(block, LessonCheck):
                            self._check(block)
                        else:
                            show_text(page, lesson.name, block)
        if page.easy or self._beside:
            self._steps = OneByOne(page, panels, at_work=self._beside)

    def _title(self, lesson: Lesson) -> None:
        page, say = self._page, self._page.translate
        with panel():
            with ui.element("div").classes("row spread"):
                heading(lesson.title)
                with ui.element("div").classes("row"):
                    beside = partial(ui.navigate.to, "/arena" if lesson.world else "/")
                    self._button("robot", say("To the robot"), "smart_toy", beside)
                    self._button("join", say("Take part"), "how_to_reg", partial(page.act, "join_lesson"))
                    self._button("hand", say("Ask for help"), "pan_tool", partial(page.act, "hand"))
                    self._button("down", say("No help needed"), "do_not_touch", partial(page.act, "hand", down=True))
                    self._button("hand in", say("Hand in"), "send", partial(hand_in_dialog, page))
                    if page.may(Right.DESIGN):
                        ui.button(say("End the lesson"), icon="logout", on_click=self._end).props("outline")
            if page.service.learning.is_missing(lesson, page.reads):
                ui.label(say("This lesson is not in your language yet: it is shown in English.")).classes("soft")
            self._head = ui.html("", sanitize=False).classes("w-full")

    def _bar(self, lesson: Lesson) -> None:
        """What of the lesson is seen when it is folded: how far one is, and what comes next."""
        say = self._page.translate
        with ui.element("div").classes("ms-lesson-bar w-full"):
            ui.link(say("Lesson"), "/learn")
            self._now = ui.label("").classes("now").props("role=status")
            self._certificate = ui.link(say("Certificate"), f"/learn/certificate/{quote(lesson.name)}")
            fold = ui.button(icon="unfold_more").props("flat round dense").classes("ms-lesson-fold")
            fold.props["aria-label"] = fold.props["title"] = say("Unfold the lesson, or fold it")
            fold.on("click", js_handler="(event) => msbotLesson.fold(event.currentTarget)")

    def _button(self, name: str, words: str, icon: str, deed: object) -> None:
        if self._page.may(Right.OPERATE):
            self._buttons[name] = ui.button(words, icon=icon, on_click=deed).props("outline")  # type: ignore[arg-type]

    def _check(self, check: LessonCheck) -> None:
        say = self._page.translate
        with ui.element("div").classes("ms-check"):
            self._marks[check.name] = ui.html("", sanitize=False)
            self._says[check.name], self._looks[check.name] = check.says, check.hint
            if check.question is not None and self._page.may(Right.OPERATE):
                with ui.element("div").classes("row") as answer:
                    if check.question.choices:
                        field: ui.select | ui.input = ui.select(list(check.question.choices), label=say("Answer"))
                    else:
                        field = ui.input(say("Answer"))
                        field.on("keydown.enter", partial(self._answer, check.name, field))
                    field.props("dense outlined").style("min-width:min(16rem,100%)")
                    ui.button(say("Answer"), on_click=partial(self._answer, check.name, field)).props("outline")
                self._answers[check.name] = answer
            self._hints[check.name] = ui.label("").classes("ms-banner info")

    async def _answer(self, check: str, field: ui.select | ui.input) -> None:
        if await self._page.act("answer_lesson", check=check, answer=str(field.value or "-")) is None:
            self._wrong.add(check)
            self._page.refresh()

    def _end(self) -> None:
        words = self._page.translate("End the lesson? Whatever was changed since it began is put back.")
        ask_first(self._page, words, lambda: self._page.act("stop_lesson"))

    def _follow(self, now: Mapping[str, object]) -> None:
        page, say = self._page, self._page.translate
        learning, me = page.service.learning, page.session.name
        checks, hands, people = now.get("checks"), now.get("hands"), now.get("people")
        assert isinstance(checks, list)
        assert isinstance(hands, dict)
        assert isinstance(people, list)
        mine = learning.of(page.session)
        ticked = {} if mine is None else mine["ticked"]
        assert isinstance(ticked, dict)
        if self._head is not None:
            set_html(
                self._head,
                render(
                    "lesson_head",
                    say=say,
                    ticked=len(ticked),
                    checks=len(checks),
                    people=people,
                    takes_part=mine is not None,
                    hands=list(hands),
                    done=mine is not None and mine["done"],
                    trouble=now.get("trouble"),
                    certificate=f"/learn/certificate/{quote(self._shown.name)}" if self._shown else "",
                ),
            )
        if self._steps is not None:
            self._steps.follow(set(ticked))
        if self._beside:
            self._point(set(ticked), len(checks))
        hint = None if mine is None else mine["hint"]
        stuck = hint if isinstance(hint, dict) else {}
        others = learning.ticks_of_others(page.session)
        for name, mark in self._marks.items():
            one = ticked.get(name)
            note = self._whose(one) if one is not None else ""
            set_html(mark, render("check", say=say, says=self._says[name], ticked=one is not None, note=note))
            if name in self._answers:
                self._answers[name].set_visibility(one is None)
            is_stuck = stuck.get("check") == name
            is_told = (is_stuck or name in self._wrong or name in others) and one is None
            if is_told:
                what_is = others_words(others[name]) if name in others else str(stuck["seen"]) if is_stuck else ""
                seen = say("Seen: {seen}.", seen=say(what_is)) + " " if what_is else ""
                self._hints[name].set_text(f"{seen}{self._looks[name]}")
            self._hints[name].set_visibility(is_told and bool(self._looks[name] or is_stuck or name in others))
        for button, is_shown in (
            ("robot", mine is not None),
            ("join", mine is None),
            ("hand", me not in hands),
            ("down", me in hands),
            ("hand in", mine is not None),
        ):
            if button in self._buttons:
                self._buttons[button].set_visibility(is_shown)

    def _point(self, ticked: Collection[str], count: int) -> None:
        """Say what comes next, and point at what the step that is shown names."""
        step = None if self._steps is None else self._steps.step
        if step is None or self._now is None or self._certificate is None:
            return
        self._certificate.set_visibility(len(ticked) == count)
        missing = [check for check in step.checks if check.name not in ticked]
        words = missing[0].says if missing else step.title
        if step.checks and not missing:
            words = "✓ " + self._page.translate("This step is done: press Next sheet.")
        if len(ticked) == count:
            words = self._page.translate("All done!")
        self._now.set_text(f"{len(ticked)}/{count} · {words}")
        wanted = pointed_at(step, missing)
        if wanted != self._told:
            self._told = wanted
            ui.run_javascript(f"msbotLesson.point({json.dumps(wanted)})")

    def _whose(self, ticked: Mapping[str, object]) -> str:
        """By whose hand a check has ticked, in words; empty: the person's own, or nobody's."""
        if ticked["doing"] == Doing.GROUP.value:
            return self._page.translate("with {who} of your group", who=ticked["by"])
        if ticked["doing"] == Doing.HELPED.value:
            return self._page.translate("{who} helped", who=ticked["by"])
        return ""


class OneByOne:
    """Shows one step of a lesson at a time; the person goes on, and back, by two buttons."""

    def __init__(self, page: Page, panels: Sequence[tuple[Step, ui.element]], *, at_work: bool) -> None:
        self._page = page
        self._at_work = at_work
        """Whether it begins with the first step that has something to do; else, before anything has ticked, at the top."""
        self._panels = panels
        self._at: int | None = None
        with ui.element("nav").classes("row spread w-full").props(f'aria-label="{page.translate("Sheets")}"'):
            self._where = ui.label("").classes("num w-full").props("role=status")
            self._back = ui.button(page.translate("Back"), icon="arrow_back", on_click=partial(self._go, -1)).props(
                "outline"
            )
            self._on = ui.button(page.translate("Next sheet"), icon="arrow_forward", on_click=partial(self._go, 1))

    @property
    def step(self) -> Step | None:
        """The step that is shown."""
        return None if self._at is None else self._panels[self._at][0]

    def follow(self, ticked: Collection[str]) -> None:
        """Begin where the person is; afterwards say whether the step is done."""
        open_checks = [[check for check in step.checks if check.name not in ticked] for step, _ in self._panels]
        if self._at is None:
            is_begun = ticked or self._at_work
            self._at = next((at for at, missing in enumerate(open_checks) if missing), 0) if is_begun else 0
            self._show()
        if open_checks[self._at]:
            self._on.props("outline")
        else:
            self._on.props(remove="outline")

    def _go(self, steps: int) -> None:
        assert self._at is not None
        self._at = min(max(self._at + steps, 0), len(self._panels) - 1)
        self._show()
        # Where the eyes go, the keyboard and the reading voice go, too.
        ui.run_javascript(f"document.getElementById('{self._panels[self._at][1].html_id}').focus()")
        self._page.refresh()

    def _show(self) -> None:
        assert self._at is not None
        for number, (_, shown) in enumerate(self._panels):
            shown.props("tabindex=-1").set_visibility(number == self._at)
        self._back.set_enabled(self._at > 0)
        self._on.set_enabled(self._at < len(self._panels) - 1)
        steps = [number for number, (step, _) in enumerate(self._panels) if step.checks]
        where = ""  # the aim, and what is for teachers, are no steps
        if self._at in steps:
            where = self._page.translate("Step {at} of {steps}", at=steps.index(self._at) + 1, steps=len(steps))
        self._where.set_text(where)


def _folded(title: str) -> ui.element:
    """Where a section for teachers is: whoever does the lesson alone at a demo is its teacher, and unfolds the answers."""
    details = ui.element("details").classes("w-full")
    with details, ui.element("summary"):
        heading(title)
    return details


_BOLD = re.compile(r"\*\*([^*\n]{1,60})\*\*")


def pointed_at(step: Step, missing: Sequence[LessonCheck]) -> dict[str, object]:
    """What a step names: slots and ports of its checks that have not ticked, and the words of buttons and pages."""
    conditions = [condition for check in missing for condition in check.conditions]
    slots = [slot for condition in conditions for found in places(condition) for slot in sorted(found)]
    wires = [condition for condition in conditions if isinstance(condition, Wired)]
    texts = [block for block in step.blocks if isinstance(block, str)] if missing else []
    return {
        "slots": list(dict.fromkeys(slots))[:MOST_SLOTS],
        "ports": [port for wire in wires for port in (wire.source, wire.target)],
        "isWire": bool(wires),
        "words": list(dict.fromkeys(word for text in texts for word in _BOLD.findall(text))),
    }
