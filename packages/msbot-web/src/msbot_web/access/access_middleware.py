"""The one gate in front of every page, API call and websocket: who is asking, and from our own page?

It stands outside of everything else, so that a page that is forgotten here is closed, not open. What it refuses:

* a `Host` that is not this server's (DNS rebinding);
* anything without a session, but for signing in, the health check and files without secrets;
* a changing request that only a cookie vouches for, without the session's CSRF word or from another origin;
* a websocket from another origin (cross-site websocket hijacking), and an upload to somebody else's page;
* bodies that are larger than the path allows.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, MutableMapping
from http.cookies import CookieError, SimpleCookie
from ipaddress import ip_address
from typing import TypeAlias
from urllib.parse import quote, urlsplit

from nicegui.version import __version__ as nicegui_version
from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from msbot.operations.rights import Right
from msbot.registry.maintenance.database_maintenance import MOST_OF_PAGE
from msbot_agent.link.net import PART_PATH
from msbot_agent.text.sentence import said
from msbot_web.access.accounts import Accounts
from msbot_web.access.content_policy import HTML, NONCE, PASSING, new_nonce, page_policy, refusal_page, wants_page
from msbot_web.access.reverse_proxies import UNTRUSTED
from msbot_web.access.sessions import Session
from msbot_web.installable_page import MANIFEST_PATH, SHELL_PATH, WORKER_PATH
from msbot_web.root_path import THIS_COMPUTER
from msbot_xrce.counting import Tally
from msbot_xrce.lazy import dataclass

# The names of a robot's cookies. Cookies know no ports, so each robot on a computer has names of its own.


@dataclass(frozen=True, slots=True)
class CookieNames:
    """What the cookies of one robot are called."""

    session: str = "msbot_session"
    """Holds the session's word."""
    device: str = "msbot_device"
    """The word of a browser that a person is known in."""


def cookie_names(mark: str) -> CookieNames:
    """The names for the robot with that mark: letters and digits."""
    return CookieNames(f"msbot_session_{mark}", f"msbot_device_{mark}")


CSRF_HEADER = "x-csrf-token"
MAX_BODY = 1024 * 1024
"""Octets of a request's body; `restore` may have more."""
MAX_RESTORE = MOST_OF_PAGE
LONGEST_NUMBER = 18
"""Digits of a length in a header."""
HEALTH_PATH = "/api/health"
"""Whether the server runs; services and containers ask."""
OPEN_PATHS = (
    "/login", "/setup", "/enter", "/join", "/pass", "/come", HEALTH_PATH, "/openapi.json", "/favicon.ico", "/web/",
    MANIFEST_PATH, WORKER_PATH, SHELL_PATH,
    f"/_nicegui/{nicegui_version}/",
)  # fmt: skip
"""What may be had without signing in: forms to do so, and files that are the same for everybody."""
BEAT_PATH = "/beat"
"""Requested by open pages all the time, to see whether the robot is there. Answered here, at once."""
TURN_PATH = "/turn"
"""Requested by a page that has to be made anew, before it is loaded: when is its turn?"""
SEEN_PATH = "/seen"
"""Requested by a page whose connection does not come up: how does the robot see its requests?"""
METRICS_PATH = "/metrics"
"""Figures for Prometheus, which shows an API token."""
SCRIPT_PATHS = (BEAT_PATH, TURN_PATH, SEEN_PATH, METRICS_PATH)
"""What only scripts and programs ask for: no form to sign in would help them."""
NO_FIGURES = (
    "these figures are for people who are signed in and for programs with an API token: an administrator makes one on "
    "the page Admin, API tokens; the program sends it as the header Authorization: Bearer TOKEN"
)
"""The answer to a program that shows no valid token: it could do nothing with the form to sign in."""
UPLOAD_PATH = "/_nicegui/client/"
"""Where NiceGUI takes files uploaded on a page; the page's number follows."""
SOCKET_PATH = "/_nicegui_ws/"
"""Where the pages' connections for what is live come in: websockets, or long polling where none pass."""
STOP_PATH = "/api/stop"
"""STOP, which goes through a proxy that changes the address, too: the CSRF word alone shows that it is from our page."""
FILES_PATH = "/web/"
"""Files that are the same for everybody: pages of refusal need them under whatever name they are asked for."""
ANY_ADDRESS = "*address*"
"""Among the allowed hosts: every IP address. Only names can be made to lead somewhere else (DNS rebinding)."""
SIGN_OUT_PATH = "/logout"
"""A plain form as well; all that another site could do with it is checked by its origin."""
FORM_PATHS = ("/login", "/setup", "/join", "/pass", "/come")
"""Forms that are sent before there is a session; their origin is checked all the same."""
SAFE_METHODS = ("GET", "HEAD", "OPTIONS")

