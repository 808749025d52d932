"""Administration: who may sign in, API tokens, backup and restore."""

from __future__ import annotations

from functools import partial
from html import escape

from fastapi import Request
from nicegui import ui
from nicegui.events import UploadEventArguments

from msbot.web.accounts import Session
from msbot.web.guard import MAX_RESTORE
from msbot.web.models import Done, UserLine
from msbot.web.pages.layout import Page, file_button, page_frame
from msbot.web.roles import Right, Role
from msbot.web.service import Service


def register(service: Service) -> None:
    """Make the page known."""

    @ui.page("/admin")
    def admin(request: Request) -> None:
        with page_frame(service, request, "/admin", "Admin") as page:
            if not page.may(Right.ADMINISTER):
                ui.label(page.say("Only an administrator sees this page.")).classes("ms-banner warn")
                return
            _users(page)
            _tokens(page)
            _backup(page)


def _users(page: Page) -> None:
    service, say = page.service, page.say
    with ui.element("div").classes("panel"):
        ui.html(f"<h2>{escape(say('People'))}</h2>", sanitize=False)
        table = ui.column().classes("w-full").style("gap:0")

        def fill() -> None:
            table.clear()
            with table:
                for user in service.users(page.session):
                    _user_line(page, user, fill)
                if not service.users(page.session):
                    ui.label(say("Nobody yet: add the people of your class below.")).classes("soft")

        fill()
        with ui.element("div").classes("row").style("margin-top:1rem;align-items:flex-end"):
            name = ui.input(say("Name")).props("dense outlined")
            password = ui.input(say("Password"), password=True).props("dense outlined autocomplete=new-password")
            role = ui.select(
                {one.word: say(one.word) for one in Role}, value=Role.STUDENT.word, label=say("Role")
            ).props("dense outlined")

            def add() -> None:
                done = page.do(
                    lambda session: service.add_user(
                        session, str(name.value or ""), str(role.value), str(password.value or "")
                    )
                )
                if done is not None:
                    name.value, password.value = "", ""
                    fill()

            ui.button(say("Add"), icon="person_add", on_click=add)


def _user_line(page: Page, user: UserLine, again: object) -> None:
    assert callable(again)
    service, say = page.service, page.say

    def change(role: str) -> None:
        if role != user.role:
            page.do(lambda session: service.change_user(session, user.name, role, None))
            again()

    def remove() -> None:
        if page.do(lambda session: service.remove_user(session, user.name)) is not None:
            again()

    with ui.element("div").classes("row spread w-full").style("border-bottom:1px solid var(--line);padding:.35rem 0"):
        ui.label(user.name).style("font-weight:600;min-width:8rem")
        with ui.element("div").classes("row"):
            ui.select(
                {one.word: say(one.word) for one in Role},
                value=user.role,
                on_change=lambda event: change(str(event.value)),
            ).props(f'dense outlined aria-label="{escape(say("Role"))}"')
            ui.button(say("New password"), on_click=partial(_ask_password, page, user.name)).props("flat dense")
            ui.button(icon="person_remove", on_click=remove).props(
                f'flat round dense color=negative aria-label="{escape(say("Remove {name}", name=user.name))}"'
            )


def _ask_password(page: Page, name: str) -> None:
    say = page.say
    with ui.dialog() as dialog, ui.card():
        ui.label(say("New password for {name}", name=name)).classes("text-h6")
        password = ui.input(say("Password"), password=True).props("outlined autocomplete=new-password autofocus")

        def keep() -> None:
            done = page.do(lambda session: page.service.change_user(session, name, None, str(password.value or "")))
            if done is not None:
                dialog.close()

        with ui.element("div").classes("row"):
            ui.button(say("Keep"), on_click=keep)
            ui.button(say("Cancel"), on_click=dialog.close).props("flat")
    dialog.on("hide", dialog.delete)
    dialog.open()


def _tokens(page: Page) -> None:
    service, say = page.service, page.say
    users = {user.name: user for user in service.users(page.session)}
    with ui.element("div").classes("panel"):
        ui.html(
            f"<h2>{escape(say('API tokens'))}</h2><p class='soft'>{escape(say('For programs: shown once, worth as much as a password.'))}</p>",
            sanitize=False,
        )
        for user in users.values():
            for purpose in user.tokens:
                with ui.element("div").classes("row spread").style("border-bottom:1px solid var(--line)"):
                    ui.label(f"{user.name} · {purpose}")
                    ui.button(
                        say("Remove"),
                        on_click=partial(_remove_token, page, user.name, purpose),
                    ).props("flat dense color=negative")
        if not users:
            ui.label(say("A token belongs to a person: add one first.")).classes("soft")
            return
        with ui.element("div").classes("row").style("margin-top:.8rem;align-items:flex-end"):
            name = ui.select(list(users), value=next(iter(users)), label=say("Name")).props("dense outlined")
            wanted = ui.input(say("What for")).props("dense outlined")

            def make() -> None:
                token: list[str] = []

                def deed(session: Session) -> Done:
                    token.append(service.new_token(session, str(name.value), str(wanted.value or "")))
                    return Done(words=say("The token is made."))

                if page.do(deed) is not None:
                    with ui.dialog() as dialog, ui.card():
                        ui.label(say("Copy it now: it is never shown again."))
                        ui.label(token[0]).classes("mono").style("user-select:all;overflow-wrap:anywhere")
                        ui.button(say("Close"), on_click=lambda: ui.navigate.to("/admin"))
                    dialog.open()

            ui.button(say("Make a token"), icon="key", on_click=make)


def _remove_token(page: Page, name: str, purpose: str) -> None:
    if page.do(lambda session: page.service.remove_token(session, name, purpose)) is not None:
        ui.navigate.to("/admin")


def _backup(page: Page) -> None:
    service, say = page.service, page.say
    with ui.element("div").classes("panel"):
        ui.html(
            f"<h2>{escape(say('Backup'))}</h2><p class='soft'>{escape(say('The whole database in one file: robots, slots, settings, journal, people.'))}</p>",
            sanitize=False,
        )

        async def restore(event: UploadEventArguments) -> None:
            content = await event.file.read()
            page.do(lambda session: service.restore(session, content))

        with ui.element("div").classes("row").style("margin-top:.6rem"):
            ui.button(
                say("Download a backup"),
                icon="download",
                on_click=lambda: ui.download("/api/backup", "msbot-backup.db"),
            )
            file_button(page, say("Restore a backup"), restore, max_size=MAX_RESTORE)
