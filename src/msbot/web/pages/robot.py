"""The home page: every slot as a card with its state, its beat and its value; a click opens the drawer."""

from __future__ import annotations

from functools import partial
from html import escape

from fastapi import Request
from nicegui import ui

from msbot.web.drawings import beat_ring, draw, fields_html, main_port, state_chip
from msbot.web.models import PartLine, Robot, SlotCard
from msbot.web.pages.drawer import open_drawer
from msbot.web.pages.layout import Page, page_frame
from msbot.web.roles import Right
from msbot.web.service import Service


def register(service: Service) -> None:
    """Make the page known."""

    @ui.page("/")
    def home(request: Request, slot: str = "") -> None:
        with page_frame(service, request, "/", "Robot") as page:
            _summary(page)
            _grid(page)
            if slot:
                open_drawer(page, slot)


def _summary(page: Page) -> None:
    line = ui.html("", sanitize=False).classes("soft w-full")

    def show() -> None:
        robot = page.service.robot()
        counts: dict[str, int] = {}
        for card in robot.slots:
            counts[card.state] = counts.get(card.state, 0) + 1
        chips = " ".join(state_chip(state, f"{count} {page.say(state)}") for state, count in counts.items())
        words = " · ".join((robot.version, robot.serial_number, robot.manufacturer, ", ".join(robot.links)))
        content = f'<div class="row spread"><span>{escape(words)}</span><span class="row">{chips}</span></div>'
        if line.content != content:
            line.set_content(content)

    page.every_look(show)


def _grid(page: Page) -> None:
    grid = ui.element("div").classes("grid").props(f'role=list aria-label="{page.say("Slots")}"')
    cards: dict[str, ui.html] = {}
    shown: dict[str, object] = {}

    def show() -> None:
        robot = page.service.robot()
        if list(cards) != [card.name for card in robot.slots]:
            shown.clear()
            _fill(page, grid, cards, robot)
        for card in robot.slots:
            look = look_of(card, robot.beat_s)
            if shown.get(card.name) != look:
                shown[card.name] = look
                cards[card.name].set_content(card_html(page, card, robot.beat_s))

    page.every_look(show)


def _fill(page: Page, grid: ui.element, cards: dict[str, ui.html], robot: Robot) -> None:
    grid.clear()
    cards.clear()
    with grid:
        for card in robot.slots:
            with ui.element("div").props("role=listitem").style("position:relative"):
                cards[card.name] = (
                    ui.html("", sanitize=False)
                    .props(
                        f'tabindex=0 role=button aria-label="{escape(page.say("Open slot {name}", name=card.name))}"'
                    )
                    .style("cursor:pointer;height:100%")
                    .on("click", partial(open_drawer, page, card.name), args=[])
                    .on("keydown.enter", partial(open_drawer, page, card.name), args=[])
                    .on("keydown.space.prevent", partial(open_drawer, page, card.name), args=[])
                )
                if card.simulated and page.may(Right.OPERATE):
                    _plug_button(page, card)


def _plug_button(page: Page, card: SlotCard) -> None:
    def toggle() -> None:
        is_plugged = page.service.views.bench.is_plugged(card.name)
        page.do(lambda session: page.service.plug(session, card.name, plugged=not is_plugged), quiet=True)

    button = ui.button(on_click=toggle).props("flat round dense").style("position:absolute;right:.5rem;bottom:.5rem")

    shown: list[bool] = []

    def show() -> None:
        is_plugged = page.service.views.bench.is_plugged(card.name)
        if shown == [is_plugged]:
            return
        shown[:] = [is_plugged]
        word = page.say("Unplug {name}" if is_plugged else "Plug {name} in", name=card.name)
        button.props(
            f'icon={"power_off" if is_plugged else "power"} aria-label="{escape(word)}" title="{escape(word)}"'
        )

    page.every_look(show, button)


def look_of(card: SlotCard, beat_s: float) -> object:
    """What a card's picture depends on; between two beats the browser turns the ring by itself."""
    part, port = card.part, main_port(card)
    return (
        card.state,
        card.reason,
        card.type_name,
        card.simulated,
        None if part is None else (part.part, part.life, part.beats, _age(part, beat_s)),
        None if port is None else (port.topic, port.port, port.publishes, tuple(port.fields.items())),
    )


def _age(part: PartLine, beat_s: float) -> str:
    """Seconds since the last beat, as they are shown: exact as soon as one is overdue."""
    if part.beat_age_s is None or part.state not in ("active", "late"):
        return ""
    return f"< {beat_s:g}" if part.beat_age_s < beat_s else f"{part.beat_age_s:.1f}"


def card_html(page: Page, card: SlotCard, beat_s: float) -> str:
    """One slot as a card."""
    part, port = card.part, main_port(card)
    age = "" if part is None else _age(part, beat_s)
    age = age and escape(page.say("beat {age} s ago", age=age))
    shown = "" if port is None else (
        f'{draw(port.type_name, port.fields)}<div class="vals">{fields_html(port.fields)}'
        f'<div class="soft">{escape(port.port)} → {escape(port.topic)}</div></div>'
        if port.publishes
        else f'{draw(port.type_name, port.fields)}<div class="vals">{fields_html(port.fields)}'
        f'<div class="soft">{escape(port.topic)} → {escape(port.port)}</div></div>'
    )  # fmt: skip
    reason = "" if card.state == "active" else f'<div class="reason">{escape(card.reason)}</div>'
    simulated = f'<span class="origin">{escape(page.say("simulated"))}</span>' if card.simulated else ""
    return (
        f'<div class="slot is-{escape(card.state)}"><div class="head">{beat_ring(card, beat_s)}'
        f'<div style="min-width:0;flex:1"><div class="title">{escape(card.name)}</div>'
        f'<div class="soft" style="font-size:.85rem">{escape(card.type_name or card.part_number)} · '
        f'<span class="mono">{escape(card.part_number)}</span></div></div>{state_chip(card.state, page.say(card.state))}</div>'
        f'<div class="body">{shown}</div>{reason}<div class="row soft num" style="font-size:.82rem">{age} {simulated}</div></div>'
    )
