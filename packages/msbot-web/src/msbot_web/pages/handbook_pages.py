"""The handbook's pages."""

from __future__ import annotations

from fastapi import Request, Response
from nicegui import ui

from msbot_web import handbook
from msbot_web.pages.layout import page_frame
from msbot_web.service import Service


def register(service: Service) -> None:
    """Make the pages of the handbook known."""

    @ui.page("/handbook")
    def contents(request: Request) -> None:
        with page_frame(service, request, "/handbook", "Handbook") as page:
            for chapter in handbook.chapters():
                with ui.element("div").classes("panel"):
                    ui.label(page.translate(chapter.title)).props("role=heading aria-level=2").style("font-weight:700")
                    for name, title in chapter.pages:
                        ui.link(title, f"/handbook/{name}").style("display:block;padding:.25rem 0")

    @ui.page("/handbook/{name:path}")
    def one(request: Request, name: str) -> None:
        with page_frame(service, request, "/handbook", handbook.title_of(name) or "Handbook") as page:
            ui.link(page.translate("All pages of the handbook"), "/handbook")
            html = handbook.page_html(name)
            if html is None:
                ui.label(page.translate("The handbook has no page {name}.", name=name))
            else:
                ui.html(html, sanitize=False).classes("panel scroll handbook")


def picture_answer(name: str) -> Response:
    """A picture of the handbook, or 404."""
    found = handbook.picture(name)
    return Response(status_code=404) if found is None else Response(found[0], media_type=found[1])
