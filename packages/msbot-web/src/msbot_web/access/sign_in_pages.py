"""Signing in: plain pages that need no script, before anything else of the web room is shown."""

from __future__ import annotations

from collections.abc import Callable
from urllib.parse import parse_qs

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, RedirectResponse, Response

from msbot_agent.text.sentence import said
from msbot_web.access.access_middleware import CookieNames
from msbot_web.access.accounts import Accounts
from msbot_web.access.joining_pages import JoiningPages
from msbot_web.access.sessions import GUEST_S, LONGEST_S, Session
from msbot_web.access.sign_in_throttle import SignInRefused
from msbot_web.access.ticket_codes import TicketCodes
from msbot_web.html import render
from msbot_web.language import language_of
from msbot_web.root_path import root
from msbot_xrce.errors import ConfigError

_LONGEST_FORM = 10_000
_MOST_FIELDS = 10
_DEVICE_S = 365 * 24 * 3600
"""How long a browser remembers who has signed in with it."""


def make_forms(
    accounts: Accounts,
    robot: str,
    cookies: CookieNames,
    passes: TicketCodes | None = None,
    *,
    is_open: bool = False,
    is_on_card: Callable[[], bool] = lambda: False,
) -> APIRouter:
    """The pages `/login`, `/setup`, `/enter`, `/join` and `/logout`; with tickets of pupils `/pass` and `/come`, too.

    Args:
        accounts: who may sign in.
        robot: the name that the pages show.
        cookies: what the cookies are called.
        passes: the tickets of pupils; None: there are none.
        is_open: whether the first visitor sets the page up without the link.
        is_on_card: says whether the robot runs from a card of MsBOT; where that is not open, a set-up file is wrong.
    """
    router = APIRouter(include_in_schema=False)

    def page(
        request: Request,
        template: str,
        title: str,
        *,
        status: int = 200,
        headers: dict[str, str] | None = None,
        **values: object,
    ) -> HTMLResponse:
        language = language_of(request)
        html = render(
            template,
            language=language,
            say=language.translate,
            title=language.translate(title),
            robot=robot,
            **{"error": "", "name": "", "why": "", "can_come": passes is not None, **values},
        )
        return HTMLResponse(html, status_code=status, headers=headers)

    @router.get("/login")
    async def show_login(request: Request, next: str = "/") -> Response:
        if accounts.needs_setup and not accounts.has_entry_link:
            if is_open:
                return page(request, "set_up", "Set-up", token=accounts.setup_token())
            return page(request, "set_up_hint", "Set-up", is_on_card=is_on_card())
        ended = accounts.sessions.why_ended(request.cookies.get(cookies.session, ""))
        why = language_of(request).translate(ended)
        return page(request, "sign_in", "Sign in", wanted=local_path(next), why=why)

    @router.post("/login")
    async def login(request: Request) -> Response:
        form = await _form_of(request)
        name, wanted = form.get("name", ""), local_path(form.get("next", "/"))
        device = request.cookies.get(cookies.device, "")
        try:
            session = await accounts.sign_in(name, form.get("password", ""), _address_of(request), device)
        except SignInRefused as refused:
            headers = {"retry-after": f"{refused.retry_after_s:.0f}"} if refused.retry_after_s else None
            status = 429 if refused.retry_after_s else 401
            return page(
                request,
                "sign_in",
                "Sign in",
                wanted=wanted,
                name=name[:64],
                error=language_of(request).translate(str(refused)),
                status=status,
                headers=headers,
            )
        return signed_in(request, session, wanted)

    @router.get("/setup")
    async def show_setup(request: Request, token: str = "") -> Response:
        return page(request, "set_up", "Set-up", token=token)

    @router.post("/setup")
    async def set_up(request: Request) -> Response:
        form = await _form_of(request)
        token = form.get("token", "")
        try:
            if form.get("password", "") != form.get("again", ""):
                raise ConfigError(said("the two passwords are not the same"))
            session = await accounts.set_up(token, form.get("name", ""), form.get("password", ""))
        except (SignInRefused, ConfigError) as error:
            status = 403 if isinstance(error, SignInRefused) else 400
            return page(
                request,
                "set_up",
                "Set-up",
                token=token,
                name=form.get("name", "")[:64],
                error=language_of(request).translate(str(error)),
                status=status,
            )
        return signed_in(request, session, "/admin" if is_open else "/")  # there is more to set up

    @router.get("/enter")
    async def enter(request: Request, token: str = "", next: str = "/") -> Response:
        try:
            session = accounts.enter(token)
        except SignInRefused as refused:
            return page(
                request,
                "sign_in",
                "Sign in",
                wanted=local_path(next),
                error=language_of(request).translate(str(refused)),
                status=403,
            )
        return signed_in(request, session, local_path(next))

    @router.post("/logout")
    async def log_out(request: Request) -> Response:
        session = request.scope["state"].get("session")
        if session is not None:
            accounts.sign_out(session, request.cookies.get(cookies.device, ""))
        response = RedirectResponse("/login", status_code=303)
        response.delete_cookie(cookies.session, path=root() or "/")
        response.delete_cookie(cookies.device)
        return response

    def signed_in(request: Request, session: Session, wanted: str) -> Response:
        response = RedirectResponse(wanted, status_code=303)
        is_secure = request.url.scheme == "https"
        response.set_cookie(
            cookies.session,
            session.token,
            max_age=int(GUEST_S if session.guest_of else LONGEST_S),
            path=root() or "/",
            httponly=True,
            samesite="lax",
            secure=is_secure,
        )
        if not session.is_lasting and not session.guest_of:
            response.set_cookie(
                cookies.device,
                accounts.browsers.note_sign_in(request.cookies.get(cookies.device, ""), session.name),
                max_age=_DEVICE_S,
                path=root() or "/",
                httponly=True,
                samesite="strict",
                secure=is_secure,
            )
        return response

    _add_guest_forms(router, accounts, page, signed_in)
    if passes is not None:
        JoiningPages(passes, page=page, signed_in=signed_in, form_of=_form_of, address_of=_address_of).add_to(router)
    return router


