"""The settings (the thesis' Manual Configuration Management System): slots, wiring, and the blueprint as a whole."""

from __future__ import annotations

from html import escape

from fastapi import Request
from nicegui import ui
from nicegui.events import UploadEventArguments

from msbot.errors import MsbotError
from msbot.web.graph import wiring_svg
from msbot.web.pages.layout import Page, file_button, page_frame
from msbot.web.pages.values import values_panel
from msbot.web.roles import Right
from msbot.web.service import Service

MAX_BLUEPRINT = 1_000_000
"""Octets of a blueprint that is read from a file."""


def register(service: Service) -> None:
    """Make the page known."""

    @ui.page("/settings")
    def settings(request: Request) -> None:
        with page_frame(service, request, "/settings", "Settings") as page:
            with ui.tabs().props("align=left no-caps") as tabs:
                slots = ui.tab("slots", page.say("Slots"))
                robot = ui.tab("robot", page.say("Robot"))
                blueprint = ui.tab("blueprint", page.say("Blueprint"))
            with ui.tab_panels(tabs, value=slots).classes("w-full").style("background:transparent"):
                with ui.tab_panel(slots).style("padding:0"):
                    _slots(page)
                with ui.tab_panel(robot).style("padding:0"):
                    _robot(page)
                with ui.tab_panel(blueprint).style("padding:0"):
                    _blueprint(page)


def _slots(page: Page) -> None:
    with ui.element("div").classes("grid").style("grid-template-columns:repeat(auto-fill,minmax(min(24rem,100%),1fr))"):
        for card in page.service.views.slots():
            with ui.element("div").classes("panel"):
                ui.html(
                    f'<div class="title" style="font-weight:700;font-size:1.1rem">{escape(card.name)}</div>'
                    f'<div class="soft">{escape(card.type_name)} · <span class="mono">{escape(card.part_number)}</span></div>',
                    sanitize=False,
                )
                values_panel(page, card.name)


def _robot(page: Page) -> None:
    robot, say = page.service.robot(), page.say
    facts = [
        (say("name"), robot.name),
        (say("version"), robot.version),
        (say("serial number"), robot.serial_number),
        (say("released"), robot.released),
        (say("manufacturer"), robot.manufacturer),
        (say("links"), ", ".join(robot.links)),
        (say("a part beats every"), f"{robot.beat_s:g} s"),
        (say("life is counted down every"), f"{robot.tick_s:g} s"),
        (say("life after a beat"), str(robot.life)),
        (
            say("a silent part is delisted after"),
            f"{(robot.life - 1) * robot.tick_s:g} – {robot.life * robot.tick_s:g} s",
        ),
    ]
    rows = "".join(f'<tr><td class="soft">{escape(name)}</td><td>{escape(value)}</td></tr>' for name, value in facts)
    ui.html(
        f'<div class="panel scroll"><table class="ms-table">{rows}</table><p class="soft" style="margin-top:.8rem">'
        f"{escape(say('These come from the blueprint: change them there.'))}</p></div>",
        sanitize=False,
    ).classes("w-full")


def _blueprint(page: Page) -> None:
    service, say = page.service, page.say
    try:
        text = service.blueprint()
    except MsbotError as error:
        ui.label(str(error)).classes("ms-banner warn")
        return
    with ui.element("div").classes("panel"):
        states = {card.name: card.state for card in service.robot().slots}
        ui.html(wiring_svg(service.views.topics(), states), sanitize=False).classes("w-full scroll")
    with ui.element("div").classes("panel"):
        ui.html(
            f"<h2>robot.toml</h2><p class='soft'>{escape(say('Edit, look at what would change, then apply.'))}</p>",
            sanitize=False,
        )
        editor = ui.codemirror(text, language="TOML", line_wrapping=True).style(
            "height:24rem;border:1px solid var(--line)"
        )
        changes = ui.html("", sanitize=False).classes("w-full").props("aria-live=polite")

        def compare() -> bool:
            try:
                diff = service.blueprint_diff(str(editor.value))
            except MsbotError as error:
                changes.set_content(
                    f'<div class="ms-banner bad" style="white-space:pre-wrap">{escape(str(error))}</div>'
                )
                return False
            lines = "".join(f"<li>{escape(change)}</li>" for change in diff.changes)
            changes.set_content(
                f"<div class='ms-banner warn'><ul style='margin:0'>{lines}</ul></div>"
                if lines
                else f"<p>{escape(say('Nothing would change.'))}</p>"
            )
            return bool(lines)

        def apply() -> None:
            if compare() and page.do(lambda session: service.apply_blueprint(session, str(editor.value))) is not None:
                editor.value = service.blueprint()
                changes.set_content("")

        async def upload(event: UploadEventArguments) -> None:
            content = await event.file.read()
            try:
                editor.value = content.decode("utf-8")
            except UnicodeDecodeError:
                ui.notify(say("This file is no text in UTF-8."), type="negative")
                return
            compare()

        with ui.element("div").classes("row").style("margin-top:.6rem"):
            ui.button(say("Compare"), icon="difference", on_click=compare).props("outline")
            if page.may(Right.DESIGN):
                ui.button(say("Apply"), icon="check", on_click=apply)
            ui.button(
                say("Download"), icon="download", on_click=lambda: ui.download("/api/blueprint", "robot.toml")
            ).props("flat")
            file_button(page, say("Import a file"), upload, max_size=MAX_BLUEPRINT, ending=".toml")
