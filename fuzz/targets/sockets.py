"""The websockets of the page: engine.io, socket.io and NiceGUI behind our own checks, against any browsers."""

from __future__ import annotations

import asyncio
import json
import logging
import re
from collections.abc import Iterable
from random import Random
from typing import Any

from fastapi import Request
from nicegui import Client, core, ui
from nicegui.nicegui import sio_app
from nicegui.page import page as nicegui_page
from starlette.types import Message

from fuzz.case import Case, Step, Violation, plain
from fuzz.mutate import mutate_octets
from fuzz.virtual import play, the_loop
from msbot.operations.rights import Role
from msbot_web.access.accounts import Accounts
from msbot_web.access.sessions import Session
from msbot_web.access.users import MemoryUsers
from msbot_web.nicegui_internals import page_sockets
from msbot_web.nicegui_internals.open_pages import OpenPages
from msbot_web.nicegui_internals.page_sockets import MOST_WAITING, MOST_WAITING_OCTETS, Outgoing, PageSockets
from msbot_web.page_errors import limit_repeated_errors
from tests.web.access.test_accounts import Clock, PlainHasher, user

PATH = "/_nicegui_ws"
NAMES = ("ada", "eve")
HONEST = "ada"
GREETING = "implicit_handshake=true&tab_id=t{0}&document_id=d{0}&next_message_id=0&old_tab_id="
QUERIES = (
    GREETING, GREETING, GREETING, "", "implicit_handshake=true", "implicit_handshake=true&tab_id=%ff&document_id=d",
    "implicit_handshake=true&tab_id=t&document_id=d&next_message_id=" + "9" * 5000,
    "implicit_handshake=true&tab_id=t&document_id=d&next_message_id=-1",
)  # fmt: skip
VALUES = (
    '"PAGE0"', '"PAGE1"', "1", "4", "5", "6", "7", "99999", "-1", "null", "true", "[]", "{}", '""', '"x"', "1e400",
    "9" * 400, '"\\ud800"', '["1"]', '["{"]', "[null]", '[""]', '["[1, 2]"]', '["\\"a\\""]', '["1e999"]', '[["1"]]',
    "[" * 2000 + "]" * 2000, '{"a":' * 2000 + "1" + "}" * 2000, '"' + "x" * 3000 + '"', '"LISTENER4"',
    '"LISTENER5"', '"LISTENER6"', '"LISTENER7"', '"LISTENER8"',
)  # fmt: skip
FIELDS = (
    "id",
    "listener_id",
    "args",
    "tab_id",
    "document_id",
    "next_message_id",
    "old_tab_id",
    "request_id",
    "result",
    "level",
    "message",
)
EVENTS = (
    "event",
    "event",
    "event",
    "handshake",
    "ack",
    "log",
    "javascript_response",
    "left",
    "connect",
    "disconnect",
    "nothing",
    "*",
)
RAW = (
    b"2", b"3", b"40", b"41", b"5", b"6", b"1", b"0", b"9", b"", b"b", b"bAAAA", b"b@", b"4", b"42", b"42[", b"42[]",
    b"42{}", b"42[1]", b'42["event"]', b'42["event",1,2]', b'42[["event"]]', b'42[{"a":1}]', b"40/foo,", b'40{"a":1}',
    b"40[", b"430[]", b"43" + b"1" * 300 + b"[]", b'451-["event",{"_placeholder":true,"num":0}]', b"44{}",
    b'459999999-["event"]', b'4510-["event",{"_placeholder":true,"num":0}]', b'421["event",{}]', b"47", b"2probe",
    b"\xff\xfe", b"4" + b"[" * 5000, b'42["connect",{"asgi.scope":{"state":{}}}]', b'42["disconnect",1,2,3]',
)  # fmt: skip


class SocketTarget:
    """See the module's docstring."""

    name = "sockets"
    about = "the page's websockets: any browsers; what is nonsense goes no further, an honest one works all the time"

    def make(self, random: Random) -> Case:
        """Browsers that come, say things, do not read, and go."""
        steps = [Step("open", GREETING.encode(), (1, 1, 1))]
        steps += [_step(random) for _ in range(random.choice((10, 60)))]
        return tuple(steps)

    def run(self, case: Case) -> Iterable[str]:
        """Play it beside an honest visitor, who clicks in the end."""
        handlers = dict(core.sio.handlers["/"]), dict(core.sio.eio.handlers)
        loggers = [logging.getLogger(name) for name in ("nicegui", "socketio.server", "engineio.server")]
        reader = _Tracebacks()
        before = [(logger.handlers[:], logger.filters[:], logger.propagate) for logger in loggers]
        for logger in loggers:
            logger.handlers[:], logger.filters[:], logger.propagate = [reader], [], False
        limit_repeated_errors()
        page_sockets.COMPLAINTS.counts.clear()
        was_loop, core.sio.eio.start_service_task = core.loop, False
        try:
            play(_scene(case, reader.told))
        finally:
            core.sio.handlers["/"].clear()
            core.sio.handlers["/"].update(handlers[0])
            core.sio.eio.handlers.clear()
            core.sio.eio.handlers.update(handlers[1])
            core.sio.eio.sockets.clear()
            core.sio.environ.clear()
            core.sio.manager.rooms.clear()
            core.sio.manager.eio_to_sid.clear()
            Client.instances.clear()
            core.loop = was_loop
            for logger, (found, filters, propagate) in zip(loggers, before, strict=True):
                logger.handlers[:], logger.filters[:], logger.propagate = found, filters, propagate
        return {*page_sockets.COMPLAINTS.counts, *reader.told}


