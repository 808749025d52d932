"""Makes the pages of extensions known, each within the frame of every page."""

from __future__ import annotations

from fastapi import Request
from nicegui import ui

from msbot_web.pages.extension_page import ExtensionPage, brought_pages
from msbot_web.pages.layout import page_frame
from msbot_web.service import Service


def register(service: Service) -> None:
    """Make them known."""
    for path, one in brought_pages().items():
        _register(service, path, one)


def _register(service: Service, path: str, one: ExtensionPage) -> None:
    @ui.page(path)
    def brought(request: Request) -> None:
        with page_frame(service, request, path, one.title) as page:
            if not page.may(one.right):
                ui.label(page.translate("Only a teacher sees this page.")).classes("ms-banner warn")
                return
            one.show(page)
