"""A page that is not given at this moment, or at all: a small one in its place, with STOP for who may press it, the
reason, and a script that brings the page back by itself. Programs get the reason as text."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from starlette.requests import HTTPConnection
from starlette.types import Scope, Send

from msbot_web.access.sessions import Session
from msbot_web.html import Markup, render
from msbot_web.language import language_of

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
    stop = "" if session is None else render("stop", say=language.say, csrf=session.csrf)
    page = render(
        "refused",
        language=language,
        say=language.say,
        title=language.say("Not now" if comes_back else "Not there"),
        robot="MsBOT",
        stop=Markup(stop),
        why=sentence(language.say(words)),
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
