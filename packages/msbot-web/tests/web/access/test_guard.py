"""The gate in front of pages and API: attempted attacks, each refused, and what honest people may do."""

from __future__ import annotations

import json
from collections.abc import Awaitable, Callable, Mapping
from typing import cast

import nicegui
import pytest
from starlette.requests import Request
from starlette.types import Message, Receive, Scope, Send

from msbot.operations.rights import Role
from msbot_web.access.access_middleware import ANY_ADDRESS, CSRF_HEADER, MAX_BODY, AccessMiddleware, cookie_names
from msbot_web.access.accounts import Accounts
from msbot_web.access.sessions import Session
from msbot_web.access.users import MemoryUsers
from tests.web.access.test_accounts import Clock, PlainHasher, user

COOKIES = cookie_names("12345678")
COOKIE = COOKIES.session
HOST = "127.0.0.1:8080"


async def inner(scope: Scope, receive: Receive, send: Send) -> None:
    """The application behind the gate: says who came through, and reads what was sent."""
    if scope["type"] == "websocket":
        await send({"type": "websocket.accept"})
        return
    octets, more = 0, True
    while more and scope["method"] == "POST":
        message = await receive()
        if message["type"] == "http.disconnect":
            break
        octets += len(message.get("body", b""))
        more = message.get("more_body", False)
    session = scope["state"]["session"]
    body = json.dumps({"who": session.name if session else None, "octets": octets}).encode()
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": body})


class Answer:
    def __init__(self) -> None:
        self.messages: list[Message] = []

    @property
    def status(self) -> int:
        return cast("int", self.messages[0]["status"])

    @property
    def headers(self) -> dict[str, str]:
        return {name.decode(): value.decode() for name, value in self.messages[0]["headers"]}

    @property
    def json(self) -> dict[str, object]:
        return cast("dict[str, object]", json.loads(self.messages[1]["body"]))


class Rig:
    def __init__(self, *, hosts: tuple[str, ...] = ("127.0.0.1", "localhost"), is_tls: bool = False) -> None:
        self.accounts = Accounts(
            MemoryUsers(user("ada"), user("bob", Role.STUDENT, "also correct")), clock=Clock(), hasher=PlainHasher()
        )
        self.pages: dict[str, Session] = {}
        self.guard = AccessMiddleware(
            inner,
            self.accounts,
            hosts,
            cookies=COOKIES,
            owns=lambda page, session: self.pages.get(page) is session,
            beat=lambda: b"{}",
            is_tls=is_tls,
        )

    def session(self) -> Session:
        return self.accounts.sessions.begin("bob", Role.STUDENT)

    async def ask(
        self,
        path: str,
        method: str = "GET",
        *,
        kind: str = "http",
        session: Session | None = None,
        bodies: tuple[bytes, ...] = (b"",),
        more: Mapping[str, str] | None = None,
        **headers: str,
    ) -> Answer:
        given = {"host": HOST, **{name.replace("_", "-"): value for name, value in headers.items()}, **(more or {})}
        if session is not None:
            given["cookie"] = f"{COOKIE}={session.token}"
        scope: Scope = {
            "type": kind,
            "path": path.partition("?")[0],
            "query_string": path.partition("?")[2].encode(),
            "headers": [(name.encode(), value.encode()) for name, value in given.items()],
            "scheme": "http",
            "server": ("127.0.0.1", 8080),
            "client": ("127.0.0.1", 50_000),
        }
        if kind == "http":
            scope["method"] = method
        chunks = list(bodies)
        answer = Answer()

        async def receive() -> Message:
            if kind == "websocket":
                return {"type": "websocket.connect"}
            return {"type": "http.request", "body": chunks.pop(0), "more_body": bool(chunks)}

        async def send(message: Message) -> None:
            answer.messages.append(message)

        run = cast("Callable[[Scope, Receive, Send], Awaitable[None]]", self.guard)
        await run(scope, receive, send)
        return answer


@pytest.mark.parametrize(
    "path", ["/api/robot", "/api/me", "/api/backup", "/api/health/../me", "/api", "/api/", "/API/me", "/openapi.jsonx"]
)
async def test_without_a_session_nothing_is_answered(path: str) -> None:
    answer = await Rig().ask(path)
    if path.startswith("/api/"):
        assert answer.status == 401
        assert answer.json == {"error": "sign in first"}
    else:
        assert answer.status in (303, 401)


async def test_without_a_session_a_page_leads_to_the_sign_in_and_back() -> None:
    answer = await Rig().ask("/bus")
    assert (answer.status, answer.headers["location"]) == (303, "/login?next=/bus")
    answer = await Rig().ask("/?slot=BB&x=//evil")
    assert (answer.status, answer.headers["location"]) == (303, "/login?next=/%3Fslot%3DBB%26x%3D//evil")


