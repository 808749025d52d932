"""Administration: who may sign in, API tokens, backup and restore. Changes to people need a confirmation."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from fastapi import Request
from nicegui import ui
from nicegui.events import UploadEventArguments

from msbot.operations.rights import Right, Role
from msbot_web.access.access_middleware import MAX_RESTORE
from msbot_web.access.class_list import MOST_BYTES, NewAccount, new_accounts
from msbot_web.access.sessions import Session
from msbot_web.html import render
from msbot_web.models.robot_models import ChangeResult, UserLine
from msbot_web.pages.card_panel import CardPanel
from msbot_web.pages.layout import page_frame
from msbot_web.pages.page import Page
from msbot_web.pages.page_elements import ask_first, file_button, heading, page_dialog, panel, set_html, show_dialog
from msbot_web.root_path import THIS_COMPUTER, base_of
from msbot_web.service import Service
from msbot_web.svg.drawings import qr_svg
from msbot_xrce.errors import MsbotError

if TYPE_CHECKING:
    from nicegui.elements.upload_files import FileUpload  # it and what it needs: when somebody hands a file in

"""Names that lead to another computer from each one."""

CHANGES = 20
"""Changes of people that are shown."""


def register(service: Service) -> None:
    """Make the page known."""

    @ui.page("/admin")
    def admin(request: Request) -> None:
        with page_frame(service, request, "/admin", "Admin") as page:
            if not page.may(Right.ADMINISTER):
                ui.label(page.translate("Only an administrator sees this page.")).classes("ms-banner warn")
                return
            _People(page, base_of(request))
            _tokens(page)
            _Backup(page)
            if service.has_card(page.session):
                CardPanel(page)
            _changes(page)


class _People:
    """Who may sign in."""

    def __init__(self, page: Page, base: str) -> None:
        self._page = page
        self._base = base
        self._shown: list[UserLine] = []
        say = page.translate
        with panel():
            heading(say("People"))
            self._table = ui.column().classes("w-full").style("gap:0")
            with ui.element("div").classes("row").style("margin-top:1rem;align-items:flex-end"):
                self._name = ui.input(say("Name")).props("dense outlined")
                self._password = ui.input(say("Password"), password=True)
                self._password.props("dense outlined autocomplete=new-password")
                self._role = ui.select(_roles(page), value=Role.STUDENT.word, label=say("Role")).props("dense outlined")
                ui.button(say("Add"), icon="person_add", on_click=self._add)
            with ui.element("div").classes("row").style("margin-top:1rem"):
                file_button(page, say("Import a class list (CSV)"), self._import, max_size=MOST_BYTES, ending=".csv")
                ui.label(say("A line for each person: name, role, password. The last two may be left out.")).classes(
                    "soft"
                )
        page.every_look(self._show)

    def _show(self) -> None:
        users = self._page.service.users(self._page.session)
        if users == self._shown and self._table.default_slot.children:
            return
        self._shown = users
        self._table.clear()
        with self._table:
            for user in users:
                self._line(user)
            if not users:
                ui.label(self._page.translate("Nobody yet: add the people of your class below.")).classes("soft")

    def _line(self, user: UserLine) -> None:
        page, say, service = self._page, self._page.translate, self._page.service

        def change(role: str) -> None:
            if role == user.role:
                return
            words = say("Give {name} the role {role}?", name=user.name, role=say(role))
            ask_first(page, words, lambda: page.do(lambda session: service.change_role(session, user.name, role)), back)

        def back() -> None:
            chosen.value = user.role

        def remove() -> None:
            words = say("Remove {name}? Their sessions and API tokens end at once.", name=user.name)
            ask_first(page, words, lambda: page.do(lambda session: service.remove_user(session, user.name)))

        with ui.element("div").classes("row spread w-full line"):
            ui.label(user.name).classes("ellipsis").style("font-weight:600;min-width:8rem")
            with ui.element("div").classes("row"):
                chosen = ui.select(
                    _roles(page), value=user.role, on_change=lambda event: change(str(event.value))
                ).props("dense outlined")
                chosen.props["aria-label"] = say("Role of {name}", name=user.name)
                ui.button(say("New password"), on_click=partial(_ask_password, page, user.name)).props("flat dense")
                button = ui.button(icon="person_remove", on_click=remove).props("flat round dense color=negative")
                button.props["aria-label"] = button.props["title"] = say("Remove {name}", name=user.name)

    async def _add(self) -> None:
        name, role, password = str(self._name.value or ""), str(self._role.value), str(self._password.value or "")
        service = self._page.service

        async def add() -> None:
            if await self._page.do(lambda session: service.add_user(session, name, role, password)) is not None:
                self._name.value, self._password.value = "", ""

        words = self._page.translate("Let {name} sign in as {role}?", name=name or "?", role=self._page.translate(role))
        ask_first(self._page, words, add)

    async def _import(self, event: UploadEventArguments) -> None:
        try:
            people = new_accounts(await event.file.read(), event.file.name, Role.STUDENT)
        except MsbotError as error:
            ui.notify(
                self._page.translate(str(error)),
                type="negative",
                multi_line=True,
                close_button=self._page.translate("Close"),
                timeout=10_000,
            )
            return
        words = self._page.language.count(
            len(people),
            "Let {count} person sign in: {names}?",
            "Let {count} people sign in: {names}?",
            names=", ".join(one.name for one in people),
        )
        if (urlsplit(self._base).hostname or "") in THIS_COMPUTER:
            words += " " + self._page.translate(
                "Their tickets will lead to {address}, which no other computer can open: start the "
                "master with --host 0.0.0.0, and open this page by the computer's own name or "
                "address first.",
                address=self._base,
            )
        ask_first(self._page, words, partial(self._let_in, people))

    async def _let_in(self, people: list[NewAccount]) -> None:
        service = self._page.service
        if await self._page.do(lambda session: service.add_people(session, people)) is not None:
            self._tickets(people)

    def _tickets(self, people: list[NewAccount]) -> None:
        """A ticket for each person to print and cut out; the passwords are shown this once."""
        say, code = self._page.translate, qr_svg(f"{self._base}login", scale=3)
        with ui.dialog() as dialog, ui.card().classes("tickets"):
            with ui.element("div").classes("row no-print"):
                ui.label(say("Print them now: the passwords are never shown again."))
                ui.button(say("Print"), icon="print", on_click=lambda: ui.run_javascript("window.print()"))
                ui.button(say("Close"), on_click=dialog.close).props("flat")
            robot = self._page.service.robot_name
            ui.html(render("tickets", say=say, people=people, robot=robot, base=self._base, code=code), sanitize=False)
        show_dialog(dialog)


def _roles(page: Page) -> dict[str, str]:
    return {one.word: page.translate(one.word) for one in Role}


def _ask_password(page: Page, name: str) -> None:
    say = page.translate
    with page_dialog(page) as dialog, ui.card():
        heading(say("New password for {name}", name=name))
        old = ui.input(say("Old password"), password=True).props("outlined autocomplete=current-password")
        old.set_visibility(name == page.session.name)
        password = ui.input(say("Password"), password=True).props("outlined autocomplete=new-password")

        async def keep() -> None:
            new, present = str(password.value or ""), str(old.value or "")
            done = await page.do(lambda session: page.service.change_password(session, name, new, present))
            if done is not None:
                dialog.close()

        with ui.element("div").classes("row"):
            ui.button(say("Save"), on_click=keep)
            ui.button(say("Cancel"), on_click=dialog.close).props("flat")
    show_dialog(dialog)


def _tokens(page: Page) -> None:
    service, say = page.service, page.translate
    users = {user.name: user for user in service.users(page.session)}
    with panel():
        heading(say("API tokens"))
        ui.label(say("For programs. A token is shown once: guard it like a password.")).classes("soft")
        for user in users.values():
            for purpose in user.tokens:
                with ui.element("div").classes("row spread line"):
                    ui.label(f"{user.name} · {purpose}").classes("ellipsis")
                    remove = partial(_remove_token, page, user.name, purpose)
                    ui.button(say("Remove"), on_click=remove).props("flat dense color=negative")
        if not users:
            ui.label(say("A token belongs to a person: add one first.")).classes("soft")
            return
        with ui.element("div").classes("row").style("margin-top:.8rem;align-items:flex-end"):
            name = (
                ui.select(list(users), value=next(iter(users)), label=say("Name"))
                .props("dense outlined")
                .style("min-width:7rem")
            )
            wanted = ui.input(say("What for")).props("dense outlined")

            async def make() -> None:
                token: list[str] = []

                async def deed(session: Session) -> ChangeResult:
                    token.append(await service.new_token(session, str(name.value), str(wanted.value or "")))
                    return ChangeResult(words=say("The token is made."))

                if await page.do(deed) is not None:
                    with ui.dialog() as dialog, ui.card():
                        ui.label(say("Copy it now: it is never shown again."))
                        ui.label(token[0]).classes("mono").style("user-select:all;overflow-wrap:anywhere")
                        ui.button(say("Close"), on_click=lambda: ui.navigate.to("/admin"))
                    dialog.open()

            ui.button(say("Make a token"), icon="key", on_click=make)


def _remove_token(page: Page, name: str, purpose: str) -> None:
    async def remove() -> None:
        if await page.do(lambda session: page.service.remove_token(session, name, purpose)) is not None:
            ui.navigate.to("/admin")

    ask_first(page, page.translate("Remove the token of {name} for {purpose}?", name=name, purpose=purpose), remove)


class _Backup:
    """Download a backup; hand one in, which is checked: of a large one that takes a while."""

    def __init__(self, page: Page) -> None:
        self._page = page
        say = page.translate
        with panel():
            heading(say("Backup"))
            ui.label(say("The whole database in one file: robots, slots, settings, journal, people.")).classes("soft")
            with ui.element("div").classes("row").style("margin-top:.6rem"):
                ui.button(
                    say("Download a backup"),
                    icon="download",
                    on_click=lambda: ui.download("/api/backup", "msbot-backup.db"),
                )
                self._button = file_button(page, say("Restore a backup"), self._ask, max_size=MAX_RESTORE)
            self._state = ui.label("").classes("soft").props("role=status")

    async def _ask(self, event: UploadEventArguments) -> None:
        words = self._page.translate("Put this backup in force with the master's next start?")
        ask_first(self._page, words, partial(self._restore, event.file))

    async def _restore(self, file: FileUpload) -> None:
        page, say, mb = self._page, self._page.translate, file.size() / 1e6
        self._button.props("loading")
        self._state.set_text(say("{name} ({mb:.1f} MB) is being checked ...", name=file.name, mb=mb))
        done = None
        try:
            done = await page.do(lambda session: page.service.restore(session, file.iterate()))
        finally:
            self._button.props(remove="loading")
            self._state.set_text("" if done is None else say(done.words))


def _changes(page: Page) -> None:
    with panel():
        heading(page.translate("Changes of people and keys"))
        shown = ui.html("", sanitize=False)
    heads = [page.translate(title) for title in ("Time", "By", "Change")]

    async def show() -> None:
        edits = await page.service.people_edits(page.session, CHANGES)
        rows = [(page.when(edit.at_ms), edit.who, page.translate(edit.words)) for edit in edits]
        set_html(shown, render("table", heads=heads, rows=rows or [(page.translate("None yet."),)]))

    page.every_look(show)
