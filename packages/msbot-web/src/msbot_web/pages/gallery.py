"""Robots and worlds: the sample robots, the worlds that they can be in, the lessons; a demo changes to each by a click."""

from __future__ import annotations

from contextlib import suppress
from functools import partial

from fastapi import Request
from nicegui import ui

from msbot.config import SAMPLES, parse_blueprint
from msbot.operations.rights import Right
from msbot_school.demo.gallery import ROVER, DemoChoice, GalleryEntry
from msbot_school.lessons.lesson import Lesson
from msbot_web.access.sessions import Session
from msbot_web.gallery import Gallery
from msbot_web.html import Markup, render
from msbot_web.models.robot_models import ChangeResult
from msbot_web.pages.layout import BUILD_S, page_frame
from msbot_web.pages.page import Page
from msbot_web.pages.page_elements import heading, page_dialog, panel, show_dialog
from msbot_web.service import Service
from msbot_web.svg.drawings import picture_of

ANSWER_S = 3.0
"""How long the browser may take to say that it knows where to go."""


def register(service: Service) -> None:
    """Make the page known."""

    @ui.page("/gallery", response_timeout=BUILD_S)
    def gallery(request: Request) -> None:
        with page_frame(service, request, "/gallery", "Robots and worlds") as page:
            _GalleryPage(page)


class _GalleryPage:
    """See the module's docstring."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self._gallery: Gallery = page.service.gallery
        self._may = self._gallery.may_change(page.session)
        self._lessons_seen: object = None
        self._how()
        with ui.element("div").classes("grid ms-gallery").props("role=list"):
            for entry in self._gallery.entries:
                self._entry(entry)
        with panel():
            heading(page.translate("Lessons"))
            self._lessons = ui.column().classes("w-full").style("gap:0")
        page.every_look(self._show_lessons)

    def _how(self) -> None:
        page, say = self._page, self._page.translate
        if self._gallery.now is None:
            words = say("This robot stays what it is: only a demo changes its robot. Each card says how to start one.")
        elif not self._may:
            words = say("A teacher chooses the robot; you see here what there is.")
        else:
            words = say("Choose one: it takes this robot's place, and the page comes back by itself.")
        with ui.element("div").classes("row spread w-full"):
            ui.label(words).classes("soft")
            back_to_rover(page)

    def _entry(self, entry: GalleryEntry) -> None:
        page, say = self._page, self._page.translate
        is_now = entry.choice == self._gallery.now
        title = say(entry.title)
        with ui.element("div").classes("panel ms-exhibit").props("role=listitem"):
            ui.html(picture(entry.choice, page), sanitize=False).classes("ms-exhibit-picture").props("aria-hidden=true")
            heading(title)
            ui.label(say(entry.teaches))
            about = [say("from age {age}", age=entry.age)] if entry.age else []
            if entry.minutes:
                about.append(page.language.count(entry.minutes, "{count} minute", "{count} minutes"))
            ui.label(" · ".join(about)).classes("soft num")
            if entry.example and page.may(Right.JOIN):
                ui.link(say("Example: {name}", name=entry.example), f"/program?name={entry.example}")
            if is_now:
                ui.label(say("Running now.")).classes("ms-exhibit-now")
            elif self._may:
                start = ui.button(say("Start"), icon="play_arrow", on_click=partial(change, page, entry.choice))
                start.props["aria-label"] = f"{say('Start')}: {title}"
            elif self._gallery.now is None:
                ui.label(entry.choice.command).classes("mono")

    def _show_lessons(self) -> None:
        page, say = self._page, self._page.translate
        found = page.service.learning.lessons(page.reads)
        if found is None:
            return
        running = page.service.learning.lesson("en")
        seen = ([id(one) for one in found[0]], running is None)
        if seen == self._lessons_seen:
            return
        self._lessons_seen = seen
        self._lessons.clear()
        with self._lessons:
            for lesson in found[0]:
                self._lesson(lesson)
            if not found[0]:
                ui.label(say("This robot runs without lessons."))

    def _lesson(self, lesson: Lesson) -> None:
        page, say = self._page, self._page.translate
        place = next(
            (one.title for one in self._gallery.entries if (one.choice.robot, one.choice.world) == _place(lesson)), ""
        )
        with ui.element("div").classes("row spread w-full line"):
            with ui.element("div"):
                ui.label(lesson.title)
                minutes = page.language.count(lesson.minutes, "{count} minute", "{count} minutes")
                ui.label(" · ".join(filter(None, (say(place) if place else "", minutes)))).classes("soft num")
            if self._may:
                start = ui.button(
                    say("Start"),
                    icon="play_arrow",
                    on_click=partial(change, page, DemoChoice(*_place(lesson)), lesson.name),
                ).props("outline")
                start.props["aria-label"] = f"{say('Start')}: {lesson.title}"


def _place(lesson: Lesson) -> tuple[str, str]:
    return lesson.robot or ROVER.robot, lesson.world


def back_to_rover(page: Page) -> None:
    """The button that leads back to the first robot, where another one runs."""
    gallery = page.service.gallery
    if gallery.may_change(page.session) and gallery.now != ROVER:
        ui.button(page.translate("Back to the rover"), icon="undo", on_click=partial(change, page, ROVER)).props(
            "outline"
        )


async def change(page: Page, choice: DemoChoice, lesson: str = "") -> None:
    """Have another robot: at once where nothing ends by it, else when the person has read what does."""
    ends = page.service.gallery.what_ends(choice, lesson)
    if not ends:
        await _change(page, choice, lesson, agreed=False)
        return
    with page_dialog(page).props("no-backdrop-dismiss") as dialog, ui.card():
        ui.label(page.translate("Another robot in this one's place?")).props("role=heading aria-level=2")
        for words in ends:
            ui.label(as_sentence(page.translate(words)))

        async def agree() -> None:
            dialog.close()
            with page.in_page():
                await _change(page, choice, lesson, agreed=True)

        with ui.element("div").classes("row"):
            ui.button(page.translate("Yes, change"), on_click=agree)
            ui.button(page.translate("Cancel"), on_click=dialog.close).props("flat")
    show_dialog(dialog)


async def _change(page: Page, choice: DemoChoice, lesson: str, *, agreed: bool) -> None:
    async def deed(session: Session) -> ChangeResult:
        return await page.service.gallery.change(session, choice, lesson, agreed=agreed)

    path = "/learn" if lesson else "/arena" if choice.world else "/"
    with suppress(TimeoutError):  # a page that does not answer comes back to where it is
        await ui.run_javascript(f"msbotChannel.comeBackTo('{path}')", timeout=ANSWER_S)
    done = await page.do(deed)
    if not page.service.gallery.is_changing:
        with page.in_page():
            ui.run_javascript("msbotChannel.comeBackTo('')")
            if done is not None:
                ui.navigate.to(path)


def as_sentence(words: str) -> str:
    """Words that begin small and end without a full stop, as a sentence of its own."""
    return f"{words[:1].upper()}{words[1:]}."


def picture(choice: DemoChoice, page: Page) -> Markup:
    """What a robot or its world looks like."""
    if choice.world:
        from msbot.sim.arena.world_drawing import world_svg
        from msbot.sim.arena.world_reader import open_world

        return Markup(world_svg(open_world(choice.world)))
    library = page.service.views.library
    blueprint = parse_blueprint(SAMPLES[choice.robot], library)
    types = [library.get(slot.part_number) for slot in blueprint.slots]
    return render("exhibit", pictures=[picture_of(one) for one in types if one is not None])
