"""What a browser may run, show and ask for on our pages: the Content-Security-Policy of every answer.

A text of a stranger that reaches a page as HTML, by whatever mistake, runs no script: `'unsafe-inline'` is not there,
so that neither an attribute such as `onerror` nor a `<script>` runs. The few scripts that NiceGUI writes into a page
carry a word that is made anew for each answer (a nonce). All others are files of this server.

What remains, and why: `'unsafe-eval'`, because NiceGUI runs what the robot sends to its own page by `eval`, and Vue
compiles its templates in the browser; `'unsafe-inline'` for styles, because both write `style="..."`.
"""

from __future__ import annotations

import re
import secrets
from collections.abc import Callable, Iterable, Sequence

from jinja2 import BaseLoader, Environment
from starlette.requests import HTTPConnection
from starlette.types import Scope, Send

from msbot_web.access.sessions import Session
from msbot_web.html import Markup, render
from msbot_web.language import language_of

NONCE = "nonce"
"""Where a request's word is, in its state."""
_SCRIPT = re.compile(r"<script\b")


def new_nonce() -> str:
    """The word of one answer."""
    return secrets.token_urlsafe(16)


def page_policy(nonce: str) -> bytes:
    """The value of the header, for a page whose own scripts carry this word."""
    return (
        f"default-src 'self'; script-src 'self' 'nonce-{nonce}' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
        "img-src 'self' data:; font-src 'self' data:; connect-src 'self'; object-src 'none'; "
        "frame-ancestors 'none'; base-uri 'self'; form-action 'self'"
    ).encode()


class NonceLoader(BaseLoader):
    """Gives the request's word to the scripts that stand in a template itself, and not to what is filled into it.

    Args:
        loader: where the templates come from.
    """

    def __init__(self, loader: BaseLoader) -> None:
        self._loader = loader

    def get_source(self, environment: Environment, template: str) -> tuple[str, str | None, Callable[[], bool] | None]:
        """As the environment asks for it."""
        source, path, is_current = self._loader.get_source(environment, template)
        return _SCRIPT.sub(f'<script nonce="{{{{ request.scope.state.{NONCE} }}}}"', source), path, is_current


# A page that is not given at this moment, or at all: a small one in its place, with STOP for who may press it, the
# reason, and a script that brings the page back by itself. Programs get the reason as text.


PASSING = (408, 421, 425, 429, 500, 502, 503, 504)
"""Statuses of refusals that end by themselves or by what somebody does at the robot: it is worth asking again."""
PLAIN, HTML = b"text/plain; charset=utf-8", b"text/html; charset=utf-8"


def wants_page(scope: Scope) -> bool:
    """Whether a browser asks for a page to show it, not a script or a program for something else."""
    return scope["type"] == "http" and b"text/html" in dict(scope.get("headers", ())).get(b"accept", b"")


def refusal_page(
    scope: Scope, words: str, *, session: Session | None, comes_back: bool, ways: Sequence[str] = ()
) -> bytes:
    """The page, as it is sent.

    Args:
        scope: the request, which says the language.
        words: the reason: a sentence without its capital and full stop.
        session: who has asked; None: nobody known, who may not press STOP.
        comes_back: whether it is worth asking again.
        ways: addresses that lead to the robot; none: the one that was asked for does.
    """
    language = language_of(HTTPConnection(scope))
    stop = "" if session is None else render("stop", say=language.translate, csrf=session.csrf)
    page = render(
        "refused",
        language=language,
        say=language.translate,
        title=language.translate("Not now" if comes_back else "Not there"),
        robot="MsBOT",
        stop=Markup(stop),
        why=sentence(language.translate(words)),
        comes_back=comes_back and scope["method"] in ("GET", "HEAD"),
        ways=ways,
    )
    return page.encode()


async def refuse(
    scope: Scope,
    send: Send,
    status: int,
    words: str,
    *,
    session: Session | None,
    headers: Iterable[tuple[bytes, bytes]] = (),
) -> None:
    """Answer a request with a refusal."""
    comes_back = status in PASSING
    if wants_page(scope):
        kind, body = HTML, refusal_page(scope, words, session=session, comes_back=comes_back)
    else:
        kind, body = PLAIN, f"{sentence(words)}\n".encode()
    head = [
        (b"content-type", kind),
        (b"content-length", str(len(body)).encode()),
        (b"cache-control", b"no-store"),
        *headers,
    ]
    await send({"type": "http.response.start", "status": status, "headers": head})
    await send({"type": "http.response.body", "body": body})


def sentence(words: str) -> str:
    """With a capital and a full stop."""
    whole = f"{words[:1].upper()}{words[1:]}"
    return whole if whole.endswith((".", "!", "?")) else f"{whole}."
