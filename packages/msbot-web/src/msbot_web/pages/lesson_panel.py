"""The lesson beside the robot: on every page, for whoever takes part in the one that runs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from nicegui import ui

from msbot_web.pages.lesson_view import LessonView

if TYPE_CHECKING:
    from msbot_web.pages.page import Page

WITHOUT: Final = ("/learn", "/projector")
"""Where the whole lesson is, or where nobody does one."""


def show_lesson_panel(page: Page, path: str) -> None:
    """Show it as long as the person takes part."""
    if path in WITHOUT:
        return
    place = ui.element("div")
    place.move(ui.context.client.layout)
    shown: list[bool] = []

    def show() -> None:
        wanted = not page.is_past and page.service.learning.run_of(page.session) is not None
        if shown == [wanted]:
            return
        was_shown = shown == [True]
        shown[:] = [wanted]
        place.clear()
        if wanted:
            with place, ui.element("aside").classes("ms-lesson") as aside:
                aside.props["aria-label"] = page.translate("Lesson")
                LessonView(page, beside=True)
            ui.run_javascript(f"msbotLesson.begin('{aside.html_id}')")
        elif was_shown:
            ui.run_javascript("msbotLesson.stop()")

    page.every_look(show)
