"""Learn: the lessons, the one that runs with checks that tick by themselves, and how far everybody is."""

from __future__ import annotations

from contextlib import suppress
from functools import partial
from typing import Final

from fastapi import Request
from nicegui import ui

from msbot.operations.rights import Right
from msbot_school.lessons.lesson import Lesson
from msbot_school.lessons.progress import LessonProgress, csv_of
from msbot_web.html import render
from msbot_web.pages.easy_reading import read_easily
from msbot_web.pages.gallery import as_sentence
from msbot_web.pages.hand_ins import HAND_INS, HandInList
from msbot_web.pages.layout import BUILD_S, page_frame
from msbot_web.pages.lesson_view import LessonView
from msbot_web.pages.page import Page
from msbot_web.pages.page_elements import ask_first, heading, panel
from msbot_web.service import Service
from msbot_xrce.errors import MsbotError

DAY: Final = len("2026-11-29")
"""A certificate says the day."""


def register(service: Service) -> None:
    """Make the pages known."""

    @ui.page("/learn")
    def learn(request: Request) -> None:
        with page_frame(service, request, "/learn", "Learn") as page:
            with ui.element("div").classes("row"):
                easy = page.translate("Ordinary text") if page.easy else page.translate("Easy to read")
                ui.button(easy, icon="menu_book", on_click=partial(read_easily, easy=not page.easy)).props("outline")
                leads_to_hand_ins = ui.link("", f"#{HAND_INS}").classes("no-print")
            LessonView(page)
            HandInList(page, leads_to_hand_ins)
            _LessonList(page)
            _Progress(page)

    @ui.page("/learn/certificate/{lesson}", response_timeout=BUILD_S)
    async def certificate(request: Request, lesson: str) -> None:
        with page_frame(service, request, "/learn", "Certificate") as page:
            try:
                done = await service.learning.done(page.session, lesson, page.reads)
            except MsbotError as error:
                ui.label(page.translate(str(error))).classes("ms-banner warn")
                return
            ui.html(
                render(
                    "certificate",
                    say=page.translate,
                    done=done,
                    robot=service.robot_name,
                    when=page.when(done.last_ms)[:DAY],
                    shares=_shares(page, done),
                ),
                sanitize=False,
            )
            ui.button(page.translate("Print"), icon="print", on_click=lambda: ui.run_javascript("window.print()"))


