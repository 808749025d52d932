"""The pupils of a class: who is where and who needs help, freeze all, groups, accounts and tickets."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from functools import partial
from urllib.parse import quote, urlsplit

from fastapi import Request
from nicegui import ui

from msbot.operations.rights import Right
from msbot_web.access.guest_tickets import MOST_GUESTS
from msbot_web.access.sessions import Session
from msbot_web.class_controller import PupilStatus, PupilTicket
from msbot_web.html import render
from msbot_web.models.robot_models import ChangeResult, RelayTicket
from msbot_web.pages.layout import page_frame
from msbot_web.pages.page import Page
from msbot_web.pages.page_elements import END_WITH_MASTER, ask_first, heading, page_dialog, panel, show_dialog
from msbot_web.root_path import THIS_COMPUTER, base_of
from msbot_web.service import Service
from msbot_web.svg.drawings import qr_svg
from msbot_xrce.errors import MsbotError

# Tickets for relays and agents: a teacher gives them, sees which there are, and takes them back.


def relay_tickets(page: Page) -> None:
    """The panel of page Pupils."""
    service, say = page.service, page.translate
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
            wanted.style("width:min(18rem,100%)")

            async def make() -> None:
                made: list[str] = []

                async def deed(session: Session) -> ChangeResult:
                    made.append(await service.new_ticket(session, session.name, str(wanted.value or "")))
                    return ChangeResult(words=say("The ticket is made."))

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

    ask_first(
        page,
        page.translate("Remove the ticket for {purpose}? What it brings is gone at once.", purpose=ticket.purpose),
        remove,
    )


DAYS = (1, 7, 30)


def register(service: Service) -> None:
    """Make the page known."""

    @ui.page("/pupils")
    def pupils(request: Request) -> None:
        with page_frame(service, request, "/pupils", "Pupils") as page:
            if not page.may(Right.ARRANGE):
                ui.label(page.translate("Only a teacher sees this page.")).classes("ms-banner warn")
                return
            _controls(page)
            _who_waits(page)
            _PupilTable(page)
            _groups(page)
            _Accounts(page, base_of(request))
            relay_tickets(page)


def _controls(page: Page) -> None:
    say = page.translate
    with ui.element("div").classes("row w-full"):
        reason = (
            ui.input(say("Why, for the pupils' pages"))
            .props("outlined dense maxlength=200")
            .style("width:min(20rem,100%)")
        )

        async def freeze() -> None:
            await page.act("freeze", reason=str(reason.value or ""))

        hold = ui.button(say("Freeze all"), icon="ac_unit", on_click=freeze)
        on = ui.button(say("Let the class go on"), icon="play_arrow", on_click=partial(page.act, "thaw")).props(
            "color=positive"
        )
        ui.button(
            say("Projector"), icon="slideshow", on_click=lambda: ui.navigate.to("/projector", new_tab=True)
        ).props("outline")

    def show() -> None:
        is_frozen = page.service.operations.pupils.frozen is not None
        hold.set_visibility(not is_frozen)
        on.set_visibility(is_frozen)

    page.every_look(show)


def _who_waits(page: Page) -> None:
    """Those who are not in the list and want to come in."""
    say, pupils = page.translate, page.service.pupils
    shown: list[str] = []
    with panel().classes("w-full") as box:
        heading(say("Want to come in"))
        ui.label(say("Not in your list. Is this one of your pupils, and not somebody who is in already?")).classes(
            "soft"
        )
        lines = ui.column().classes("w-full").style("gap:0")
        everybody = ui.button(
            say("Let all of them in"), on_click=lambda: page.do(lambda who: pupils.let_in(who, list(shown)))
        ).props("outline")

    def show() -> None:
        names = list(pupils.waiting(page.session))
        box.set_visibility(bool(names))
        if names == shown:
            return
        shown[:] = names
        everybody.set_visibility(len(names) > 1)
        lines.clear()
        with lines:
            for name in names:
                with ui.element("div").classes("row spread w-full line"):
                    ui.label(name).style("font-weight:600;flex:1;min-width:min(14rem,100%)")
                    let_in = partial(pupils.let_in, names=[name])
                    yes = ui.button(say("Let in"), on_click=partial(page.do, let_in)).props("dense")
                    yes.props["aria-label"] = say("Let {name} in", name=name)
                    no = partial(pupils.turn_away, name=name)
                    ui.button(say("No"), on_click=partial(page.do, no)).props("flat dense")

    page.every_look(show)


class _PupilTable:
    """A line for each pupil."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self._shown: list[PupilStatus] | None = None
        with panel().classes("w-full"):
            heading(page.translate("Everybody"))
            self._count = ui.label("").classes("soft num").props("aria-live=polite")
            self._table = ui.column().classes("w-full").style("gap:0")
        page.every_look(self._show)

    async def _show(self) -> None:
        page, say = self._page, self._page.translate
        here = page.service.views.pupils_here()
        found = await page.service.pupils.now(page.session, page.language.code, here)
        same = [replace(one, hand_s=None if one.hand_s is None else 0.0) for one in found]
        if same == self._shown:
            return
        self._shown = same
        hands = sum(one.hand_s is not None for one in found)
        self._count.set_text(
            say(
                "Pupils: {all}, with a program that runs: {run}, hands up: {hands}",
                all=len(found),
                run=sum(one.runs for one in found),
                hands=hands,
            )
        )
        self._table.clear()
        with self._table:
            for one in found:
                self._line(one)
            if not found:
                ui.label(say("Nobody yet: paste your list below, or show a class ticket.")).classes("soft")

    def _line(self, one: PupilStatus) -> None:
        page, say = self._page, self._page.translate
        with ui.element("div").classes("row spread w-full line ms-pupil"):
            with ui.element("div").style("min-width:min(14rem,100%);flex:1"):
                with ui.element("div").classes("row").style("gap:.4rem"):
                    if one.hand_s is not None:
                        ui.icon("pan_tool", size="1.1rem").classes("ms-hand-up").props(f'aria-label="{say("hand up")}"')
                    ui.label(one.name).classes("ellipsis").style("font-weight:600")
                    if one.group:
                        ui.label(one.group).classes("chip")
                ui.label(self._where(one)).classes("soft")
            with ui.element("div").classes("row"):
                if one.hand_s is not None:
                    seen = partial(page.do, lambda session: _seen(page, session, one.name))
                    ui.button(say("Seen"), on_click=seen).props("flat dense")
                look = f"/pupil?name={quote(one.name)}"
                ui.button(say("Look"), on_click=partial(ui.navigate.to, look)).props("flat dense")
                if one.taken_by:
                    ui.button(say("Hand back"), on_click=partial(page.act, "hand_back", pupil=one.name)).props(
                        "outline dense"
                    )

    def _where(self, one: PupilStatus) -> str:
        say = self._page.translate
        words = []
        if one.slots:
            words.append(say("program in {slots}", slots=", ".join(one.slots)))
        elif one.runs:
            words.append(say("a program without a slot"))
        else:
            words.append(say("page Program is open") if one.is_open else say("no program"))
        if one.taken_by:
            words.append(say("taken over by {by}", by=one.taken_by))
        elif one.held:
            words.append(say("held"))
        if one.lesson:
            words.append(one.lesson)
        return " · ".join(words)


