"""Signing in: plain pages that need no script, before anything else of the web room is shown."""

from __future__ import annotations

from html import escape
from urllib.parse import parse_qs

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, RedirectResponse, Response

from msbot.errors import ConfigError
from msbot.web.accounts import LONGEST_S, Accounts, Session, SignInRefused
from msbot.web.guard import COOKIE
from msbot.web.language import Language, language_of

_LONGEST_FORM = 10_000
_MOST_FIELDS = 10


def make_forms(accounts: Accounts, robot: str) -> APIRouter:
    """The pages `/login`, `/setup`, `/enter` and `/logout`; `robot` is the name they show."""
    router = APIRouter(include_in_schema=False)

    @router.get("/login")
    async def show_login(request: Request, next: str = "/") -> Response:
        if accounts.needs_setup and not accounts.has_entry_link:
            return _setup_hint(request, robot)
        return _login_page(request, robot, next)

    @router.post("/login")
    async def login(request: Request) -> Response:
        form = await _form_of(request)
        try:
            session = accounts.sign_in(form.get("name", ""), form.get("password", ""), _address_of(request))
        except SignInRefused as refused:
            headers = {"retry-after": f"{refused.retry_after_s:.0f}"} if refused.retry_after_s else None
            status = 429 if refused.retry_after_s else 401
            return _login_page(request, robot, form.get("next", "/"), str(refused), status=status, headers=headers)
        return _signed_in(request, session, form.get("next", "/"))

    @router.get("/setup")
    async def show_setup(request: Request, token: str = "") -> Response:
        return _setup_page(request, robot, token)

    @router.post("/setup")
    async def set_up(request: Request) -> Response:
        form = await _form_of(request)
        token = form.get("token", "")
        if form.get("password", "") != form.get("again", ""):
            return _setup_page(request, robot, token, "the two passwords are not the same", status=400)
        try:
            session = accounts.set_up(token, form.get("name", ""), form.get("password", ""))
        except SignInRefused as refused:
            return _setup_page(request, robot, token, str(refused), status=403)
        except ConfigError as error:
            return _setup_page(request, robot, token, str(error), status=400)
        return _signed_in(request, session, "/")

    @router.get("/enter")
    async def enter(request: Request, token: str = "", next: str = "/") -> Response:
        try:
            session = accounts.enter(token)
        except SignInRefused as refused:
            return _login_page(request, robot, next, str(refused), status=403)
        return _signed_in(request, session, next)

    @router.post("/logout")
    async def log_out(request: Request) -> Response:
        session = request.scope["state"].get("session")
        if session is not None:
            accounts.sign_out(session)
        response = RedirectResponse("/login", status_code=303)
        response.delete_cookie(COOKIE)
        return response

    return router


def local_path(wanted: str) -> str:
    """Where to go after signing in: a path of this server, never another site."""
    is_local = wanted.startswith("/") and not wanted.startswith(("//", "/\\")) and wanted.isprintable()
    return wanted if is_local and "\\" not in wanted else "/"


def _signed_in(request: Request, session: Session, wanted: str) -> Response:
    response = RedirectResponse(local_path(wanted), status_code=303)
    response.set_cookie(
        COOKIE,
        session.token,
        max_age=int(LONGEST_S),
        httponly=True,
        samesite="lax",
        secure=request.url.scheme == "https",
        path="/",
    )
    return response


async def _form_of(request: Request) -> dict[str, str]:
    body = await request.body()
    if len(body) > _LONGEST_FORM or body.count(b"&") >= _MOST_FIELDS:
        return {}
    fields = parse_qs(body.decode("utf-8", "replace"), keep_blank_values=True)
    return {name: values[0] for name, values in fields.items()}


def _address_of(request: Request) -> str:
    return request.client.host if request.client is not None else ""


def _setup_hint(request: Request, robot: str) -> HTMLResponse:
    say = language_of(request).say
    hint = say("Nobody can sign in yet. Open the set-up link that msbot has printed in its terminal.")
    return _page(request, robot, say("Set-up"), f"<p>{escape(hint)}</p>")


def _login_page(
    request: Request, robot: str, wanted: str, error: str = "", *, status: int = 200,
    headers: dict[str, str] | None = None,
) -> HTMLResponse:  # fmt: skip
    say = language_of(request).say
    body = (
        f"<p>{escape(say('Sign in to see the robot.'))}</p>{_error(error)}"
        f'<form method="post" action="/login"><input type="hidden" name="next" value="{escape(local_path(wanted))}">'
        f'<label>{escape(say("Name"))}<input name="name" autocomplete="username" required autofocus></label>'
        f'<label>{escape(say("Password"))}<input name="password" type="password" autocomplete="current-password" required>'
        f'</label><button type="submit">{escape(say("Sign in"))}</button></form>'
    )
    return _page(request, robot, say("Sign in"), body, status=status, headers=headers)


def _setup_page(request: Request, robot: str, token: str, error: str = "", *, status: int = 200) -> HTMLResponse:
    say = language_of(request).say
    body = (
        f"<p>{escape(say('Choose a name and a password for the first administrator.'))}</p>{_error(error)}"
        f'<form method="post" action="/setup"><input type="hidden" name="token" value="{escape(token)}">'
        f'<label>{escape(say("Name"))}<input name="name" autocomplete="username" required autofocus maxlength="64"></label>'
        f'<label>{escape(say("Password"))}<input name="password" type="password" autocomplete="new-password" required '
        f'minlength="8"></label>'
        f'<label>{escape(say("Password again"))}<input name="again" type="password" autocomplete="new-password" required>'
        f'</label><button type="submit">{escape(say("Set up"))}</button></form>'
    )
    return _page(request, robot, say("Set-up"), body, status=status)


def _error(text: str) -> str:
    return f'<p class="error" role="alert">{escape(text)}</p>' if text else ""


def _page(
    request: Request, robot: str, title: str, body: str, *, status: int = 200, headers: dict[str, str] | None = None
) -> HTMLResponse:
    language: Language = language_of(request)
    html = (
        f'<!doctype html><html lang="{language.code}"><head><meta charset="utf-8">'
        f'<meta name="viewport" content="width=device-width, initial-scale=1"><title>{escape(title)} · MsBOT</title>'
        f'<link rel="stylesheet" href="/web/form.css"><link rel="icon" href="/web/icon.svg"></head>'
        f"<body><main><h1>{escape(robot)}</h1>{body}</main></body></html>"
    )
    return HTMLResponse(html, status_code=status, headers=headers)
