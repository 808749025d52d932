"""The page's calls and forms from outside, as HTTP carries them: bodies, names in paths, headers, cookies."""

from __future__ import annotations

import asyncio
import json
import re
import tempfile
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from random import Random
from typing import Any
from urllib.parse import unquote

from fastapi import FastAPI
from starlette.types import ASGIApp, Message

from fuzz.case import Case, Step, Violation, plain
from fuzz.mutate import mutate_octets
from msbot.config import SAMPLE_ROBOT_TOML
from msbot.operations.rights import Role
from msbot_web.access.access_middleware import AccessMiddleware, cookie_names
from msbot_web.access.sign_in_pages import make_forms
from msbot_web.api.admin_routes import make_admin_api, make_metrics
from msbot_web.api.exception_handlers import add_exception_handlers
from msbot_web.api.routes import make_api
from msbot_web.api.stop_route import make_stop_api
from msbot_web.service import Service
from tests.web.rig import Rig, show

COOKIES = cookie_names("12345678")
HOST = "127.0.0.1:8080"
ROLES = (Role.STUDENT, Role.TEACHER, Role.ADMINISTRATOR)
LEFT_OUT = ("/api/doctor", "/api/backup", "/api/restore", "/api/robots")
"""What looks at the computer or starts processes: nothing for thousands of times. `restore` has a target of its own."""
FORMS = ("/login", "/setup", "/join", "/pass", "/come", "/logout")
HEADERS = (
    b"cookie: msbot_session_12345678=abc; msbot_device_12345678=\"\\344\"", b"cookie: msbot_device_12345678=\xe4",
    b"origin: http://127.0.0.1:8080", b"origin: http://[", b"host: [::1", b"host: 127.0.0.1:99999",
    b"content-length: 12", b"content-length: " + b"9" * 5000, b"authorization: Bearer msbot_\xff",
    b"accept-language: de;q=0.5,\xe4;q=x", b"x-csrf-token: \xe4", b"sec-fetch-site: none",
    b"content-type: application/json; charset=utf-16", b"content-type: multipart/form-data; boundary=x",
    b"cookie: \"=\\999;;=;a=\"",
)  # fmt: skip
VALUES = (
    '"\\ud800"', '"\\u0000"', '"ada"', '"AA"', '"BB"', '"ABCD"', '"teacher"', '"\\u001b[31m"', '"' + "x" * 300 + '"',
    '""', "null", "true", "0", "-1", "1", "1.5", "1e308", "1e999", "NaN", "9" * 5000, "9" * 30, "[]", '["AA"]',
    '["\\udfff"]', "{}", "[" * 3000, '"AA.out -> BB.in"', '"period_s"', '"HelloWorld"', '"S\u0130"',
    '"correct horse"', '{"a": {"b": [1e400]}}',
)  # fmt: skip
NAMES = (
    "AA", "BB", "ABCD", "ada", "teacher", "a.py", "%00", "%ff", "%ED%A0%80", "%F0%9F%A4%96", "..", "x" * 300,
    "%1B%5B31m", "plugged", "turn", "1", "-1",
)  # fmt: skip


class PageTarget:
    """See the module's docstring."""

    name = "page"
    about = "the page's calls, forms and headers: answered, and never with a failure"

    def make(self, random: Random) -> Case:
        """Some requests of one visitor after another."""
        return tuple(_step(random) for _ in range(random.choice((40, 150))))

    def run(self, case: Case) -> Iterable[str]:
        """Ask; in the end the robot and its registry are well."""
        seen: set[str] = set()
        errors: list[BaseException] = []

        async def scene(rig: Rig) -> None:
            asyncio.get_running_loop().set_exception_handler(
                lambda _, context: errors.append(context.get("exception") or Violation(str(context["message"])))
            )
            site = _Site(rig)
            for step in case:
                seen.update(await site.ask(step))
            await asyncio.sleep(5.0)
            site = _Site(rig, site.calls)  # somebody may have been signed out
            status, body = await site.request("GET", "/api/edits?limit=1000", {}, b"", Role.ADMINISTRATOR)
            if status != 200:
                raise Violation(f"then, a plain question is answered with {status}: {body!r:.200}")
            stopping = rig.stage.operations.stopping.status
            if stopping.trouble or not stopping.is_stored:
                raise Violation(f"then, STOP is not stored: {stopping.trouble}")

        with tempfile.TemporaryDirectory(prefix="msbot-fuzz-") as folder:
            show(Path(folder), scene)
        if errors:
            raise errors[0]
        return seen


