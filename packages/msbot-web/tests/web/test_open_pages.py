"""A page belongs to who opened it: every message of a websocket is checked against the session of that socket."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Iterator
from typing import Any

import pytest
from fastapi import Request
from nicegui import Client, core
from nicegui.page import page as nicegui_page
from socketio.exceptions import ConnectionRefusedError

from msbot.operations.rights import Role
from msbot_web.access.accounts import Accounts
from msbot_web.access.sessions import Session
from msbot_web.access.users import MemoryUsers
from msbot_web.nicegui_internals.open_pages import LEFT, MADE_ANEW, OpenPages
from msbot_web.nicegui_internals.page_sockets import COMPLAINTS, NONSENSE
from tests.web.access.test_accounts import Clock, PlainHasher, user

WHOLE = {
    "id": 1, "listener_id": "l", "tab_id": "t", "document_id": "d", "next_message_id": 1, "request_id": "r",
}  # fmt: skip
"""What each message has to have."""


class Rig:
    """Open pages with NiceGUI's handlers replaced by a list of what got through."""

    def __init__(self) -> None:
        self.through: list[tuple[str, str]] = []
        handlers = core.sio.handlers["/"]
        for name in ("connect", "handshake", "event", "javascript_response", "ack", "log"):
            handlers[name] = self._note(name)
        handlers["disconnect"] = lambda _sid: None
        users = MemoryUsers(user("teacher", Role.TEACHER), user("eve", Role.VIEWER))
        self.accounts = Accounts(users, clock=Clock(), hasher=PlainHasher())
        self.pages = OpenPages(self.accounts)
        self.closed: list[str] = []

    def _note(self, name: str) -> Any:
        def handler(sid: str, *_: object) -> bool:
            self.through.append((name, sid))
            return True

        return handler

    def open(self, session: Session) -> str:
        request = Request({"type": "http", "headers": [], "path": "/", "state": {"session": session}})
        return Client(nicegui_page("/"), request=request).id

    async def connect(self, sid: str, session: Session | None, client_id: str) -> object:
        environ = {"asgi.scope": {"state": {"session": session}}, "QUERY_STRING": f"client_id={client_id}"}
        return await core.sio.handlers["/"]["connect"](sid, environ)

    async def say(self, name: str, sid: str, client_id: str) -> object:
        return await core.sio.handlers["/"][name](sid, {"client_id": client_id, **WHOLE})


@pytest.fixture
def rig(monkeypatch: pytest.MonkeyPatch) -> Iterator[Rig]:
    handlers = dict(core.sio.handlers["/"])
    rig = Rig()

    async def disconnect(sid: str) -> None:
        rig.closed.append(sid)

    monkeypatch.setattr(core.sio, "disconnect", disconnect)
    yield rig
    core.sio.handlers["/"].update(handlers)
    Client.instances.clear()


async def test_another_page_cannot_be_clicked_by_who_knows_its_number(rig: Rig) -> None:
    teacher, eve = (
        rig.accounts.sessions.begin(name, role) for name, role in (("teacher", Role.TEACHER), ("eve", Role.VIEWER))
    )
    theirs, own = rig.open(teacher), rig.open(eve)
    assert await rig.connect("s1", teacher, theirs)
    for client_id in (theirs, "of a master before"):
        with pytest.raises(ConnectionRefusedError, match=MADE_ANEW):
            await rig.connect("s2", eve, client_id)
    assert await rig.connect("s2", eve, own)
    assert await rig.connect("s3", None, own) is False
    rig.through.clear()
    for name in ("handshake", "event", "javascript_response", "ack", "log"):
        assert await rig.say(name, "s2", theirs) is False
        assert await rig.say(name, "unknown", theirs) is False
        assert await rig.say(name, "s1", theirs) is not False
        assert await rig.say(name, "s2", own) is not False
    assert {sid for _, sid in rig.through} == {"s1", "s2"}
    assert rig.pages.refused == 13


