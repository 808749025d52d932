"""The class view: one tile per robot, of the database and of the masters on this computer; one STOP for all."""

from __future__ import annotations

from urllib.parse import urlsplit

from fastapi import Request
from nicegui import ui

from msbot.errors import MsbotError
from msbot.web.api.class_models import RobotTile
from msbot.web.html import Markup, render
from msbot.web.pages.layout import Page, page_frame
from msbot.web.pages.page_elements import set_html
from msbot.web.service import Service


def register(service: Service) -> None:
    """Make the page known."""

    @ui.page("/class")
    def classroom(request: Request) -> None:
        with page_frame(service, request, "/class", "Class") as page:
            _tiles(page, request.url.hostname or "127.0.0.1")


def _tiles(page: Page, hostname: str) -> None:
    with ui.element("div").classes("row spread w-full"):
        find = ui.input(page.say("Search"), placeholder=page.say("name, serial number, state")).props(
            "outlined dense clearable"
        )
        count = ui.label("").classes("soft num").props("aria-live=polite")
        ui.button(page.say("STOP all robots"), on_click=lambda: _stop_all(page), color=None).classes("ms-stop").props(
            f'unelevated aria-label="{page.say("STOP all robots whose masters run on this computer")}"'
        )
    ui.label(
        page.say("The robots of this database, and of every master on this computer. Click one to go to its page.")
    ).classes("soft")
    shown = ui.html("", sanitize=False).classes("w-full")

    async def show() -> None:
        try:
            tiles = await page.service.whole_class.robots()
        except MsbotError as error:
            set_html(shown, Markup.escape(page.say(str(error))))
            return
        words = str(find.value or "").casefold().split()
        fitting = [tile for tile in tiles if all(word in _searched(page, tile) for word in words)]
        well = sum(_state_of(tile)[0] == "active" for tile in fitting)
        count.set_text(page.say("Robots that are well: {well} of {all}", well=well, all=len(fitting)))
        set_html(shown, render("tiles", tiles=[_tile(page, tile, hostname) for tile in fitting], say=page.say))

    page.every_look(show)
    find.on_value_change(show)


async def _stop_all(page: Page) -> None:
    try:
        done = await page.service.whole_class.stop_all(page.session)
        unreached = [
            tile.name for tile in await page.service.whole_class.robots() if tile.running and not tile.reachable
        ]
    except MsbotError as error:
        ui.notify(page.say(str(error)), type="negative", multi_line=True)
        return
    words = page.say(
        "STOP: {robots} robots were told; {confirmed} of {parts} parts have confirmed it so far.",
        robots=len(done.told), confirmed=done.confirmed, parts=done.parts,
    )  # fmt: skip
    ui.notify(words, type="warning", multi_line=True, timeout=8000)
    if done.waiting:
        words = page.say("Not confirmed yet, they may still move: {robots}", robots=", ".join(done.waiting))
        ui.notify(words, type="negative", multi_line=True, timeout=15_000)
    if done.silent:
        words = page.say("NOT delivered to {count} masters that run here: cut their power.", count=done.silent)
        ui.notify(words, type="negative", multi_line=True, timeout=15_000)
    if unreached:
        names = ", ".join(unreached)
        words = page.say("NOT told, their masters run on other computers: {names}. Press STOP there.", names=names)
        ui.notify(words, type="negative", multi_line=True, timeout=15_000)


def _state_of(tile: RobotTile) -> tuple[str, str]:
    """The colour of a tile, and the word for it."""
    if not tile.running:
        return "empty", "no master runs it"
    if not (tile.here or tile.reachable):
        return "late", "its master does not answer on this computer"
    if tile.stopped:
        return "lost", "STOP is in force"
    return ("active", "all well") if tile.active == tile.slots else ("late", "parts are missing")


def _searched(page: Page, tile: RobotTile) -> str:
    return f"{tile.name} {tile.serial_number} {tile.owner} {page.say(_state_of(tile)[1])}".casefold()


def _tile(page: Page, tile: RobotTile, hostname: str) -> Markup:
    state, word = _state_of(tile)
    return render(
        "tile",
        tile=tile,
        state=state,
        word=word,
        sign={"active": "●", "late": "◐", "lost": "■", "empty": "○"}[state],
        place="" if tile.here else urlsplit(tile.address).netloc,
        where="/" if tile.here else _for_visitor(tile.address, hostname),
        age="" if tile.last_event_age_s is None else _age(tile.last_event_age_s),
        say=page.say,
    )


def _for_visitor(address: str, hostname: str) -> str:
    """Where a page is for somebody who has come by that name of this computer; empty when it has none."""
    found = urlsplit(address)
    if found.hostname not in ("0.0.0.0", "::"):
        return address
    return f"{found.scheme}://{f'[{hostname}]' if ':' in hostname else hostname}:{found.port}"


def _age(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.0f} h"