def _seen(page: Page, session: Session, name: str) -> ChangeResult:
    page.service.accounts.require(session, Right.ARRANGE)
    page.service.operations.pupils.answer_hand(name)
    return ChangeResult(words=page.translate("The hand of {name} is down.", name=name))


def _groups(page: Page) -> None:
    say, control = page.translate, page.service.operations.pupils
    shown: list[object] = []
    with panel().classes("w-full"):
        heading(say("Groups"))
        ui.label(say("A group's slots are for its pupils only; slots of no group are for everybody.")).classes("soft")
        lines = ui.column().classes("w-full").style("gap:0")
        with ui.element("div").classes("row").style("margin-top:.6rem"):
            ui.button(say("New group"), icon="group_add", on_click=lambda: _edit_group(page, "")).props("outline")

            async def make() -> None:
                await page.do(lambda session: page.service.pupils.make_groups(session, page.service.asker(session)))

            ui.button(say("Make the groups by the slots' names"), on_click=make).props("flat")
            ui.button(say("Simulate all empty slots"), on_click=partial(_simulate, page)).props("flat")
        ui.label(say(END_WITH_MASTER)).classes("soft")

    def show() -> None:
        if shown == [control.groups] and lines.default_slot.children:
            return
        shown[:] = [control.groups]
        lines.clear()
        with lines:
            for group in control.groups:
                with ui.element("div").classes("row spread w-full line"):
                    with ui.element("div").style("flex:1;min-width:min(14rem,100%)"):
                        ui.label(group.name).style("font-weight:600")
                        ui.label(
                            say(
                                "{pupils}; slots: {slots}",
                                pupils=", ".join(group.pupils) or say("nobody"),
                                slots=", ".join(group.slots) or say("none"),
                            )
                        ).classes("soft")
                    with ui.element("div").classes("row"):
                        ui.button(say("Edit"), on_click=partial(_edit_group, page, group.name)).props("flat dense")
                        words = say("Take the group {group} away? Its slots are everybody's then.", group=group.name)
                        remove = partial(page.act, "remove_group", group=group.name)
                        ui.button(say("Remove"), on_click=partial(ask_first, page, words, remove)).props("flat dense")
            if not control.groups:
                ui.label(say("No groups: everybody may use every slot.")).classes("soft")

    page.every_look(show)