class _Site:
    """The page of a robot, without a socket."""

    def __init__(self, rig: Rig, calls: FastAPI | None = None) -> None:
        self.rig = rig
        self.calls = calls or make_app(rig.service)
        """Making it takes longer than forty requests."""
        self.sessions = {role: rig.session(role) for role in ROLES}
        self.app: ASGIApp = AccessMiddleware(
            self.calls,
            rig.accounts,
            ("127.0.0.1", "::1"),
            cookies=COOKIES,
            owns=lambda *_: False,
            beat=lambda: b"{}",
        )

    async def ask(self, step: Step) -> Iterable[str]:
        """One request; returns what was seen."""
        kind, _, rest = step.verb.partition(" ")
        method, _, path = rest.partition(" ")
        role = None if kind == "form" else ROLES[step.whole(0) % len(ROLES)]
        headers: dict[bytes, bytes] = {b"content-type": b"application/json"}
        body = step.data
        if kind == "form":
            headers[b"content-type"] = b"application/x-www-form-urlencoded"
        if kind == "head":
            body = b""
            for line in step.data.split(b"\n")[:8]:
                name, _, value = line.partition(b":")
                headers[name.strip().lower()] = value.strip()
        status, answer = await self.request(method, path, headers, body, role)
        shown = re.sub(r"[^/a-z].*", "", path)
        if status >= 500:
            raise Violation(f"{method} {shown}: {status}, {answer!r:.200}")
        words = answer.decode("utf-8")
        if status >= 400 and words.startswith('{"error"'):
            words = json.loads(words)["error"]
            if not words.strip():
                raise Violation(f"{method} {shown} is refused without a word")
        return (f"{method} {shown} {status}", plain(words, 24))

    async def request(
        self, method: str, path: str, headers: Mapping[bytes, bytes], body: bytes, role: Role | None
    ) -> tuple[int, bytes]:
        """Ask as a server does that has read the request."""
        sent: dict[bytes, bytes] = {b"host": HOST.encode()}
        if role is not None:
            session = self.sessions[role]
            sent[b"cookie"] = f"{COOKIES.session}={session.token}".encode()
            sent[b"x-csrf-token"] = session.csrf.encode()
        raw, _, query = path.partition("?")
        pieces: list[Message] = [
            {"type": "http.request", "body": body, "more_body": False},
            {"type": "http.disconnect"},
        ]
        answer: list[Message] = []

        async def receive() -> Message:
            return pieces.pop(0) if len(pieces) > 1 else pieces[0]

        async def send(message: Message) -> None:
            answer.append(message)

        scope: dict[str, Any] = {
            "type": "http",
            "asgi": {"version": "3.0"},
            "http_version": "1.1",
            "method": method,
            "scheme": "http",
            "path": unquote(raw),
            "raw_path": raw.encode(),
            "query_string": query.encode(),
            "root_path": "",
            "headers": list({**sent, **headers}.items()),
            "client": ("127.0.0.1", 5),
            "server": ("127.0.0.1", 8080),
            "state": {},
        }
        await self.app(scope, receive, send)
        octets = b"".join(message.get("body", b"") for message in answer)
        return answer[0]["status"], octets


def make_app(service: Service) -> FastAPI:
    """What `WebServer` serves, but for the pages themselves."""
    app = FastAPI()
    app.include_router(make_forms(service.accounts, service.robot_name, COOKIES, service.pupils.passes))
    app.include_router(make_stop_api(service))
    app.include_router(make_api(service))
    app.include_router(make_admin_api(service))
    app.include_router(make_metrics(service))
    add_exception_handlers(app)
    return app


@cache
def _calls() -> tuple[tuple[str, str, tuple[str, ...]], ...]:
    """Method, path and the names in the body of every call."""
    found: list[tuple[str, str, tuple[str, ...]]] = []
    with tempfile.TemporaryDirectory(prefix="msbot-fuzz-") as folder:

        async def scene(rig: Rig) -> None:
            schema = make_app(rig.service).openapi()
            for path, methods in schema["paths"].items():
                for method, told in methods.items():
                    if path not in LEFT_OUT:
                        found.append((method.upper(), path, tuple(_fields(schema, told))))

        show(Path(folder), scene, parts=())
    return tuple(sorted(found))


def _fields(schema: Mapping[str, Any], told: Mapping[str, Any]) -> Iterable[str]:
    text = json.dumps(told.get("requestBody", {}))
    for name in re.findall(r"#/components/schemas/(\w+)", text):
        yield from schema["components"]["schemas"][name].get("properties", {})


def _step(random: Random) -> Step:
    kind = random.random()
    who = (random.choice((0, 1, 1, 2, 2)),)
    if kind < 0.15:
        lines = [mutate_octets(random, one) if random.random() < 0.3 else one for one in random.sample(HEADERS, 2)]
        return Step(
            f"head {random.choice(('GET', 'POST'))} {random.choice((*FORMS, '/api/me', '/metrics'))}",
            b"\n".join(line.replace(b"\n", b"") for line in lines),
            who,
        )
    if kind < 0.3:
        body = b"name=ada&password=correct+horse&next=/x&token=a&again=b&ticket=YWRh.ffffffff.x&word=YQ.1.x"
        return Step(
            f"form POST {random.choice(FORMS)}", mutate_octets(random, body, (b"%ED%A0%80", b"%ff", b"&", b"=")), who
        )
    method, path, fields = random.choice(_calls())
    path = re.sub(r"{\w+}", lambda _: random.choice(NAMES), path)
    if random.random() < 0.1:
        path += random.choice(
            ("?limit=1", "?limit=%ff", "?part=%00", "?number=9", "?field=message", "?search=%ED%A0%80")
        )
    parts = [f'"{name}": {_value(random, name)}' for name in fields if random.random() < 0.9]
    body = ("{" + ", ".join(parts) + "}").encode()
    if random.random() < 0.15:
        body = mutate_octets(random, body, (b"\xff", b'"\\ud800"', b"[" * 3000))
    return Step(f"call {method} {path}", body, who)


def _value(random: Random, name: str) -> str:
    if name == "toml" and random.random() < 0.5:
        return json.dumps(SAMPLE_ROBOT_TOML.replace("AA", random.choice(("AA", "\ud800", "\x1b"))))
    return random.choice(VALUES)
