"""The drawer of one slot: identity, settings, wiring, rhythm, history, and why it stands as it does."""

from __future__ import annotations

from html import escape

from nicegui import ui

from msbot.errors import MsbotError
from msbot.web.drawings import draw, fields_html, sparkline, state_chip
from msbot.web.models import SlotCard
from msbot.web.pages.layout import Page
from msbot.web.pages.simulator import simulator_panel
from msbot.web.pages.values import values_panel
from msbot.web.roles import Right
from msbot.web.views import NotThere


def open_drawer(page: Page, slot: str) -> None:
    """Open the drawer of a slot."""
    try:
        card = page.service.views.slot(slot)
    except MsbotError as error:
        ui.notify(str(error), type="negative")
        return
    with ui.dialog().props("position=right full-height") as dialog, ui.card().classes("ms-drawer"):
        with ui.element("div").classes("row spread w-full"):
            ui.html(f"<h2 style='font-size:1.35rem'>{escape(slot)}</h2>", sanitize=False)
            ui.button(icon="close", on_click=dialog.close).props(f'flat round dense aria-label="{page.say("Close")}"')
        _state(page, slot)
        if card.simulated and page.may(Right.OPERATE):
            simulator_panel(page, slot)
        _ports(page, slot)
        ui.html(f"<h2>{escape(page.say('Settings'))}</h2>", sanitize=False)
        values_panel(page, slot)
        _rhythm(page, slot)
        _deeds(page, card)
        _why(page, card)

    def look_whether_there() -> None:
        try:
            page.service.views.check_slot(slot)
        except NotThere as error:  # another blueprint holds by now
            ui.notify(str(error), type="warning")
            dialog.close()

    page.every_look(look_whether_there, dialog)
    dialog.on("hide", dialog.delete)
    dialog.open()


def _state(page: Page, slot: str) -> None:
    shown = ui.html("", sanitize=False).classes("w-full")

    def show() -> None:
        card = page.service.views.slot(slot)
        part = card.part
        rows = [(page.say("part number"), f"{card.part_number} {card.type_name}".strip())]
        if part is not None:
            rows += [
                (page.say("part"), part.part),
                (page.say("UID"), part.uid or "–"),
                (page.say("address"), part.address),
                (page.say("session"), part.client_key),
                (page.say("beats"), f"{part.beats}"),
                (page.say("last beat"), "–" if part.beat_age_s is None else f"{part.beat_age_s:.1f} s"),
            ]
            if part.plug_in_to_active_ms is not None:
                rows.append((page.say("plug-in to active"), f"{part.plug_in_to_active_ms:.1f} ms"))
        table = "".join(
            f'<tr><td class="soft">{escape(name)}</td><td class="num">{escape(value)}</td></tr>' for name, value in rows
        )
        content = (
            f"<p>{state_chip(card.state, page.say(card.state))} {escape(card.reason)}</p>"
            f'<p class="soft">{escape(card.description)}</p><table class="ms-table">{table}</table>'
        )
        if shown.content != content:
            shown.set_content(content)

    page.every_look(show, shown)


def _ports(page: Page, slot: str) -> None:
    ui.html(f"<h2>{escape(page.say('Topics'))}</h2>", sanitize=False)
    shown = ui.html("", sanitize=False).classes("w-full")

    def show() -> None:
        content = "".join(
            f'<div class="row" style="flex-wrap:nowrap;margin-bottom:.6rem">{draw(port.type_name, port.fields)}<div>'
            f'<b>{escape(port.port)}</b> {"→" if port.publishes else "←"} <span class="mono">{escape(port.topic)}</span>'
            f'<div class="soft">{escape(port.type_name)} · {port.rate_hz:.1f} Hz · {port.count} · '
            f"{escape(page.say('reliable' if port.reliable else 'best effort'))}</div>{fields_html(port.fields)}</div></div>"
            for port in page.service.views.slot(slot).ports
        )
        content = content or f'<p class="soft">{escape(page.say("No port of this slot is wired to a topic."))}</p>'
        if shown.content != content:
            shown.set_content(content)

    page.every_look(show, shown)


def _rhythm(page: Page, slot: str) -> None:
    ui.html(f"<h2>{escape(page.say('Time between beats'))}</h2>", sanitize=False)
    shown = ui.html("", sanitize=False).classes("w-full")

    def show() -> None:
        intervals = page.service.views.beat_intervals(slot)
        words = f"{min(intervals):.2f} – {max(intervals):.2f} s" if intervals else page.say("no beats yet")
        content = f'{sparkline(intervals, least=0.0)}<div class="soft num">{escape(words)}</div>'
        if shown.content != content:
            shown.set_content(content)

    page.every_look(show, shown)


def _deeds(page: Page, card: SlotCard) -> None:
    service, part = page.service, card.part
    if part is None or not part.uid:
        return
    with ui.element("div").classes("row"):
        if page.may(Right.OPERATE):
            ui.button(page.say("Identify"), icon="lightbulb",
                      on_click=lambda: page.do(lambda session: service.identify(session, part.uid))).props("outline")  # fmt: skip
        if page.may(Right.ARRANGE):
            ui.button(page.say("Release slot"), icon="eject",
                      on_click=lambda: page.do(lambda session: service.release(session, card.name))).props("outline")  # fmt: skip
            ui.button(page.say("Block part"), icon="block",
                      on_click=lambda: page.do(lambda session: service.block(session, part.uid, ""))).props(
                "outline color=negative"
            )  # fmt: skip
            for spare in service.views.arrivals():
                if spare.state == "standby" and spare.uid:
                    ui.button(page.say("Swap to {part}", part=spare.part), icon="swap_horiz",
                              on_click=lambda spare=spare: page.do(
                                  lambda session: service.swap(session, card.name, spare.uid))).props("outline")  # fmt: skip


def _why(page: Page, card: SlotCard) -> None:
    ui.html(f"<h2>{escape(page.say('Why?'))}</h2>", sanitize=False)
    lines = page.service.views.why(card.part.part if card.part is not None else card.name)
    ui.html(
        "".join(
            f'<div class="{"soft" if line.startswith("  ") else ""}" style="margin-bottom:.2rem">{escape(line)}</div>'
            for line in lines[:40]
        ),
        sanitize=False,
    )