def _edit_group(page: Page, name: str) -> None:
    say, control = page.translate, page.service.operations.pupils
    known = next((group for group in control.groups if group.name == name), None)
    pupils = sorted({*page.service.pupils.pupils(), *(known.pupils if known else ())}, key=str.casefold)
    slots = [card.name for card in page.service.robot().slots]
    with page_dialog(page) as dialog, ui.card().style("min-width:min(30rem,95vw)"):
        heading(say("Group"))
        title = ui.input(say("Name"), value=name).props("outlined dense autofocus").classes("w-full")
        title.set_enabled(not name)
        who = ui.select(
            pupils, multiple=True, value=list(known.pupils) if known else [], label=say("Pupils"), with_input=True
        )
        _find_by_typing(who)
        own = [slot for slot in known.slots if slot in slots] if known else []
        what = ui.select(slots, multiple=True, value=own, label=say("Slots"), with_input=True)
        _find_by_typing(what)

        async def keep() -> None:
            done = await page.act(
                "group", group=str(title.value or "").strip(), pupils=list(who.value), slots=list(what.value)
            )
            if done is not None:
                dialog.close()

        with ui.element("div").classes("row"):
            ui.button(say("Save"), on_click=keep)
            ui.button(say("Cancel"), on_click=dialog.close).props("flat")
    show_dialog(dialog)


def _find_by_typing(chosen: ui.select) -> None:
    """Let what is chosen from many be found by a part of its name; whoever has found one can look for the next."""
    chosen.props("outlined dense use-chips").props(remove="fill-input").classes("w-full")
    chosen.on("add", js_handler=f"() => getElement({chosen.id}).$refs.qRef.updateInputValue('')")


async def _simulate(page: Page) -> None:
    """Simulated parts for the empty slots; not for those that a pupil's program is to get."""
    wanted = page.service.views.empty_slots()
    failed: list[str] = []
    for slot in wanted:
        try:
            await page.service.operations.do("simulate", who=page.service.asker(page.session), slot=slot)
        except MsbotError as error:
            failed.append(page.translate(str(error)))
        await asyncio.sleep(0)
    with page.in_page():
        if failed:
            ui.notify(failed[0], type="negative", multi_line=True)
        words = page.language.count(
            len(wanted) - len(failed),
            "{count} slot is simulated; those for programs stay empty.",
            "{count} slots are simulated; those for programs stay empty.",
        )
        ui.notify(words, type="positive")


