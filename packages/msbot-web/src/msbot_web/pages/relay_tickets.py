"""Tickets for relays and agents: a teacher gives them, sees which there are, and takes them back."""

from __future__ import annotations

from functools import partial

from nicegui import ui

from msbot_web.access.sessions import Session
from msbot_web.api.models import Done, RelayTicket
from msbot_web.pages.layout import Page
from msbot_web.pages.page_elements import ask_first, heading, panel, show_dialog


def relay_tickets(page: Page) -> None:
    """The panel of page Pupils."""
    service, say = page.service, page.say
    with panel().classes("w-full"):
        heading(say("Relays and agents"))
        ui.label(
            say("A ticket lets a relay or an agent bring parts that are no pupil's. It opens nothing else.")
        ).classes("soft")
        for ticket in service.tickets(page.session):
            with ui.element("div").classes("row spread line"):
                ui.label(f"{ticket.purpose} · {ticket.name}").classes("ellipsis")
                ui.button(say("Remove"), on_click=partial(_remove, page, ticket)).props("flat dense color=negative")
        if service.accounts.role_of(page.session.name) is None:  # the demo's own administrator
            ui.label(say("A token belongs to a person: add one first.")).classes("soft")
            return
        with ui.element("div").classes("row").style("margin-top:.8rem;align-items:flex-end"):
            wanted = ui.input(say("Name of the relay or agent")).props("dense outlined maxlength=64")

            async def make() -> None:
                made: list[str] = []

                async def deed(session: Session) -> Done:
                    made.append(await service.new_ticket(session, session.name, str(wanted.value or "")))
                    return Done(words=say("The ticket is made."))

                if await page.do(deed) is not None:
                    with ui.dialog() as dialog, ui.card():
                        ui.label(say("Copy it now: it is never shown again."))
                        ui.label(f"MSBOT_TOKEN={made[0]}").classes("mono").style(
                            "user-select:all;overflow-wrap:anywhere"
                        )
                        ui.button(say("Close"), on_click=lambda: ui.navigate.to("/pupils"))
                    show_dialog(dialog)

            ui.button(say("Make a ticket"), icon="hub", on_click=make)


def _remove(page: Page, ticket: RelayTicket) -> None:
    async def remove() -> None:
        deed = partial(page.service.remove_token, name=ticket.name, purpose=ticket.purpose)
        if await page.do(deed) is not None:
            ui.navigate.to("/pupils")

    ask_first(page, page.say("Remove the ticket for {purpose}? What it brings is gone at once.",
                             purpose=ticket.purpose), remove)  # fmt: skip
