"""The handbook's pages."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import nullcontext

from fastapi import Request, Response
from nicegui import ui

from msbot_web import handbook
from msbot_web.pages.layout import page_frame
from msbot_web.pages.menu import is_pupil
from msbot_web.pages.page import Page
from msbot_web.pages.page_elements import heading, panel
from msbot_web.service import Service


def register(service: Service) -> None:
    """Make the pages of the handbook known."""

    @ui.page("/handbook")
    def contents(request: Request) -> None:
        with page_frame(service, request, "/handbook", "Handbook") as page:
            _in_english(page)
            with _behind_the_first(page) if is_pupil(page) else nullcontext():
                for chapter in handbook.chapters():
                    _chapter(page.translate(chapter.title), chapter.pages)

    @ui.page("/handbook/{name:path}")
    def one(request: Request, name: str) -> None:
        with page_frame(service, request, "/handbook", handbook.title_of(name) or "Handbook") as page:
            ui.link(page.translate("All pages of the handbook"), "/handbook")
            _in_english(page)
            html = handbook.page_html(name)
            if html is None:
                ui.label(page.translate("The handbook has no page {name}.", name=name))
            else:
                ui.html(html, sanitize=False).classes("panel scroll handbook").props("lang=en")


def _in_english(page: Page) -> None:
    if page.language.code != "en":
        ui.label(page.translate("The handbook is in English.")).classes("soft")


def _behind_the_first(page: Page) -> ui.element:
    """What a pupil reads first, and a place for all the rest, which is folded."""
    _chapter(page.translate("For pupils"), [(name, handbook.title_of(name) or name) for name in handbook.FOR_PUPILS])
    folded = ui.element("details").classes("w-full ms-others")
    with folded, ui.element("summary"):
        ui.label(page.translate("All pages of the handbook")).style("display:inline")
    return folded


def _chapter(title: str, pages: Iterable[tuple[str, str]]) -> None:
    with panel():
        heading(title)
        with ui.element("div").classes("ms-contents").props("lang=en"):
            for name, words in pages:
                ui.link(words, f"/handbook/{name}")


def picture_answer(name: str) -> Response:
    """A picture of the handbook, or 404."""
    found = handbook.picture(name)
    return Response(status_code=404) if found is None else Response(found[0], media_type=found[1])
