"""What a pupil sees who scans a ticket: the own one (`/pass`), or the one of the class (`/come`).

Looking at a ticket does not use it, only a press of its button: cameras and chats fetch links to show what is behind them.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable

from fastapi import APIRouter, Request
from fastapi.responses import Response

from msbot.operations.rights import Role
from msbot_web.access.accounts import Accounts
from msbot_web.access.attempts import SignInRefused
from msbot_web.access.class_list import new_password
from msbot_web.access.passes import Passes
from msbot_web.language import language_of
from msbot_xrce.errors import MsbotError

AFTER = "/program"
"""Where a pupil comes to."""


def add_ticket_forms(
    router: APIRouter, accounts: Accounts, passes: Passes, *, page: Callable[..., Response],
    signed_in: Callable[..., Response], form_of: Callable[[Request], Awaitable[dict[str, str]]],
) -> None:  # fmt: skip
    """Add the two pages.

    Args:
        router: where.
        accounts: who may sign in.
        passes: tickets of pupils and of classes.
        page: makes a page from a template.
        signed_in: answers with a session's cookie.
        form_of: reads a form.
    """

    def refused(request: Request, error: MsbotError) -> Response:
        words = language_of(request).say(str(error))
        return page(request, "sign_in", "Sign in", wanted=AFTER, error=words, status=403)

    @router.get("/pass")
    async def show_pass(request: Request, word: str = "") -> Response:
        try:
            return page(request, "pass", "Sign in", word=word, name=passes.find(word))
        except SignInRefused as error:
            return refused(request, error)

    @router.post("/pass")
    async def use_pass(request: Request) -> Response:
        form = await form_of(request)
        try:
            return signed_in(request, passes.admit(form.get("word", "")), AFTER)
        except SignInRefused as error:
            return refused(request, error)

    @router.get("/come")
    async def show_class_ticket(request: Request, ticket: str = "") -> Response:
        try:
            maker = passes.find_class(ticket).maker
        except SignInRefused as error:
            return refused(request, error)
        return page(request, "come_in", "Come in", ticket=ticket, maker=maker)

    @router.post("/come")
    async def come_in(request: Request) -> Response:
        form = await form_of(request)
        ticket, name = form.get("ticket", ""), form.get("name", "").strip()
        try:
            # One place is taken before the password is hashed, so that not more come in than the ticket has places.
            maker = passes.find_class(ticket).maker
            passes.class_tickets.use(ticket)
        except SignInRefused as error:
            return refused(request, error)
        try:
            await accounts.add_user(name, Role.STUDENT, new_password(), who=maker)
        except MsbotError as error:
            passes.class_tickets.give_back(ticket)
            words = language_of(request).say(str(error))
            return page(
                request, "come_in", "Come in", ticket=ticket, maker=maker, name=name[:64], error=words, status=400
            )
        return signed_in(request, accounts.sessions.begin(name, Role.STUDENT), AFTER)
