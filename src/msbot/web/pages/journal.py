"""The journal: what happened to parts, and what people changed, each change with its undo."""

from __future__ import annotations

from datetime import datetime
from functools import partial
from html import escape

from fastapi import Request
from nicegui import ui

from msbot.errors import MsbotError
from msbot.web.drawings import state_chip
from msbot.web.models import EditLine
from msbot.web.pages.layout import Page, page_frame
from msbot.web.service import Service

LINES = 200


def register(service: Service) -> None:
    """Make the page known."""

    @ui.page("/journal")
    def journal(request: Request, part: str = "") -> None:
        with page_frame(service, request, "/journal", "Journal") as page:
            with ui.tabs().props("align=left no-caps") as tabs:
                parts = ui.tab("parts", page.say("Parts"))
                people = ui.tab("people", page.say("Changes by people"))
            with ui.tab_panels(tabs, value=parts).classes("w-full").style("background:transparent"):
                with ui.tab_panel(parts).style("padding:0"):
                    _parts(page, part)
                with ui.tab_panel(people).style("padding:0"):
                    _people(page)


def _parts(page: Page, part: str) -> None:
    find = ui.input(page.say("Part, slot or UID"), value=part).props("dense outlined clearable")
    shown = ui.html("", sanitize=False).classes("w-full panel scroll")

    def show() -> None:
        try:
            lines = page.service.journal(LINES, str(find.value or "") or None)
        except MsbotError as error:
            shown.set_content(escape(str(error)))
            return
        rows = "".join(
            f'<tr><td class="num">{_when(line.at_ms)}</td><td><b>{escape(line.part)}</b><div class="soft">{escape(line.slot)}</div></td>'
            f"<td>{state_chip(line.to_state, page.say(line.to_state))}</td><td>{escape(line.reason)}"
            + (
                f"<details><summary class='soft'>{escape(page.say('evidence'))}</summary>"
                + "".join(
                    f"<div class='soft'>{escape(rule)}: {escape(outcome)}</div>" for rule, outcome in line.evidence
                )
                + "</details>"
                if line.evidence
                else ""
            )
            + "</td></tr>"
            for line in lines
        )
        head = "".join(f"<th>{escape(page.say(title))}</th>" for title in ("Time", "Part", "State", "Reason"))
        table = f'<table class="ms-table stack"><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>'
        content = table if rows else escape(page.say("Nothing yet."))
        if shown.content != content:
            shown.set_content(content)

    find.on_value_change(show)
    page.every_look(show)


def _people(page: Page) -> None:
    table = ui.element("div").classes("panel")
    seen: list[object] = []

    def show() -> None:
        try:
            edits: list[EditLine] = page.service.edits(LINES)
        except MsbotError as error:
            if seen != [str(error)]:
                seen[:] = [str(error)]
                table.clear()
                with table:
                    ui.label(str(error))
            return
        if seen == edits and table.default_slot.children:
            return
        seen[:] = edits
        table.clear()
        with table:
            if not edits:
                ui.label(page.say("Nobody has changed anything yet."))
            for edit in edits:
                with (
                    ui.element("div")
                    .classes("row spread")
                    .style("border-bottom:1px solid var(--line);padding:.35rem 0")
                ):
                    ui.html(
                        f'<span class="num soft">{_when(edit.at_ms)}</span> <b>{escape(edit.who)}</b> {escape(edit.words)}'
                        + (f' <span class="origin">{escape(page.say("undone"))}</span>' if edit.undone else ""),
                        sanitize=False,
                    )
                    if page.service.may_undo(page.session, edit):
                        ui.button(page.say("Undo"), icon="undo", on_click=partial(_undo, page, edit.number)).props(
                            "flat dense"
                        )

    page.every_look(show)


def _undo(page: Page, number: int) -> None:
    page.do(lambda session: page.service.undo(session, number))


def _when(at_ms: int) -> str:
    return datetime.fromtimestamp(at_ms / 1000).strftime("%Y-%m-%d %H:%M:%S")
