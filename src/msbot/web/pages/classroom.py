"""The class view: one tile per robot of the database, whoever runs it."""

from __future__ import annotations

from html import escape

from fastapi import Request
from nicegui import ui

from msbot.errors import MsbotError
from msbot.web.models import RobotTile
from msbot.web.pages.layout import Page, page_frame
from msbot.web.service import Service


def register(service: Service) -> None:
    """Make the page known."""

    @ui.page("/class")
    def classroom(request: Request) -> None:
        with page_frame(service, request, "/class", "Class") as page:
            _tiles(page)


def _tiles(page: Page) -> None:
    ui.label(
        page.say("Every robot of this database. Robots of other masters show here when they share a PostgreSQL.")
    ).classes("soft")
    shown = ui.html("", sanitize=False).classes("w-full")

    def show() -> None:
        try:
            content = f'<div class="grid">{"".join(_tile(page, tile) for tile in page.service.robots())}</div>'
        except MsbotError as error:
            content = escape(str(error))
        if shown.content != content:
            shown.set_content(content)

    page.every_look(show)


def _tile(page: Page, tile: RobotTile) -> str:
    healthy = tile.running and tile.active == tile.slots
    state = "active" if healthy else "late" if tile.running else "empty"
    word = page.say("all well" if healthy else "parts are missing" if tile.running else "no master runs it")
    where = "/" if tile.here else tile.address
    event = escape(tile.last_event)
    if tile.last_event_age_s is not None:
        event += f' <span class="soft">({_age(tile.last_event_age_s)})</span>'
    inner = (
        f'<div class="head"><div style="flex:1;min-width:0"><div class="title">{escape(tile.name)}</div>'
        f'<div class="soft">{escape(tile.serial_number)}{" · " + escape(tile.owner) if tile.owner else ""}</div></div>'
        f'<span class="state s-{state}"><span aria-hidden="true">{"●" if healthy else "◐" if tile.running else "○"}</span>{escape(word)}</span></div>'
        f'<div class="num" style="font-size:1.6rem;font-weight:700">{tile.active}/{tile.slots} '
        f'<span class="soft" style="font-size:.9rem;font-weight:400">{escape(page.say("slots active"))}</span></div>'
        f'<div class="reason">{event}</div>'
    )
    style = 'style="text-decoration:none;color:inherit"'
    if where:
        return f'<a class="slot is-{state}" href="{escape(where, quote=True)}" {style}>{inner}</a>'
    return f'<div class="slot is-{state}">{inner}</div>'


def _age(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.0f} h"