@pytest.mark.parametrize(
    "path", ["/api/health", "/login", "/setup", "/enter", "/web/form.css", f"/_nicegui/{nicegui.__version__}/x.js"]
)
async def test_what_everybody_may_have(path: str) -> None:
    answer = await Rig().ask(path)
    assert answer.status == 200
    assert answer.json["who"] is None


async def test_a_session_is_let_through_with_its_name() -> None:
    rig = Rig()
    answer = await rig.ask("/api/robot", session=rig.session())
    assert (answer.status, answer.json["who"]) == (200, "bob")


async def test_a_made_up_cookie_is_nobody() -> None:
    answer = await Rig().ask("/api/robot", cookie=f"{COOKIE}=made-up")
    assert answer.status == 401
    assert (await Rig().ask("/api/robot", cookie='"; =,\\')).status == 401


async def test_an_api_token_is_let_through_and_a_forged_one_is_not() -> None:
    rig = Rig()
    token = await rig.accounts.new_token("bob", "logger", who="ada")
    assert (await rig.ask("/api/robot", authorization=f"Bearer {token}")).status == 200
    assert (await rig.ask("/api/stop", "POST", authorization=f"Bearer {token}")).status == 200
    for forged in (f"Bearer {token}x", "Bearer ", f"Basic {token}", token):
        answer = await rig.ask("/api/robot", authorization=forged)
        assert answer.status == 401
        assert answer.headers["www-authenticate"] == "Bearer"


async def test_a_token_is_no_way_to_the_pages() -> None:
    rig = Rig()
    token = await rig.accounts.new_token("bob", "logger", who="ada")
    assert (await rig.ask("/", authorization=f"Bearer {token}")).status == 303


async def test_a_changing_request_needs_the_csrf_word_of_its_own_session() -> None:
    rig = Rig()
    session, other = rig.session(), rig.session()
    assert (await rig.ask("/api/stop", "POST", session=session)).status == 403
    assert (await rig.ask("/api/stop", "POST", session=session, more={CSRF_HEADER: other.csrf})).status == 403
    assert (await rig.ask("/api/stop", "POST", session=session, more={CSRF_HEADER: session.csrf})).status == 200
    for method in ("PUT", "PATCH", "DELETE", "FOO"):
        assert (await rig.ask("/api/stop", method, session=session)).status == 403


async def test_a_form_of_another_site_is_refused() -> None:
    rig = Rig()
    session = rig.session()
    word = {CSRF_HEADER: session.csrf}
    for origin in ("http://evil.example", "null", "http://127.0.0.1:9999", "https://127.0.0.1.evil.example:8080"):
        answer = await rig.ask("/api/go", "POST", session=session, origin=origin, more=word)
        assert answer.status == 403
        assert (await rig.ask("/api/stop", "POST", session=session, origin=origin)).status == 403
    assert (await rig.ask("/login", "POST", origin="http://evil.example")).status == 403
    assert (await rig.ask("/logout", "POST", session=session, sec_fetch_site="cross-site")).status == 403
    assert (await rig.ask("/api/stop", "POST", session=session, origin=f"http://{HOST}", more=word)).status == 200
    assert (await rig.ask("/logout", "POST", session=session, origin=f"http://{HOST}")).status == 200
    # A proxy that changes the address makes our own page look like another site: its word shows that STOP is meant.
    assert (await rig.ask("/api/stop", "POST", session=session, origin="https://robot.school", more=word)).status == 200


async def test_another_host_name_is_refused() -> None:
    rig = Rig()
    for host in ("evil.example:8080", "", "127.0.0.1.evil.example"):
        assert (await rig.ask("/login", host=host)).status == 421
    assert (await rig.ask("/login", host="LOCALHOST:8080")).status == 200


async def test_websockets_need_a_session_and_the_own_origin() -> None:
    rig = Rig()
    session = rig.session()
    socket = "/_nicegui_ws/socket.io/"
    refused = await rig.ask(socket, kind="websocket")
    assert refused.messages == [{"type": "websocket.close", "code": 4401}]
    stolen = await rig.ask(socket, kind="websocket", session=session, origin="http://evil.example")
    assert stolen.messages == [{"type": "websocket.close", "code": 4403}]
    assert (await rig.ask(socket, kind="websocket", session=session, origin=f"http://{HOST}")).messages == [
        {"type": "websocket.accept"}
    ]