class _LessonList:
    """The lessons that there are."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self._seen: object = None
        with panel().classes("no-print") as self._panel:
            with ui.element("div").classes("row spread"):
                heading(page.translate("Lessons"))
                ui.link(page.translate("Quiz: take bytes and frames apart"), "/learn/quiz")
            self._list = ui.column().classes("w-full").style("gap:0")
        page.every_look(self._show)

    def _show(self) -> None:
        page, say = self._page, self._page.translate
        found = page.service.learning.lessons(page.reads)
        if found is None:
            return
        lessons, wrong = found
        nothing_runs = page.service.learning.lesson("en") is None
        self._panel.set_visibility(nothing_runs or not page.easy)
        seen = ([id(one) for one in lessons], wrong, nothing_runs)
        if seen == self._seen:
            return
        self._seen = seen
        self._list.clear()
        with self._list:
            if not lessons:
                ui.label(say("This robot runs without lessons."))
            elif nothing_runs and not page.may(Right.DESIGN):
                ui.label(say("A teacher begins a lesson. It then stands beside the robot on every page."))
            titles = {one.name: one.title for one in lessons}
            for lesson in lessons:
                with (
                    ui.element("div")
                    .classes("row spread w-full")
                    .style("border-bottom:1px solid var(--line);padding:.35rem 0")
                ):
                    with ui.element("div"):
                        title = ui.label(lesson.title).style("font-weight:650")
                        minutes = page.language.count(lesson.minutes, "{count} minute", "{count} minutes")
                        checks = page.language.count(len(lesson.checks), "{count} check", "{count} checks")
                        if lesson.topic:
                            ui.label(f"{lesson.topic[:1].upper()}{lesson.topic[1:]}.")
                        robot = say("robot: {name}", name=lesson.robot or (lesson.blueprint and lesson.blueprint.stem))
                        world = [say("world: {name}", name=lesson.world)] if lesson.world else []
                        age = [say("from age {age}", age=lesson.age)] if lesson.age else []
                        about = [robot, *world, *age, minutes, checks]
                        if page.service.learning.is_missing(lesson, page.reads):
                            title.props("lang=en")
                            about.append(say("in English"))
                        ui.label(" · ".join(about)).classes("soft num")
                        before = ", ".join(titles.get(name, name) for name in lesson.needs)
                        if before:
                            ui.label(say("first do: {lessons}", lessons=before)).classes("soft")
                        obstacle = page.service.learning.obstacle(lesson) if nothing_runs else ""
                        if obstacle and page.may(Right.DESIGN):
                            ui.label(as_sentence(say(obstacle)))
                            ui.link(say("Robots and worlds"), "/gallery")
                    if page.may(Right.DESIGN) and nothing_runs and not obstacle:
                        begin = ui.button(say("Begin"), icon="play_arrow", on_click=partial(self._begin, lesson))
                        begin.props("outline")
                        begin.props["aria-label"] = f"{say('Begin')}: {lesson.title}"
            if page.may(Right.ARRANGE):
                for words in wrong:
                    ui.label(say(words)).classes("ms-banner warn").style("white-space:pre-wrap")

    async def _begin(self, lesson: Lesson) -> None:
        """Begin at once where nobody's program stops by it, else when the person has read whose do."""
        page = self._page
        begin = partial(page.act, "start_lesson", lesson=lesson.name)
        stops = ""
        with suppress(MsbotError):  # what is wrong with the lesson is said when it is begun
            stops = await page.service.learning.who_stops(lesson.name)
        with page.in_page():
            if not stops:
                await begin()
                return
            question = page.translate("Begin the lesson? The robot has its slots until it ends.")
            ask_first(page, f"{question} {as_sentence(page.translate(stops))}", begin)


class _Progress:
    """How far everybody is; pupils see themselves."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self._rows: list[LessonProgress] | None = None
        with panel().classes("ms-class-table"):
            with ui.element("div").classes("row spread"):
                heading(
                    page.translate("The class") if page.may(Right.ARRANGE) else page.translate("What you have done")
                )
                if page.may(Right.ARRANGE):
                    ui.button(page.translate("Table (CSV)"), icon="download", on_click=self._table).props("flat")
            self._shown = ui.element("div").classes("w-full scroll").props("tabindex=0")
        page.every_look(self._show, self._shown)

    async def _show(self) -> None:
        page, say = self._page, self._page.translate
        rows = await page.service.learning.progress(page.session, page.reads)
        if rows == self._rows:
            return
        self._rows = rows
        self._shown.clear()
        heads = [say("Name"), say("Lesson"), say("Checks"), say("By whom"), say("Begun"), say("Last tick")]
        lines = [(row, _shares(page, row), page.when(row.begun_ms), page.when(row.last_ms)) for row in rows]
        is_own = not page.may(Right.ARRANGE)
        nobody = say("You have not begun a lesson yet.") if is_own else say("Nobody has begun a lesson yet.")
        with self._shown:
            ui.html(
                render("progress", say=say, heads=heads, lines=lines, me=page.session.name, nobody=nobody),
                sanitize=False,
            )

    def _table(self) -> None:
        ui.download.content(csv_of(self._rows or []), "lessons.csv")


def _shares(page: Page, row: LessonProgress) -> list[str]:
    """By whose hands a person's checks are ticked, in sentences."""
    count = page.language.count
    partners = ", ".join(row.partners)
    found = [
        count(row.own, "{count} by own hand.", "{count} by own hand."),
        count(row.group, "{count} with the group ({who}).", "{count} with the group ({who}).", who=partners),
        count(row.helped, "{count} with help ({who}).", "{count} with help ({who}).", who=partners),
        count(row.robot, "{count} by the robot itself.", "{count} by the robot itself."),
    ]
    return [words for words, number in zip(found, (row.own, row.group, row.helped, row.robot), strict=True) if number]