def _add_guest_forms(
    router: APIRouter, accounts: Accounts, page: Callable[..., Response], signed_in: Callable[..., Response]
) -> None:
    """What whoever scans a ticket sees (`msbot_web.access.guest_tickets`)."""

    @router.get("/join")
    async def show_join(request: Request, ticket: str = "") -> Response:
        if request.scope["state"].get("session") is not None:  # somebody known: the ticket is not needed
            return RedirectResponse(accounts.guests.tickets.path_of(ticket) or "/program", status_code=303)
        try:
            found = accounts.guests.tickets.find(ticket)
        except SignInRefused as refused:
            return refused_guest(request, refused)
        return page(request, "join", "Join", ticket=ticket, maker=found.maker)

    @router.post("/join")
    async def join(request: Request) -> Response:
        """Only a press of the button uses the ticket up: cameras and chats fetch links to show what is behind them."""
        form = await _form_of(request)
        try:
            session, path = accounts.guests.admit(form.get("ticket", ""))
        except SignInRefused as refused:
            return refused_guest(request, refused)
        return signed_in(request, session, path)

    def refused_guest(request: Request, refused: SignInRefused) -> Response:
        words = language_of(request).translate(str(refused))
        return page(request, "sign_in", "Sign in", wanted="/program", error=words, status=403)


def local_path(wanted: str) -> str:
    """Where to go after signing in: a path of this server, never another site."""
    is_local = wanted.startswith("/") and not wanted.startswith(("//", "/\\")) and wanted.isprintable()
    return wanted if is_local and "\\" not in wanted else "/"


async def _form_of(request: Request) -> dict[str, str]:
    body = await request.body()
    if len(body) > _LONGEST_FORM or body.count(b"&") >= _MOST_FIELDS:
        return {}
    fields = parse_qs(body.decode("utf-8", "replace"), keep_blank_values=True)
    return {name: values[0] for name, values in fields.items()}


def _address_of(request: Request) -> str:
    return request.client.host if request.client is not None else ""
