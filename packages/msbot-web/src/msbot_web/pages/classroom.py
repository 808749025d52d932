"""The class view: one tile per robot, of the database, of the masters here and of those elsewhere; one STOP for all."""

from __future__ import annotations

import re
from urllib.parse import urlsplit

from fastapi import Request
from nicegui import ui

from msbot.operations.rights import Right
from msbot_web.html import Markup, render
from msbot_web.models.class_models import RobotTile
from msbot_web.pages.class_rollout import RollOutPanel
from msbot_web.pages.layout import page_frame
from msbot_web.pages.page import Page
from msbot_web.pages.page_elements import set_html
from msbot_web.service import Service
from msbot_xrce.errors import MsbotError

MOST_NAMED = 30
"""Robots that are named in one message."""


def register(service: Service) -> None:
    """Make the page known."""

    @ui.page("/class")
    def classroom(request: Request) -> None:
        with page_frame(service, request, "/class", "Class") as page:
            _tiles(page, request.url.hostname or "127.0.0.1")


def _tiles(page: Page, hostname: str) -> None:
    with ui.element("div").classes("row spread w-full"):
        find = ui.input(
            page.translate("Search"), placeholder=page.translate("name, serial number, state, blueprint")
        ).props("outlined dense clearable")
        count = ui.label("").classes("soft num").props("aria-live=polite")
        reach = _Reach(page)
    reach.explain()
    trouble = ui.label("").classes("ms-banner warn")
    nobody = ui.label(page.translate("No robot fits. Try part of its name, or clear the search."))
    above = ui.column().classes("w-full")
    grid = ui.element("div").classes("grid")
    shown = _Shown(page, grid, hostname)
    if page.may(Right.DESIGN):
        with above:
            RollOutPanel(page, lambda: shown.fitting)

    async def show() -> None:
        try:
            tiles = await page.service.whole_class.robots()
        except MsbotError as error:
            trouble.set_text(page.translate(str(error)))
            trouble.set_visibility(True)
            return
        trouble.set_text(page.translate(page.service.whole_class.trouble))
        trouble.set_visibility(bool(page.service.whole_class.trouble))
        reach.update(tiles)
        fitting = shown.update(tiles, str(find.value or "").casefold().split())
        well = sum(_state_of(tile)[0] == "active" for tile in fitting)
        words = page.translate("Healthy robots: {well} of {all}", well=well, all=len(fitting))
        marks = {tile.blueprint for tile in fitting if tile.blueprint}
        more = page.translate("{count} different blueprints", count=len(marks))
        count.set_text(f"{words} · {more}" if len(marks) > 1 else words)
        nobody.set_visibility(not fitting)

    page.every_look(show)
    find.on_value_change(show)


