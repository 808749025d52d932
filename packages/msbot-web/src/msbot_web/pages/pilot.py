"""The pilot of the arena: the simulated part by which people drive by hand, in the slot that a program may want."""

from __future__ import annotations

from functools import partial

from nicegui import ui

from msbot.operations.rights import Right
from msbot_web.pages.page import Page
from msbot_web.service import Service

PILOT = "PILOT"
"""The part number."""
LEFT_OUT = ("standby", "refused")
"""States of a part that would take a slot and has none."""


def pilot_slot(service: Service) -> str:
    """The slot that a person can drive by; empty: there is none."""
    for card in service.robot().slots:
        if card.part_number == PILOT and card.name in service.views.bench.slots():
            return card.name
    return ""


def pilot_note(page: Page) -> None:
    """Say on a page of programs that the pilot holds the slot that one of them wants, and offer to take it out."""
    service, say = page.service, page.translate
    slot = pilot_slot(service)
    if not slot:
        return
    with ui.element("div").classes("ms-banner warn row spread").props("role=status") as note:
        ui.label(say("The pilot of the page Arena holds the slot {slot}, which a program wants.", slot=slot))
        if page.may(Right.OPERATE):
            ui.button(say("Take the pilot out"), icon="power_off", on_click=partial(take_out, page, slot)).props(
                "outline"
            )

    def show() -> None:
        wants = any(one.part_number == PILOT and one.state in LEFT_OUT for one in service.views.parts())
        note.set_visibility(wants and service.views.bench.is_plugged(slot))

    page.every_look(show, note)


async def take_out(page: Page, slot: str) -> None:
    """Take the pilot out for the person."""
    page.service.arena.drivers.clear()
    await page.do(lambda session: page.service.plug(session, slot, plugged=False), quiet=True)
