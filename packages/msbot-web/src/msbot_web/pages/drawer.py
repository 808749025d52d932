"""The drawer of one slot: identity, settings, wiring, rhythm, history, and the reasons for its state."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple
from urllib.parse import quote

from nicegui import ui

from msbot.hardware.wiring_picture import wiring_picture
from msbot.operations.rights import Right
from msbot.pnp import PartState
from msbot_web.api.models import PartLine, SlotCard
from msbot_web.html import Markup, render
from msbot_web.pages.by_hand import hand_panel
from msbot_web.pages.layout import Page
from msbot_web.pages.page_elements import heading, set_html, show_dialog
from msbot_web.pages.simulator import simulator_panel
from msbot_web.pages.values import values_panel
from msbot_web.svg.drawings import HELD_WORDS, done_fields, draw, fields_html, sparkline, state_chip
from msbot_xrce.errors import MsbotError, NotThere

WHY_LINES = 40


def open_drawer(page: Page, slot: str) -> None:
    """Open the drawer of a slot; Back closes it. Of the past it has what was so, and nothing that can be done."""
    try:
        page.sight.slot(slot)
    except MsbotError as error:
        ui.notify(page.say(str(error)), type="negative")
        return
    with ui.dialog().props("position=right full-height") as dialog, ui.card().classes("ms-drawer"):
        with ui.element("div").classes("row spread w-full").style("flex-wrap:nowrap"):
            heading(slot).classes("ellipsis").style("font-size:1.35rem")
            close = ui.button(icon="close", on_click=dialog.close).props("flat round dense")
            close.props["aria-label"] = close.props["title"] = page.say("Close")
        if page.is_past:
            ui.label(page.say("This was so at the chosen moment.")).classes("ms-banner info")
            _state(page, slot)
            _ports(page, slot)
        else:
            _present(page, slot)

    at_s = page.at_s

    def look_whether_there() -> None:
        if page.at_s != at_s:
            dialog.close()
            return
        try:
            page.sight.slot(slot)
        except NotThere as error:  # another blueprint holds by now
            ui.notify(page.say(str(error)), type="warning")
            dialog.close()

    page.every_look(look_whether_there, dialog)
    show_dialog(dialog, f"/?slot={quote(slot)}")


def _present(page: Page, slot: str) -> None:
    """All about the slot as it is now."""
    _state(page, slot)
    if page.may(Right.OPERATE):
        _following(page, slot, lambda card: card.simulated, lambda card: _simulator(page, card))
    _ports(page, slot)
    _following(page, slot, lambda card: card.part_number, lambda card: hand_panel(page, slot, card.part_number))
    heading(page.say("Settings"))
    values_panel(page, slot)
    _following(page, slot, lambda card: card.part_number, partial(_wires, page))
    _rhythm(page, slot)
    _Deeds(page, slot)
    _why(page, slot)


def _following(
    page: Page, slot: str, key: Callable[[SlotCard], object], build: Callable[[SlotCard], None]
) -> None:  # fmt: skip
    """Elements that depend on the part in the slot: made anew whenever their key is another one."""
    place = ui.column().classes("w-full")
    built: list[object] = []

    def show() -> None:
        card = page.service.views.slot(slot)
        if built == [wanted := key(card)]:
            return
        built[:] = [wanted]
        place.clear()
        with place:
            build(card)
        place.set_visibility(bool(place.default_slot.children))

    page.every_look(show, place)


def _simulator(page: Page, card: SlotCard) -> None:
    if card.simulated:
        simulator_panel(page, card.name)


def _state(page: Page, slot: str) -> None:
    shown = ui.html("", sanitize=False).classes("w-full")

    is_past = page.is_past

    def show() -> None:
        if page.is_past != is_past:
            return  # the drawer is being closed
        card = page.sight.slot(slot)
        part = card.part
        rows = [(page.say("part number"), f"{card.shown_number} {page.say(card.type_name)}".strip())]
        if part is not None:
            rows += [(page.say("part"), part.part)]
            if page.may(Right.ARRANGE):  # knowing these lets somebody impersonate that part
                rows += [(page.say("UID"), part.uid or "–")]
            if page.may(Right.ARRANGE) and not is_past:
                rows += [(page.say("address"), part.address), (page.say("session"), part.client_key)]
            rows += [] if is_past else [(page.say("beats"), f"{part.beats}")]
            rows += [
                (page.say("last beat"), "–" if part.beat_age_s is None else f"{page.number(part.beat_age_s, '.1f')} s"),
            ]
            if part.plug_in_to_active_ms is not None:
                rows.append((page.say("plug-in to active"), f"{page.number(part.plug_in_to_active_ms, '.1f')} ms"))
        if card.spares:
            rows.append((page.say("standby"), ", ".join(card.spares)))
        chip = state_chip(card.state, page.say(card.state))
        set_html(shown, render("slot_facts", say=page.say, chip=chip, card=card, rows=rows))

    page.every_look(show, shown)


def _ports(page: Page, slot: str) -> None:
    heading(page.say("Topics"))
    shown = ui.html("", sanitize=False).classes("w-full")

    is_past = page.is_past

    def show() -> None:
        ports = []
        for port in () if page.is_past != is_past else page.sight.slot(slot).ports:
            fields = done_fields(port)
            ports.append({
                "line": port, "drawing": draw(port.type_name, fields, page.language), "fields": fields_html(fields, page.language),
                "held": page.say(HELD_WORDS[port.held]) if port.held else "",
            })  # fmt: skip
        set_html(
            shown,
            render(
                "slot_ports", say=page.say, number=page.number, count=page.language.count, ports=ports, is_past=is_past
            ),
        )

    page.every_look(show, shown)


def _wires(page: Page, card: SlotCard) -> None:
    """How such a part is wired to a Linux board, where a driver for it exists."""
    found = page.service.views.library.find(card.part_number)
    if found is not None and found.driver.entry_point:
        with ui.expansion(page.say("Wiring"), icon="cable").classes("w-full"):
            ui.html(wiring_picture(found, say=page.say), sanitize=False).classes("wiring w-full")


def _rhythm(page: Page, slot: str) -> None:
    heading(page.say("Time between beats"))
    shown = ui.html("", sanitize=False).classes("w-full")

    def show() -> None:
        intervals = page.service.views.beat_intervals(slot)
        words = (
            f"{page.number(min(intervals), '.2f')} – {page.number(max(intervals), '.2f')} s"
            if intervals
            else page.say("no beats yet")
        )
        set_html(shown, render("rhythm", curve=sparkline(intervals, page.language, least=0.0), words=words))

    page.every_look(show, shown)


def _spares(page: Page) -> list[PartLine]:
    return [part for part in page.service.views.arrivals() if part.state == PartState.STANDBY.value and part.uid]


def _has_stand_in(page: Page, card: SlotCard) -> bool:
    return card.name in page.service.operations.stand_ins.names


class _Deed(NamedTuple):
    """Something that can be done to the part in a slot."""

    words: str
    icon: str
    operation: str
    arguments: tuple[tuple[str, Any], ...]
    look: str = "outline"


class _Deeds:
    """The buttons for what can be done. Each stays the same one as long as it would do the same.

    A click takes its time to the server: for a button that had just been made anew it would be for nothing.
    """

    def __init__(self, page: Page, slot: str) -> None:
        self._page, self._slot = page, slot
        self._row = ui.element("div").classes("row")
        self._buttons: dict[_Deed, ui.button] = {}
        page.every_look(self._show, self._row)

    def _show(self) -> None:
        wanted = list(self._wanted(self._page.service.views.slot(self._slot)))
        for gone in self._buttons.keys() - set(wanted):
            self._buttons.pop(gone).delete()
        for at, deed in enumerate(wanted):
            if deed not in self._buttons:
                act = partial(self._page.act, deed.operation, **dict(deed.arguments))
                with self._row:
                    self._buttons[deed] = ui.button(deed.words, icon=deed.icon, on_click=act).props(deed.look)
                self._buttons[deed].move(target_index=at)
        self._row.set_visibility(bool(wanted))

    def _wanted(self, card: SlotCard) -> Iterator[_Deed]:
        page, part, slot = self._page, card.part, ("slot", card.name)
        if part is not None and part.uid:
            uid = ("part", part.uid)
            if page.may(Right.OPERATE):
                named = uid if page.may(Right.ARRANGE) else ("part", card.name)
                yield _Deed(page.say("Identify"), "lightbulb", "identify", (named,))
            if page.may(Right.ARRANGE):
                yield _Deed(page.say("Release slot"), "eject", "release", (slot,))
                yield _Deed(page.say("Block part"), "block", "block", (uid,), "outline color=negative")
                for spare in _spares(page):
                    words = page.say("Swap to {part}", part=spare.part)
                    yield _Deed(words, "swap_horiz", "swap", (slot, ("to", spare.uid)))
        # One click lets a simulated part stand in for that of the slot, another gives the slot back.
        is_here = _has_stand_in(page, card)
        if page.may(Right.ARRANGE) and (is_here or not card.simulated):
            words = page.say("Give the slot back") if is_here else page.say("Simulate this slot")
            icon = "settings_backup_restore" if is_here else "smart_toy"
            yield _Deed(words, icon, "simulate", (slot, ("end", is_here)))


def _why(page: Page, slot: str) -> None:
    heading(page.say("Why?"))
    shown = ui.html("", sanitize=False).classes("why")
    last: list[Markup] = []

    def show() -> None:
        part = page.service.views.slot(slot).part
        lines = page.service.views.why(slot if part is None else part.part)
        content = render("lines", say=page.say, lines=lines[:WHY_LINES])
        if not last:
            shown.set_content(content)
        elif last != [content]:  # not set_content: whoever is marking a sentence would lose it
            ui.run_javascript(f"msbotLines('{shown.html_id}', {json.dumps(content)})")
        last[:] = [content]

    page.every_look(show, shown)