TOO_LONG = "too_long"
"""In a request's state: its body has no length in the header, and is longer than allowed."""

HEADERS = (
    (b"x-content-type-options", b"nosniff"),
    (b"x-frame-options", b"DENY"),
    (b"referrer-policy", b"same-origin"),  # not no-referrer: forms would then come with the origin "null"
    (b"cross-origin-opener-policy", b"same-origin"),
)
POLICY = b"content-security-policy"

STRICT_TRANSPORT = (b"strict-transport-security", b"max-age=86400")
"""A day: the host may serve another robot without TLS next week."""

Headers: TypeAlias = dict[str, str]


class AccessMiddleware:
    """ASGI middleware: see the module's docstring.

    Args:
        app: everything behind it.
        accounts: who is signed in.
        hosts: host names under which this server may be addressed.
        cookies: what the cookies are called.
        owns: whether the page of that number belongs to a session.
        beat: the answer to open pages that ask whether the robot is there.
        is_tls: whether it is served by TLS: browsers are told to ask for that always.
        api: the application that describes the API, for the page about it; None: `app`.
        signed_in: gets the address from which somebody who is signed in has come.
    """

    def __init__(
        self,
        app: ASGIApp,
        accounts: Accounts,
        hosts: Iterable[str],
        *,
        cookies: CookieNames,
        owns: Callable[[str, Session | None], bool],
        beat: Callable[[], bytes],
        is_tls: bool = False,
        api: ASGIApp | None = None,
        signed_in: Callable[[str], None] = lambda _: None,
    ) -> None:
        self._app = app
        self._api = api or app
        self._accounts = accounts
        self._hosts = frozenset(host.casefold() for host in hosts)
        self._cookies = cookies
        self._owns = owns
        self._beat = beat
        self._signed_in = signed_in
        self._headers = (*HEADERS, STRICT_TRANSPORT) if is_tls else HEADERS
        self.refused = Tally()
        """Requests that were not let through, by reason in words."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let a request through, or answer it here."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = _headers_of(scope)
        path: str = scope["path"]
        refusal = None if path.startswith(FILES_PATH) else self._check_host(headers)
        if refusal is None and path == BEAT_PATH and scope["type"] == "http":
            await self._answer_beat(send, headers)
            return
        session = None if refusal else self._session_of(path, headers)
        if session is not None:
            self._signed_in((scope.get("client") or ("",))[0])
        if refusal is None:
            refusal = self._check(scope, path, headers, session)
        if refusal is not None:
            await self._refuse(scope, receive, send, *refusal, session=session)
            return
        if path == SEEN_PATH and scope["type"] == "http":
            await self._answer(send, 200, _as_seen(scope, headers), [(b"content-type", b"application/json")])
            return
        scope.setdefault("state", {}).update({"session": session, "api": self._api, NONCE: new_nonce()})
        if scope["type"] == "websocket":
            await self._app(scope, receive, send)
        else:
            await self._pass(scope, receive, send, path, session)

    async def _pass(self, scope: Scope, receive: Receive, send: Send, path: str, session: Session | None) -> None:
        """Have a request answered; a body that turns out larger than allowed is refused instead."""
        most, headers = _most_of(path, session), self._with_headers(send, path, scope["state"][NONCE])
        is_answered = False

        async def answer(message: MutableMapping[str, object]) -> None:
            nonlocal is_answered
            if not scope["state"].get(TOO_LONG):
                await headers(message)
            elif message["type"] == "http.response.start" and not is_answered:
                await self._refuse(scope, receive, send, *_too_long(most), session=session)
            is_answered = True

        try:
            await self._app(scope, _limited(scope, receive, most), answer)
        except (RuntimeError, ClientDisconnect) as error:
            if not is_client_gone(scope, error):
                raise

    def _check_host(self, headers: Headers) -> tuple[int, str] | None:
        try:
            host = (urlsplit(f"//{headers.get('host', '')}").hostname or "").casefold()
        except ValueError:  # an unmatched bracket
            host = ""
        if host in self._hosts or (ANY_ADDRESS in self._hosts and _is_address(host)):
            return None
        return 421, said(
            "this robot is not asked for by the name {name}: use the address that msbot has printed, or have it started "
            "with --page-name and this name",
            name=host[:80] or "(none)",
        )

    def _ways(self, scope: Scope) -> list[str]:
        """Addresses under which this server answers whoever has asked."""
        port = (scope.get("server") or ("", None))[1]
        is_here = (scope.get("client") or ("",))[0] in THIS_COMPUTER
        names = sorted(host for host in self._hosts - {ANY_ADDRESS} if is_here or host not in THIS_COMPUTER)
        spelt = (f"[{name}]" if ":" in name else name for name in names)
        return [f"{scope['scheme']}://{name}{f':{port}' if port else ''}/" for name in spelt]

    async def _answer_beat(self, send: Send, headers: Headers) -> None:
        """Whether the robot is there, for a signed-in page; asking does not count as using the session."""
        session = self._accounts.sessions.find(_cookie_in(headers.get("cookie", ""), self._cookies.session))
        if session is None or not self._accounts.holds(session):
            await self._answer(send, 401, b"", [])
        else:
            await self._answer(send, 200, self._beat(), [(b"content-type", b"application/json")])

    def _session_of(self, path: str, headers: Headers) -> Session | None:
        bearer = headers.get("authorization", "")
        if bearer and (path.startswith("/api/") or path == METRICS_PATH):
            scheme, _, token = bearer.partition(" ")
            find = self._accounts.by_word_of_parts if path == PART_PATH else self._accounts.by_api_token
            return find(token.strip()) if scheme.casefold() == "bearer" else None
        return self._accounts.session(_cookie_in(headers.get("cookie", ""), self._cookies.session))

    def _check(self, scope: Scope, path: str, headers: Headers, session: Session | None) -> tuple[int, str] | None:
        method = scope.get("method", "GET")
        is_changing = scope["type"] == "websocket" or method not in SAFE_METHODS
        is_open = scope["type"] == "http" and any(
            path == known or (known.endswith("/") and path.startswith(known)) for known in OPEN_PATHS
        )
        is_live = path.startswith(SOCKET_PATH)
        shows_word = session is not None and headers.get(CSRF_HEADER, "") == session.csrf
        is_ours = _is_own_origin(headers) or (shows_word and (is_live or path == STOP_PATH))
        # What is live answers to GET, too, and its library would let every site read that.
        if (is_changing or is_live) and (session is None or not session.is_program) and not is_ours:
            return 403, "this request comes from another site"
        if path.startswith(UPLOAD_PATH) and not self._owns(path[len(UPLOAD_PATH) :].partition("/")[0], session):
            return (401, "sign in first") if session is None else (403, "this page was opened by somebody else")
        if session is None:
            may_enter = path in FORM_PATHS if is_changing else is_open
            words = NO_FIGURES if path == METRICS_PATH else "sign in first"
            return _check_length(path, headers, None) if may_enter else (401, words)
        if scope["type"] == "websocket" or method in SAFE_METHODS or session.is_program:
            return _check_length(path, headers, session)
        if path not in (*FORM_PATHS, SIGN_OUT_PATH) and not shows_word:
            return 403, f"a changing request needs the header {CSRF_HEADER} with the word that GET /api/me tells"
        return _check_length(path, headers, session)

    async def _refuse(
        self, scope: Scope, receive: Receive, send: Send, status: int, words: str, *, session: Session | None
    ) -> None:
        self.refused.count(words if status != 421 else "this robot is asked for by another name")
        if scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": 4000 + status})
            return
        path: str = scope["path"]
        is_page = path not in SCRIPT_PATHS and not path.startswith(("/api/", "/openapi", SOCKET_PATH))
        if status == 401 and scope["method"] in SAFE_METHODS and is_page:
            view = f"{path}?{query}" if (query := scope["query_string"].decode("latin-1")) else path
            where = f"/login?next={quote(view)}" if view != "/" else "/login"
            await self._answer(send, 303, b"", [(b"location", where.encode())])
            return
        if is_page and wants_page(scope):
            ways = self._ways(scope) if status == 421 else ()
            body = refusal_page(scope, words, session=session, comes_back=status in PASSING, ways=ways)
            await self._answer(send, status, body, [(b"content-type", HTML)])
            return
        body = json.dumps({"error": words}).encode()
        extra = [(b"www-authenticate", b"Bearer")] if status == 401 else []
        await self._answer(send, status, body, [(b"content-type", b"application/json"), *extra])

    def _with_headers(self, send: Send, path: str, nonce: str) -> Send:
        async def with_headers(message: MutableMapping[str, object]) -> None:
            if message["type"] == "http.response.start":
                headers = list(message.get("headers", ()))  # type: ignore[call-overload]
                headers.extend((*self._headers, (POLICY, page_policy(nonce))))
                if path.startswith("/api/") or ("/_nicegui/" not in path and "/web/" not in path):
                    headers = [pair for pair in headers if pair[0].lower() != b"cache-control"]
                    headers.append((b"cache-control", b"no-store"))
                elif "/_nicegui/" not in path:
                    # Their addresses are those of every version: after an update a browser must not go on with what it
                    # has kept. It asks each time, and is mostly told that nothing has changed.
                    headers.append((b"cache-control", b"no-cache"))
                message["headers"] = headers
            await send(message)

        return with_headers

    async def _answer(self, send: Send, status: int, body: bytes, headers: list[tuple[bytes, bytes]]) -> None:
        length = (b"content-length", str(len(body)).encode())
        policy = (POLICY, page_policy(new_nonce()))
        head = [*headers, policy, *self._headers, length, (b"cache-control", b"no-store")]
        await send({"type": "http.response.start", "status": status, "headers": head})
        await send({"type": "http.response.body", "body": body})


def _as_seen(scope: Scope, headers: Headers) -> bytes:
    """Under which address a request has come."""
    return json.dumps(
        {
            "address": f"{scope['scheme']}://{headers.get('host', '')}",
            "proxy": scope.get("state", {}).get(UNTRUSTED, ""),
        }
    ).encode()


def _headers_of(scope: Scope) -> Headers:
    return {name.decode("latin-1").lower(): value.decode("latin-1") for name, value in scope["headers"]}


def _is_address(host: str) -> bool:
    try:
        ip_address(host)
    except ValueError:
        return False
    return True


def _cookie_in(header: str, name: str) -> str:
    try:
        morsel = SimpleCookie(header).get(name)
    except CookieError:
        return ""
    return "" if morsel is None else morsel.value


def _is_own_origin(headers: Headers) -> bool:
    """Whether a changing request comes from our own page. A client that names no origin is no browser, with no cookie
    to steal."""
    origin = headers.get("origin")
    if origin is None:
        return headers.get("sec-fetch-site", "same-origin") in ("same-origin", "none")
    try:
        place = urlsplit(origin).netloc
    except ValueError:  # an unmatched bracket
        return False
    return place.casefold() == headers.get("host", "").casefold()


def _most_of(path: str, session: Session | None) -> int:
    """Only who may restore a backup, or update a card, can send one, by the API or from the page."""
    is_upload = path in ("/api/restore", "/api/card/update") or (path.startswith(UPLOAD_PATH) and "/upload/" in path)
    may_restore = session is not None and session.may(Right.ADMINISTER)
    return MAX_RESTORE if is_upload and may_restore else MAX_BODY


def _check_length(path: str, headers: Headers, session: Session | None) -> tuple[int, str] | None:
    if path == STOP_PATH and session is not None:
        return None
    length = headers.get("content-length", "0")
    if not length.isascii() or not length.isdigit() or len(length) > LONGEST_NUMBER:
        return 400, "the header content-length is not a number"
    if int(length) > _most_of(path, session):
        return _too_long(_most_of(path, session))
    return None


def _too_long(most: int) -> tuple[int, str]:
    return 413, f"at most {most} bytes can be sent here"


def is_client_gone(scope: Scope, error: Exception) -> bool:
    """Whether this error only means that the visitor left before the answer, as browsers often do, or sent too much.

    Starlette treats that as a fault of the application.
    """
    is_about_that = isinstance(error, ClientDisconnect) or str(error) == "No response returned."
    return bool(scope.get("state", {}).get("left")) and is_about_that


def _limited(scope: Scope, receive: Receive, most: int) -> Receive:
    """Count the octets that really come, because a chunked body has no length in its header. Notes when the visitor
    leaves."""
    left = most

    async def limited() -> Message:
        nonlocal left
        message = await receive()
        if message["type"] == "http.disconnect":
            scope["state"]["left"] = True
        left -= len(message.get("body", b""))
        if left < 0:
            scope["state"][TOO_LONG] = scope["state"]["left"] = True
            return {"type": "http.disconnect"}
        return message

    return limited