async def test_bodies_are_bounded_whether_or_not_they_say_their_length() -> None:
    rig = Rig()
    session = rig.session()
    word = {CSRF_HEADER: session.csrf}
    said = await rig.ask("/api/go", "POST", session=session, content_length=str(MAX_BODY + 1), more=word)
    assert said.status == 413
    nonsense = await rig.ask("/api/go", "POST", session=session, content_length="many", more=word)
    assert nonsense.status == 400
    chunks = (b"x" * (MAX_BODY // 2),) * 5
    unsaid = await rig.ask("/api/go", "POST", session=session, bodies=chunks, more=word)
    assert (unsaid.status, unsaid.json) == (413, {"error": f"at most {MAX_BODY} bytes can be sent here"})
    assert len(unsaid.messages) == 2, "and nothing of what the application makes of it"
    for length in (str(MAX_BODY + 1), "many"):
        stop = await rig.ask("/api/stop", "POST", session=session, content_length=length, more=word)
        assert stop.status == 200, "STOP reads as much as it needs"
    ada = rig.accounts.sessions.begin("ada", Role.ADMINISTRATOR)
    for path in ("/api/restore", "/_nicegui/client/1/upload/2"):  # by the API, and from the page
        rig.pages = {"1": ada}
        backup = await rig.ask(path, "POST", session=ada, bodies=chunks, more={CSRF_HEADER: ada.csrf})
        assert backup.json["octets"] == 5 * (MAX_BODY // 2)
        rig.pages = {"1": session}
        student = await rig.ask(path, "POST", session=session, bodies=chunks, more=word)
        assert student.status == 413


async def test_who_sends_too_much_or_leaves_while_a_form_is_read_writes_no_traceback() -> None:
    async def form(scope: Scope, receive: Receive, send: Send) -> None:
        await Request(scope, receive).body()
        await send({"type": "http.response.start", "status": 200, "headers": []})

    async def failing(scope: Scope, receive: Receive, _send: Send) -> None:
        await receive()
        raise RuntimeError("a mistake of ours")

    rig = Rig()
    rig.guard._app = form
    long = await rig.ask("/login", "POST", bodies=(b"x" * MAX_BODY, b"x"))
    assert long.messages == []
    rig.guard._app = failing
    with pytest.raises(RuntimeError, match="of ours"):
        await rig.ask("/login", "POST", bodies=(b"x",))


async def test_a_stranger_sends_nothing_but_the_forms_to_sign_in() -> None:
    rig = Rig()
    for path in ("/_nicegui/client/1/upload/2", "/web/form.css", "/enter", "/api/health", "/openapi.json"):
        assert (await rig.ask(path, "POST")).status == 401
    for path in ("/login", "/setup"):
        assert (await rig.ask(path, "POST")).status == 200
        assert (await rig.ask(path, "POST", content_length=str(MAX_BODY + 1))).status == 413


async def test_an_upload_belongs_to_who_opened_the_page() -> None:
    rig = Rig()
    ada, bob = rig.accounts.sessions.begin("ada", Role.ADMINISTRATOR), rig.session()
    rig.pages = {"1": ada}
    path = "/_nicegui/client/1/upload/2"
    assert (await rig.ask(path, "POST", session=ada, more={CSRF_HEADER: ada.csrf})).status == 200
    refused = await rig.ask(path, "POST", session=bob, more={CSRF_HEADER: bob.csrf})
    assert (refused.status, refused.json) == (403, {"error": "this page was opened by somebody else"})


async def test_long_polling_is_for_the_own_page_only() -> None:
    rig = Rig()
    session, other = rig.session(), rig.session()
    path = "/_nicegui_ws/socket.io?transport=polling"
    assert (await rig.ask(path)).status == 401
    assert (await rig.ask(path, session=session)).status == 200
    # Pages of other ports of the same host have the cookie sent, and socket.io would let them read the answer.
    for origin in ("http://127.0.0.1:9999", "http://evil.example", "null"):
        assert (await rig.ask(path, session=session, origin=origin)).status == 403
        assert (await rig.ask(path, "POST", session=session, origin=origin)).status == 403
    assert (await rig.ask(path, session=session, sec_fetch_site="same-site")).status == 403
    assert (await rig.ask(path, "POST", session=session, more={CSRF_HEADER: other.csrf})).status == 403
    assert (await rig.ask(path, "POST", session=session, more={CSRF_HEADER: session.csrf})).status == 200


async def test_what_only_scripts_ask_for_is_no_way_to_the_form() -> None:
    rig = Rig()
    for path in ("/turn", "/seen", "/beat"):
        assert (await rig.ask(path)).status == 401
    seen = await rig.ask("/seen", session=rig.session())
    assert seen.json == {"address": f"http://{HOST}", "proxy": ""}


async def test_a_refusal_is_a_page_with_stop_for_who_may_press_it() -> None:
    rig = Rig()
    html = "text/html,application/xhtml+xml"
    named = await rig.ask("/", host="robot.school", accept=html)
    assert named.status == 421
    body = named.messages[1]["body"].decode()
    assert "robot.school" in body
    assert 'id="ms-stop"' not in body, "nobody knows who asks"
    assert "/web/refused.js" in body, "it comes back when the robot is started with that name"
    assert f'href="http://{HOST}/"' in body, "a way that works meanwhile"
    assert "msbot stop" in body
    session = rig.session()
    foreign = await rig.ask("/x", "POST", session=session, accept=html, origin="http://evil.example")
    assert foreign.status == 403
    body = foreign.messages[1]["body"].decode()
    assert 'id="ms-stop"' in body
    assert session.csrf in body
    assert (await rig.ask("/web/page.js", host="robot.school")).status == 200, "what such a page needs"


async def test_asking_whether_the_robot_is_there_keeps_no_session_alive() -> None:
    rig = Rig()
    session = rig.session()
    cast("Clock", rig.accounts._clock).now = 10.0
    assert (await rig.ask("/beat", session=session)).status == 200
    assert session.used_at == 0.0
    rig.accounts.sign_out(session)
    assert (await rig.ask("/beat", session=session)).status == 401
    assert (await rig.ask("/beat")).status == 401


async def test_strangers_get_nothing_of_nicegui_but_its_own_files() -> None:
    rig = Rig()
    assert (await rig.ask("/_nicegui/auto/static/abc/backup.db")).status == 303
    assert (await rig.ask("/_nicegui/nothing")).status == 303


@pytest.mark.parametrize(
    ("host", "status"),
    [
        ("192.168.1.7:8080", 401),
        ("[fe80::1]:8080", 401),
        ("robot.local", 401),
        ("ROBOT.local:8080", 401),
        ("evil.example", 421),
        ("", 421),
        ("192.168.1.7.evil.example", 421),
        ("[", 421),
    ],
)
async def test_on_all_networks_addresses_and_own_names_are_answered_to(host: str, status: int) -> None:
    rig = Rig(hosts=(ANY_ADDRESS, "robot.local"))
    assert (await rig.ask("/api/robot", more={"host": host})).status == status


async def test_with_tls_browsers_are_told_to_stay_with_it() -> None:
    name = "strict-transport-security"
    assert (await Rig(is_tls=True).ask("/api/robot")).headers[name] == "max-age=86400"
    assert name not in (await Rig().ask("/api/robot")).headers


async def test_a_form_with_a_hidden_origin_is_refused() -> None:
    answer = await Rig().ask("/login", "POST", origin="null")
    assert answer.status == 403


async def test_answers_may_not_be_framed_sniffed_or_kept() -> None:
    rig = Rig()
    for answer in (await rig.ask("/api/robot"), await rig.ask("/api/robot", session=rig.session())):
        assert answer.headers["x-frame-options"] == "DENY"
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert (
            answer.headers["referrer-policy"] == "same-origin"
        )  # no-referrer would make browsers hide a form's origin
        assert answer.headers["cache-control"] == "no-store"
        assert "default-src 'self'" in answer.headers["content-security-policy"]


async def test_what_was_refused_is_counted_by_reason() -> None:
    rig = Rig()
    for _ in range(3):
        await rig.ask("/api/robot")
    assert rig.guard.refused == {"sign in first": 3}


@pytest.mark.parametrize("leaves", [True, False])
async def test_a_visitor_who_goes_before_the_answer_is_no_error(leaves: bool) -> None:
    async def silent(_scope: Scope, receive: Receive, _send: Send) -> None:
        if leaves:
            assert (await receive())["type"] == "http.disconnect"
        raise RuntimeError("No response returned.")

    async def receive() -> Message:
        return {"type": "http.disconnect"}

    async def send(_message: Message) -> None:
        raise AssertionError("there is nobody to answer")

    guard = AccessMiddleware(silent, Rig().accounts, ("",), cookies=COOKIES, owns=lambda *_: False, beat=lambda: b"")
    scope = {"type": "http", "method": "GET", "path": "/login", "headers": []}
    if leaves:
        await guard(scope, receive, send)
    else:
        with pytest.raises(RuntimeError, match="No response"):
            await guard(scope, receive, send)


async def test_scripts_run_by_a_word_of_that_answer_and_never_inline() -> None:
    rig = Rig()
    words = set()
    for answer in (await rig.ask("/"), await rig.ask("/", session=rig.session()), await rig.ask("/login")):
        policy = dict(part.strip().split(" ", 1) for part in answer.headers["content-security-policy"].split(";"))
        scripts = policy["script-src"].split()
        assert "'unsafe-inline'" not in scripts
        words.add(next(word for word in scripts if word.startswith("'nonce-")))
        assert policy["connect-src"] == "'self'"
        assert policy["object-src"] == "'none'"
    assert len(words) == 3