class _Reach:
    """The button that stops all robots of the class, for those who may, and which robots these are."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self._may = page.may(Right.STOP_CLASS)
        self._shown: tuple[str, ...] = ()
        if self._may:
            self._button = ui.button(page.translate("STOP all robots"), on_click=lambda: _stop_all(page), color=None)
            self._button.classes("ms-stop").props("unelevated")

    def explain(self) -> None:
        """What the button reaches; below the row in which it is."""
        words = self._page.translate("Click a robot to go to its page.")
        if not self._may:
            more = self._page.translate(
                "The red STOP stops {robot} alone. Only teachers stop all robots of a class.",
                robot=self._page.service.robot_name,
            )
            words = f"{words} {more}"
        ui.label(words).classes("soft")
        self._who = ui.label("").classes("soft").props("id=ms-reach")
        self._others = ui.label("").classes("soft")
        self._others.set_visibility(False)

    def update(self, tiles: list[RobotTile]) -> None:
        """Show how many robots the button stops, which, and which not."""
        if not self._may:
            return
        page, group = self._page, self._page.service.operations.stop_group
        meant = [tile for tile in tiles if tile.in_class and (tile.running or tile.elsewhere)]
        others = [tile for tile in tiles if not tile.in_class]
        here = [_label(tile) for tile in meant if not tile.elsewhere]
        far = [f"{_label(tile)} ({urlsplit(tile.address).netloc})" for tile in meant if tile.elsewhere]
        count = page.language.count(len(meant), "STOP {count} robot", "STOP all {count} robots")
        whose = (
            page.translate("STOP all reaches the STOP group {group}: {robots}", group=group, robots=_named(here + far))
            if group
            else page.translate("STOP all reaches the robots of this class: {robots}", robots=_named(here + far))
        )
        left = page.translate(
            "It does NOT reach robots of others: {robots}", robots=_named([_label(one) for one in others])
        )
        words = (count, whose, left if others else "")
        if words != self._shown:
            self._shown = words
            self._button.set_text(count)
            self._button.props["aria-label"] = page.language.count(
                len(meant), "STOP {count} robot of the class", "STOP all {count} robots of the class"
            )
            self._button.update()
            self._who.set_text(whose)
            self._others.set_text(words[2])
            self._others.set_visibility(bool(others))


def _label(tile: RobotTile) -> str:
    return f"{tile.name} {tile.serial_number}"


def _named(names: list[str]) -> str:
    more = [f"+{len(names) - MOST_NAMED}"] if len(names) > MOST_NAMED else []
    return ", ".join([*names[:MOST_NAMED], *more])


class _Shown:
    """The tiles on a page: each is an element of its own, and only those that have changed are sent."""

    def __init__(self, page: Page, grid: ui.element, hostname: str) -> None:
        self._page = page
        self._grid = grid
        self._hostname = hostname
        self._elements: list[ui.html] = []
        self._tiles: list[RobotTile] = []
        self._source: object = None
        self.fitting: list[RobotTile] = []
        """Those that the search shows."""

    def update(self, tiles: list[RobotTile], words: list[str]) -> list[RobotTile]:
        """Show these robots as far as all words are found in what is said of them; returns those."""
        if tiles is not self._source:  # else nobody has looked at the robots since
            self._source = tiles
            self._tiles = sorted(tiles, key=_in_order)
            with self._grid:
                self._elements += [
                    ui.html("", sanitize=False).style("display:grid;min-width:0;grid-template-columns:minmax(0,1fr)")
                    for _ in self._tiles[len(self._elements) :]
                ]
            while len(self._elements) > len(self._tiles):
                self._elements.pop().delete()
            for tile, element in zip(self._tiles, self._elements, strict=True):
                set_html(element, _tile(self._page, tile, self._hostname))
        fitting = []
        for tile, element in zip(self._tiles, self._elements, strict=True):
            text = _searched(self._page, tile)
            fits = all(word in text for word in words)
            if element.visible != fits:
                element.set_visibility(fits)
            if fits:
                fitting.append(tile)
        self.fitting = fitting
        return fitting


def _in_order(tile: RobotTile) -> tuple[bool, list[tuple[int, str]], list[tuple[int, str]]]:
    return not tile.in_class, _natural(tile.name), _natural(tile.serial_number)


def _natural(text: str) -> list[tuple[int, str]]:
    """By this, robot 10 comes after robot 9."""
    return [(int(piece), "") if piece.isdecimal() else (-1, piece) for piece in re.split(r"([0-9]+)", text.casefold())]


async def _stop_all(page: Page) -> None:
    school = page.service.whole_class
    try:
        done = await school.stop_all(page.session)
        unreached = [
            f"{tile.name} {tile.serial_number}"
            for tile in await school.robots()
            if tile.in_class and tile.running and not (tile.reachable or tile.here or tile.elsewhere)
        ]
    except MsbotError as error:
        ui.notify(page.translate(str(error)), type="negative", multi_line=True)
        return
    told = page.language.count(len(done.told), "STOP: {count} robot was told", "STOP: {count} robots were told")
    confirmed = page.language.count(
        done.parts,
        "{confirmed} of {count} part has confirmed it so far.",
        "{confirmed} of {count} parts have confirmed it so far.",
        confirmed=done.confirmed,
    )
    words = f"{told} ({_named(list(done.told))}); {confirmed}" if done.told else f"{told}; {confirmed}"
    ui.notify(words, type="warning", multi_line=True, timeout=8000)
    if done.waiting:
        words = page.translate("Not confirmed yet, they may still move: {robots}", robots=", ".join(done.waiting))
        ui.notify(words, type="negative", multi_line=True, timeout=15_000)
    if done.not_stored:
        words = page.translate("Not stored, it ends with their masters: {robots}", robots=", ".join(done.not_stored))
        ui.notify(words, type="negative", multi_line=True, timeout=15_000)
    if done.silent:
        words = page.language.count(
            done.silent,
            "NOT delivered to {count} master that runs here: cut its power.",
            "NOT delivered to {count} masters that run here: cut their power.",
        )
        ui.notify(words, type="negative", multi_line=True, timeout=15_000)
    if done.not_told:
        names = ", ".join(page.translate(one) for one in done.not_told[:MOST_NAMED])
        words = page.language.count(
            len(done.not_told),
            "NOT stopped: {count} robot on another computer does not answer: {robots}. Cut its power.",
            "NOT stopped: {count} robots on other computers do not answer: {robots}. Cut their power.",
            robots=names,
        )
        ui.notify(words, type="negative", multi_line=True, timeout=30_000)
    if unreached:
        names = ", ".join(unreached)
        words = page.translate(
            "NOT told, their masters run on other computers: {names}. Press STOP there.", names=names
        )
        ui.notify(words, type="negative", multi_line=True, timeout=15_000)


def _state_of(tile: RobotTile) -> tuple[str, str]:
    """The colour of a tile, and the word for it."""
    if tile.trouble:
        return "late", "its master does not answer"
    if not tile.running:
        return "empty", "no master runs it"
    if not (tile.here or tile.reachable):
        return "late", "its master does not answer on this computer"
    if tile.stopped:
        return "lost", "STOP is in force"
    return ("active", "all well") if tile.active == tile.slots else ("late", "parts are missing")


def _searched(page: Page, tile: RobotTile) -> str:
    state = page.translate(_state_of(tile)[1])
    return (
        f"{tile.name} {tile.serial_number} {tile.owner} {tile.version} {tile.blueprint} {tile.msbot} {tile.address} {tile.stop_group} {state}"
    ).casefold()


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
        say=page.translate,
    )


def _for_visitor(address: str, hostname: str) -> str:
    """Where a page is for somebody who has come by that name of this computer; empty when it has none."""
    found = urlsplit(address)
    if found.hostname not in ("0.0.0.0", "::"):
        return address
    return f"{found.scheme}://{f'[{hostname}]' if ':' in hostname else hostname}:{found.port}"


def _age(seconds: float) -> str:
    if seconds < 60:
        return "< 1 min"  # by the second, all tiles would be sent anew all the time
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.0f} h"