class _Accounts:
    """A pasted list, tickets, the class ticket."""

    def __init__(self, page: Page, base: str) -> None:
        self._page = page
        self._base = base.rstrip("/")
        self._is_busy = False
        say = page.translate
        with panel().classes("w-full"):
            heading(say("New pupils"))
            ui.label(
                say(
                    "A name on each line; after a semicolon the group. Everybody gets a ticket with a code that signs in."
                )
            ).classes("soft")
            self._list = ui.textarea(say("Names")).props("outlined dense autogrow").classes("w-full")
            with ui.element("div").classes("row").style("margin-top:.6rem"):
                days = {number: say("tickets for {days} days", days=number) for number in DAYS}
                days[1] = say("tickets for one day")
                self._days = ui.select(days, value=7).props("outlined dense")
                self._days.props["aria-label"] = say("How long tickets are valid")
                self._let_in = ui.button(say("Let them in"), icon="person_add", on_click=self._ask)
                ui.button(say("Tickets for all"), icon="qr_code", on_click=self._tickets).props("outline")
                ui.button(say("Show a class ticket"), icon="groups", on_click=self._class_ticket).props("outline")
            ui.label(
                say(
                    "Not printed, or lost? Tickets for all makes new ones: their codes sign in without a password. A new "
                    "password is given under Admin."
                )
            ).classes("soft")
            if (urlsplit(self._base).hostname or "") in THIS_COMPUTER:
                ui.label(
                    say(
                        "Tickets made here lead to {address}, which no other computer can open: start the master with "
                        "--host 0.0.0.0, and open this page by the computer's own name or address.",
                        address=self._base,
                    )
                ).classes("soft")

    async def _ask(self) -> None:
        if self._is_busy:  # each password takes a moment to hash, so that a class takes long enough for another click
            return
        self._is_busy = True
        self._let_in.props("loading")
        try:
            await self._let_them_in()
        finally:
            self._is_busy = False
            self._let_in.props(remove="loading")

    async def _let_them_in(self) -> None:
        page, text, days = self._page, str(self._list.value or ""), int(self._days.value)
        made: list[PupilTicket] = []

        async def deed(session: Session) -> ChangeResult:
            made.extend(await page.service.pupils.add(session, text, days, page.service.asker(session)))
            words = page.language.count(len(made), "{count} pupil can sign in.", "{count} pupils can sign in.")
            return ChangeResult(words=words)

        if await page.do(deed) is not None:
            self._list.value = ""
            self._tell_groups_without_slots({one.group for one in made})
            self._print(made)

    def _tell_groups_without_slots(self, new: set[str]) -> None:
        groups, say = self._page.service.operations.pupils.groups, self._page.translate
        bare = [group.name for group in groups if group.name in new and not group.slots]
        if bare and any(group.slots for group in groups):  # the others have some: perhaps a name is misspelt
            words = say(
                "No slots belong to {groups}: are the names spelt as in Groups? Give them slots there.",
                groups=", ".join(bare),
            )
            ui.notify(words, type="warning", multi_line=True, close_button=say("Close"), timeout=0)

    async def _tickets(self) -> None:
        page, made = self._page, []  # type: Page, list[PupilTicket]

        def deed(session: Session) -> ChangeResult:
            made.extend(page.service.pupils.tickets(session, int(self._days.value)))
            return ChangeResult(
                words=page.language.count(len(made), "{count} ticket is made.", "{count} tickets are made.")
            )

        if await page.do(deed) is not None:
            self._print(made)

    def _print(self, tickets: list[PupilTicket]) -> None:
        """A ticket for each pupil to print and cut out."""
        say = self._page.translate
        shown = [(one, qr_svg(self._base + one.path, scale=3)) for one in tickets]
        with ui.dialog() as dialog, ui.card().classes("tickets"):
            with ui.element("div").classes("row no-print"):
                ui.label(say("Whoever has a ticket can act as that pupil."))
                if any(one.password for one in tickets):
                    ui.label(
                        say("Print them now: the passwords are never shown again, and are lost when the master ends.")
                    )
                ui.button(say("Print"), icon="print", on_click=lambda: ui.run_javascript("window.print()"))
                ui.button(say("Close"), on_click=dialog.close).props("flat")
            days = int(self._days.value)
            ui.html(
                render(
                    "pupil_tickets",
                    say=say,
                    tickets=shown,
                    robot=self._page.service.robot_name,
                    base=self._base,
                    days=days,
                ),
                sanitize=False,
            )
        show_dialog(dialog)

    async def _class_ticket(self) -> None:
        page, say = self._page, self._page.translate
        try:
            path, code = page.service.pupils.class_ticket(page.session, MOST_GUESTS)
        except MsbotError as error:
            ui.notify(say(str(error)), type="negative")
            return
        link = self._base + path
        with ui.dialog() as dialog, ui.card().style("max-width:min(34rem,95vw);align-items:center"):
            heading(say("Come in"))
            ui.label(say("Scan the code, or open {address} and type:", address=f"{self._base}/come"))
            ui.label(f"{code[:3]} {code[3:]}").classes("mono").style("font-size:3rem;font-weight:700;user-select:all")
            ui.html(qr_svg(link, scale=6), sanitize=False)
            ui.label(link).classes("mono").style("user-select:all;overflow-wrap:anywhere")
            count = ui.label("").classes("soft").props("role=status")

            def show() -> None:
                left = page.service.pupils.passes.codes.left_s(code)
                words = [
                    say("The code is valid for {minutes} minutes.", minutes=f"{left / 60:.0f}")
                    if left
                    else say("This code is over: close this, and show another one.")
                ]
                if names := page.service.pupils.waiting(page.session):
                    words.append(say("Want to come in, see below: {names}", names=", ".join(names)))
                count.set_text(" ".join(words))

            page.every_look(show, dialog)
            ui.button(say("Close"), on_click=dialog.close).props("flat")
        show_dialog(dialog)
