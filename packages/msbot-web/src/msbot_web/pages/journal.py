"""The journal: what happened to parts, and what people changed, each change with its undo."""

from __future__ import annotations

from functools import partial

from fastapi import Request
from nicegui import ui

from msbot.operations.rights import Right
from msbot_web.html import render
from msbot_web.models.robot_models import EditLine
from msbot_web.pages.layout import page_frame
from msbot_web.pages.page import Page
from msbot_web.pages.page_elements import set_html
from msbot_web.service import Service
from msbot_web.svg.drawings import state_chip
from msbot_xrce.errors import MsbotError

LINES = 200


def register(service: Service) -> None:
    """Make the page known."""

    @ui.page("/journal")
    def journal(request: Request, part: str = "") -> None:
        with page_frame(service, request, "/journal", "Journal") as page:
            with ui.tabs().props("align=left no-caps") as tabs:
                parts = ui.tab("parts", page.translate("Parts"))
                people = ui.tab("people", page.translate("Changes by people"))
            with ui.tab_panels(tabs, value=parts).classes("w-full").style("background:transparent"):
                with ui.tab_panel(parts).style("padding:0"):
                    _parts(page, part)
                with ui.tab_panel(people).style("padding:0"):
                    _people(page)


def _parts(page: Page, part: str) -> None:
    words = "Part, slot or UID" if page.may(Right.ARRANGE) else "Part or slot"
    find = ui.input(page.translate(words), value=part).props("dense outlined clearable")
    find.style("width:min(24rem,100%)")  # its label in any language
    shown = ui.html("", sanitize=False).classes("w-full panel scroll").props("tabindex=0")

    heads = [page.translate(title) for title in ("Time", "Part", "State", "Reason")]

    async def show() -> None:
        try:
            found, error = await page.service.journal(page.session, LINES, str(find.value or "") or None), ""
        except MsbotError as refused:
            found, error = [], page.translate(str(refused))
        lines = [
            (line, page.when(line.at_ms), state_chip(line.to_state, page.translate(line.to_state))) for line in found
        ]
        set_html(shown, render("journal", say=page.translate, heads=heads, lines=lines, error=error))

    find.on_value_change(lambda: page.show_when_ready(show()))
    page.every_look(show)


def _people(page: Page) -> None:
    table = ui.element("div").classes("panel")
    seen: list[object] = []

    async def show() -> None:
        try:
            edits: list[EditLine] = await page.service.edits(LINES)
        except MsbotError as error:
            if seen != [str(error)]:
                seen[:] = [str(error)]
                table.clear()
                with table:
                    ui.label(page.translate(str(error)))
            return
        if seen == edits and table.default_slot.children:
            return
        seen[:] = edits
        table.clear()
        with table:
            if not edits:
                ui.label(page.translate("Nobody has changed anything yet. Changes appear here, with their undo."))
            for edit in edits:
                with (
                    ui.element("div")
                    .classes("row spread")
                    .style("border-bottom:1px solid var(--line);padding:.35rem 0")
                ):
                    ui.html(render("edit", say=page.translate, edit=edit, when=page.when(edit.at_ms)), sanitize=False)
                    if page.service.may_undo(page.session, edit):
                        ui.button(
                            page.translate("Undo"), icon="undo", on_click=partial(page.act, "undo", edit=edit.number)
                        ).props("flat dense")

    page.every_look(show)