class _Tracebacks(logging.Handler):
    """What is written to the log: a traceback that is not of a page's own function is a finding."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.told: set[str] = set()

    def emit(self, record: logging.LogRecord) -> None:
        error = record.exc_info[1] if record.exc_info else record.msg
        if isinstance(error, BaseException):
            if record.name != "nicegui":
                raise Violation(f"a traceback in the log of {record.name}") from error
            place = f"a page's function: {type(error).__name__}"
            if place in self.told:
                return
            self.told.add(place)
        self.told.add(plain(record.getMessage(), 40))


class _Browser:
    """One end of a websocket, whoever is behind it."""

    def __init__(self, app: PageSockets, session: Session | None, query: str) -> None:
        self.heard: list[str] = []
        self._inbox: asyncio.Queue[Message] = asyncio.Queue()
        self._inbox.put_nowait({"type": "websocket.connect"})
        self.reads = asyncio.Event()
        self.reads.set()
        scope: dict[str, Any] = {
            "type": "websocket",
            "path": f"{PATH}/socket.io/",
            "root_path": PATH,
            "headers": [(b"connection", b"Upgrade"), (b"upgrade", b"websocket")],
            "query_string": f"EIO=4&transport=websocket&{query}".encode(),
            "state": {"session": session},
        }
        self.task = asyncio.get_running_loop().create_task(app(scope, self._inbox.get, self._hear))

    async def _hear(self, message: Message) -> None:
        if message["type"] == "websocket.send":
            await self.reads.wait()
            self.heard.append(str(message.get("text")))

    def say(self, octets: bytes) -> None:
        """A text message, or what is no text as a binary one."""
        try:
            self._inbox.put_nowait({"type": "websocket.receive", "text": octets.decode()})
        except UnicodeDecodeError:
            self._inbox.put_nowait({"type": "websocket.receive", "bytes": octets})

    def close(self) -> None:
        """It is gone."""
        self._inbox.put_nowait({"type": "websocket.disconnect", "code": 1001})


class _Page:
    """A page of somebody, with what pages have."""

    def __init__(self, session: Session) -> None:
        request = Request({"type": "http", "headers": [], "path": "/", "state": {"session": session}})
        self.client = Client(nicegui_page("/", reconnect_timeout=3.0), request=request)
        self.clicks = 0
        first = self.client.next_element_id
        with self.client:
            self.button = ui.button("press", on_click=self._click)
            ui.input("name", on_change=lambda event: len(event.value))
            ui.slider(min=0, max=9, on_change=lambda event: event.value)
            ui.select(["a", "b"], on_change=lambda event: event.value)
            ui.switch("on")
            self.label = ui.label("x")
        self.listeners = {number: _listener(one) for number, one in self.client.elements.items() if number >= first}

    def _click(self) -> None:
        self.clicks += 1
        self.label.set_text(f"pressed {self.clicks}")


def _listener(element: ui.element) -> str:
    """What a browser names when something happens there."""
    return next(iter(element._event_listeners), "")


async def _scene(case: Case, seen: set[str]) -> None:
    core.loop = the_loop()
    if not core.app.config.has_run_config:  # what `ui.run_with` sets
        core.app.config.reconnect_timeout, core.app.config.message_history_length = 3.0, 1000
    accounts = Accounts(MemoryUsers(*(user(name, Role.TEACHER) for name in NAMES)), clock=Clock(), hasher=PlainHasher())
    sessions = [accounts.sessions.begin(name, Role.TEACHER) for name in NAMES]
    app = PageSockets(sio_app)
    OpenPages(accounts)
    pages = [_Page(session) for session in sessions]
    honest = await _greet(app, sessions[0], pages[0])
    browsers: list[_Browser] = []
    for step in case:
        who = step.whole(0) % len(pages)
        if step.verb == "open" and len(browsers) < 20:
            query = step.data.decode("utf-8", "replace").replace("{0}", str(len(browsers)))
            session = None if step.whole(1) == 0 else sessions[1]
            browsers.append(_Browser(app, session, f"client_id={pages[1 if who else 0].client.id}&{query}"))
            if step.whole(2):
                browsers[-1].say(b"40")
        elif step.verb == "say" and browsers:
            octets = step.data
            for number, page in enumerate(pages):
                octets = octets.replace(f"PAGE{number}".encode(), page.client.id.encode())
            for number, name in pages[1].listeners.items():
                octets = octets.replace(f"LISTENER{number}".encode(), name.encode())
            for _ in range(min(2000, max(1, step.whole(1)))):
                browsers[step.whole(0) % len(browsers)].say(octets)
        elif step.verb == "read" and browsers:
            one = browsers[step.whole(0) % len(browsers)].reads
            (one.set if step.whole(1) else one.clear)()
        elif step.verb == "close" and browsers:
            browsers[step.whole(0) % len(browsers)].close()
        elif step.verb == "work":
            for number in range(min(3000, step.whole(0))):
                pages[1].client.run_javascript(f"// {number} {'x' * min(5000, step.whole(1))}")
        await asyncio.sleep(min(20.0, abs(step.number(2))) if step.verb == "wait" else 0.001)
        _check_bounds()
        honest.say(b"3")
    seen.update(re.sub(r"[^a-z0-9].*", "", text[:20].replace('["', "")) for one in browsers for text in one.heard)
    await _then(app, sessions[0], pages[0], honest, browsers)


async def _greet(app: PageSockets, session: Session, page: _Page) -> _Browser:
    browser = _Browser(app, session, f"client_id={page.client.id}&{GREETING.format(99)}")
    browser.say(b"40")
    await asyncio.sleep(0.01)
    return browser


def _check_bounds() -> None:
    for line in core.sio.eio.sockets.values():
        if not isinstance(line.queue, Outgoing):
            raise Violation("a queue without a bound")
        if line.queue.qsize() > MOST_WAITING + 1 or line.queue.octets > MOST_WAITING_OCTETS:
            raise Violation(f"{line.queue.qsize()} packets of {line.queue.octets} octets wait for a browser")


async def _then(app: PageSockets, session: Session, page: _Page, honest: _Browser, browsers: list[_Browser]) -> None:
    if honest.task.done():
        honest = await _greet(app, session, page)  # it was silent for as long as the case waited
    clicks = page.clicks
    click = {
        "id": page.button.id,
        "client_id": page.client.id,
        "listener_id": page.listeners[page.button.id],
        "args": [],
    }
    honest.say(f"42{json.dumps(['event', click])}".encode())
    await asyncio.sleep(0.5)
    if page.clicks != clicks + 1:
        raise Violation(f"the honest visitor's click was heard {page.clicks - clicks} times")
    if not any(f"pressed {page.clicks}" in text for text in honest.heard):
        raise Violation("the honest visitor does not see what came of the click")
    for browser in (*browsers, honest):
        browser.reads.set()
        browser.close()
    await asyncio.sleep(600.0)  # here all that was said waits to be read at its pace; a server lets 4 messages wait
    for browser in (*browsers, honest):
        if not browser.task.done():
            raise Violation("a connection that was closed does not end")
        browser.task.result()
    Client.prune_instances(client_age_threshold=0.0)  # what NiceGUI does each minute of real time
    if core.sio.eio.sockets or core.sio.environ or core.sio.manager.eio_to_sid or Client.instances:
        left = [len(one) for one in (core.sio.eio.sockets, core.sio.environ, core.sio.manager.eio_to_sid)]
        raise Violation(f"something is left of closed connections: {left}, {len(Client.instances)} pages")


def _step(random: Random) -> Step:
    kind = random.random()
    who = float(random.randrange(4))
    if kind < 0.1:
        sure = tuple(float(random.random() < 0.9) for _ in range(3))
        return Step("open", random.choice(QUERIES).encode(), sure)
    if kind < 0.15:
        return Step("wait", b"", (0.0, 0.0, random.choice((0.1, 1.0, 4.5, 12.0))))
    if kind < 0.2:
        return Step("read", b"", (who, float(random.random() < 0.4)))
    if kind < 0.25:
        return Step("close", b"", (who,))
    if kind < 0.3:
        return Step("work", b"", (float(random.choice((1, 50, 2500))), float(random.choice((1, 100, 4000)))))
    many = float(random.choice((1, 1, 1, 2, 700)))
    if kind < 0.5:
        raw = random.choice(RAW)
        return Step("say", mutate_octets(random, raw, RAW) if random.random() < 0.3 else raw, (who, many))
    fields = [f'"{name}":{random.choice(VALUES)}' for name in random.sample(FIELDS, random.randrange(1, 7))]
    fields.insert(0, f'"client_id":{random.choice(VALUES[:2]) if random.random() < 0.9 else random.choice(VALUES)}')
    said = f'42["{random.choice(EVENTS)}",{{{",".join(fields)}}}]'.encode()
    return Step("say", mutate_octets(random, said) if random.random() < 0.15 else said, (who, many))
