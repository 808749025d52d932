"""The settings (the thesis' Manual Configuration Management System): slots, wiring, and the blueprint as a whole."""

from __future__ import annotations

from functools import partial

from fastapi import Request
from markupsafe import Markup
from nicegui import ui
from nicegui.events import UploadEventArguments

from msbot.operations.rights import Right
from msbot_web.html import render
from msbot_web.pages.layout import BUILD_S, page_frame
from msbot_web.pages.page import Page
from msbot_web.pages.page_elements import file_button, heading
from msbot_web.pages.parameter_form import parameter_panel
from msbot_web.service import MAX_BLUEPRINT, Service
from msbot_xrce.errors import MsbotError

MOST_FORMS = 40
"""Slots whose forms are shown at once; a page with a thousand of them would hold the robot up."""


def register(service: Service) -> None:
    """Make the page known."""

    @ui.page("/settings", response_timeout=BUILD_S)
    async def settings(request: Request) -> None:
        with page_frame(service, request, "/settings", "Settings") as page:
            with ui.tabs().props("align=left no-caps") as tabs:
                slots = ui.tab("slots", page.translate("Slots"))
                robot = ui.tab("robot", page.translate("Robot"))
                blueprint = ui.tab("blueprint", page.translate("Blueprint"))
            with ui.tab_panels(tabs, value=slots).classes("w-full").style("background:transparent"):
                with ui.tab_panel(slots).style("padding:0"):
                    _slots(page)
                with ui.tab_panel(robot).style("padding:0"):
                    _robot(page)
                with ui.tab_panel(blueprint).style("padding:0"):
                    await _blueprint(page)


def _slots(page: Page) -> None:
    """The forms of the slots; of a large robot those that fit what is searched for."""
    cards = page.service.views.slots()
    if len(cards) > MOST_FORMS:
        find = (
            ui.input(page.translate("Search"), placeholder="fan, POT-10K").props("outlined clearable").classes("w-full")
        )
        find.on_value_change(lambda: fill(str(find.value or "")))
    count = ui.label("").classes("soft").props("role=status")
    grid = ui.element("div").classes("grid")
    grid.style("grid-template-columns:repeat(auto-fill,minmax(min(24rem,100%),1fr))")

    def fill(wanted: str) -> None:
        words = wanted.casefold().split()
        texts = [
            (card, f"{card.name} {card.shown_number} {card.type_name} {page.translate(card.type_name)}".casefold())
            for card in cards
        ]
        found = [card for card, text in texts if all(word in text for word in words)]
        count.set_text(
            page.translate("{count} slots; {shown} are shown.", count=len(found), shown=min(len(found), MOST_FORMS))
        )
        count.set_visibility(len(found) > MOST_FORMS or not found)
        grid.clear()
        with grid:
            for card in found[:MOST_FORMS]:
                with ui.element("div").classes("panel"):
                    ui.html(render("slot_title", say=page.translate, card=card), sanitize=False)
                    parameter_panel(page, card.name)

    fill("")


def _robot(page: Page) -> None:
    robot, say, number = page.service.robot(), page.translate, partial(page.number, form="g")
    facts = [
        (say("name"), robot.name),
        (say("version"), robot.version),
        (say("serial number"), robot.serial_number),
        (say("released"), robot.released),
        (say("manufacturer"), robot.manufacturer),
        (say("links"), ", ".join(robot.links)),
        (say("a part beats every"), f"{number(robot.beat_s)} s"),
        (say("life is counted down every"), f"{number(robot.tick_s)} s"),
        (say("life after a beat"), str(robot.life)),
        (
            say("a silent part is delisted after"),
            f"{number((robot.life - 1) * robot.tick_s)} – {number(robot.life * robot.tick_s)} s",
        ),
    ]
    words = say("These come from the blueprint: change them there.")
    ui.html(render("facts", facts=facts, words=words), sanitize=False).classes("w-full")


async def _blueprint(page: Page) -> None:
    try:
        text = await page.service.blueprint()
    except MsbotError as error:
        ui.label(page.translate(str(error))).classes("ms-banner warn")
        return
    with ui.element("div").classes("panel"):
        heading("robot.toml")
        if page.may(Right.DESIGN):
            _blueprint_editor(page, text)
        else:
            shown = Markup('<pre class="mono scroll" tabindex="0" style="max-height:24rem">{}</pre>').format(text)
            ui.html(shown, sanitize=False).classes("w-full")
            with ui.element("div").classes("row").style("margin-top:.6rem"):
                _download(page)


def _blueprint_editor(page: Page, text: str) -> None:
    """The blueprint for who may change it: edited, compared, applied."""
    from msbot_web.pages.program_editor import Editor  # with CodeMirror, which the first page does not need

    service, say = page.service, page.translate
    ui.label(say("Edit, look at what would change, then apply.")).classes("soft")
    editor = Editor(text, language="TOML").style("height:24rem;border:1px solid var(--line)")
    editor.line_wrapping = True
    changes = ui.html("", sanitize=False).classes("w-full").props("aria-live=polite")

    async def compare() -> bool:
        try:
            diff = await service.blueprint_diff(page.session, str(editor.value))
        except MsbotError as error:
            changes.set_content(render("changes", say=say, error=say(str(error)), changes=[]))
            return False
        changes.set_content(render("changes", say=say, error="", changes=diff.changes))
        return bool(diff.changes)

    async def apply() -> None:
        if not await compare():
            return
        if await page.do(lambda session: service.apply_blueprint(session, str(editor.value))) is not None:
            editor.value = await service.blueprint()
            changes.set_content("")

    async def upload(event: UploadEventArguments) -> None:
        content = await event.file.read()
        try:
            editor.value = content.decode("utf-8")
        except UnicodeDecodeError:
            ui.notify(say("This file is not UTF-8 text."), type="negative")
            return
        await compare()

    with ui.element("div").classes("row").style("margin-top:.6rem"):
        ui.button(say("Compare"), icon="difference", on_click=compare).props("outline")
        ui.button(say("Apply"), icon="check", on_click=apply)
        _download(page)
        file_button(page, say("Import a file"), upload, max_size=MAX_BLUEPRINT, ending=".toml")


def _download(page: Page) -> None:
    ui.button(
        page.translate("Download"), icon="download", on_click=lambda: ui.download("/api/blueprint", "robot.toml")
    ).props("flat")