async def test_a_page_that_waits_for_its_browser_is_deleted_once_when_its_session_ends(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    failed: list[object] = []
    monkeypatch.setattr(core.app, "handle_exception", failed.append)
    monkeypatch.setattr(core, "loop", asyncio.get_running_loop())
    eve = rig.accounts.sessions.begin("eve", Role.VIEWER)
    client = Client.instances[rig.open(eve)]
    client.page.reconnect_timeout = 30.0
    for number in range(2):  # its connection is lost, in two tabs
        client._socket_to_document_id[f"s{number}"] = f"d{number}"
        client._num_connections[f"d{number}"] += 1
        client.handle_disconnect(f"s{number}")
    waiting = [*client._delete_tasks.values()]
    assert len(waiting) == 2
    await asyncio.sleep(0)  # they have begun to wait
    rig.accounts.sign_out(eve)
    await asyncio.wait(waiting, timeout=30)
    assert [task.cancelled() for task in waiting] == [True, True]
    assert client.id not in Client.instances
    assert failed == []


async def test_what_no_page_of_ours_sends_goes_no_further(rig: Rig, caplog: pytest.LogCaptureFixture) -> None:
    eve = rig.accounts.sessions.begin("eve", Role.VIEWER)
    own = rig.open(eve)
    handlers = core.sio.handlers["/"]
    for query in ("", "&tab_id=t&document_id=d&next_message_id=x"):
        with pytest.raises(ConnectionRefusedError, match=MADE_ANEW):
            await rig.connect("s1", eve, f"{own}&implicit_handshake=true{query}")
    assert await handlers["connect"]("s1", "no environment") is False
    assert await rig.connect("s1", eve, f"{own}&implicit_handshake=true&tab_id=t&document_id=d&next_message_id=0")
    rig.through.clear()
    COMPLAINTS.counts.clear()
    for name in ("handshake", "event", "javascript_response", "ack"):
        assert await handlers[name]("s1", {"client_id": own}) is False
        assert await handlers[name]("s1", {"client_id": own, **WHOLE}, "more") is False
        assert await handlers[name]("s1") is False
        assert await handlers[name]("s1", {"client_id": [own], **WHOLE}) is False
    assert rig.through == []
    assert sum(COMPLAINTS.counts.values()) == 8
    with caplog.at_level(logging.INFO):
        await handlers["log"]("s1", {"client_id": own, "level": "nonsense", "message": "x" * 5000})
    assert len(caplog.messages[-1]) < 300


async def test_what_nicegui_makes_of_a_wrong_message_is_counted(rig: Rig) -> None:
    def fails(*_: object) -> None:
        raise KeyError("a listener that is gone")

    handlers, eve = core.sio.handlers["/"], rig.accounts.sessions.begin("eve", Role.VIEWER)
    handlers.update(connect=fails, event=fails)
    pages = OpenPages(rig.accounts)
    own = rig.open(eve)
    pages._sockets["s1"] = eve
    COMPLAINTS.counts.clear()
    assert await rig.say("event", "s1", own) is False
    assert COMPLAINTS.counts == {f"{NONSENSE} (event: KeyError)": 1}


async def test_pages_and_sockets_close_when_the_session_ends_or_the_role_changes(rig: Rig) -> None:
    session = rig.accounts.sessions.begin("teacher", Role.TEACHER)
    page = rig.open(session)
    await rig.connect("s1", session, page)
    rig.accounts.sign_out(session)
    assert await rig.say("event", "s1", page) is False, "at once, before anything is closed"
    await asyncio.sleep(0)
    await asyncio.sleep(0)
    assert page not in Client.instances
    assert rig.closed == ["s1"]
    other = rig.accounts.sessions.begin("teacher", Role.TEACHER)
    page = rig.open(other)
    await rig.connect("s2", other, page)
    rig.accounts.sessions.change_role("teacher", Role.VIEWER)
    await asyncio.sleep(0)
    await asyncio.sleep(0)
    assert page not in Client.instances
    assert rig.closed == ["s1", "s2"]


async def test_an_upload_belongs_to_the_page_of_its_session(rig: Rig) -> None:
    teacher, eve = rig.accounts.sessions.begin("teacher", Role.TEACHER), rig.accounts.sessions.begin("eve", Role.VIEWER)
    page = rig.open(teacher)
    assert rig.pages.may_use(page, teacher)
    assert not rig.pages.may_use(page, eve)
    assert not rig.pages.may_use(page, None)
    assert not rig.pages.may_use("nothing", teacher)


async def test_a_page_that_is_left_is_not_kept_and_others_are(rig: Rig) -> None:
    teacher, eve = (
        rig.accounts.sessions.begin(name, role) for name, role in (("teacher", Role.TEACHER), ("eve", Role.VIEWER))
    )
    left, other = rig.open(teacher), rig.open(teacher)
    await rig.connect("s1", teacher, left)
    await rig.connect("s2", eve, rig.open(eve))
    assert await rig.say(LEFT, "s2", other) is False, "nobody says it for somebody else"
    await rig.say(LEFT, "s1", left)
    assert Client.instances[left].page.reconnect_timeout == 0
    assert Client.instances[other].page.reconnect_timeout is None
