"""Whoever asks for pages without end holds nobody up, and has a bounded number of them open."""

from __future__ import annotations

import asyncio
import time
from itertools import pairwise

import pytest
from fastapi import Request
from nicegui import Client
from nicegui.page import page as nicegui_page
from starlette.types import Message, Receive, Scope, Send

from msbot.operations.rights import Role
from msbot.process.virtual_time import run_virtual
from msbot_web.access.sessions import Session
from msbot_web.nicegui_internals import page_admission
from msbot_web.nicegui_internals.page_admission import (
    LONGEST_S,
    LONGEST_STEP_S,
    LONGEST_TURN_S,
    MOST_OPEN,
    MOST_WAITING,
    NOT_CONNECTED_S,
    OPEN,
    WAITING,
    PageAdmission,
)

EVE = Session("eve", Role.STUDENT, 0.0, 0.0, key="eve")
ADA = Session("ada", Role.TEACHER, 0.0, 0.0, key="ada")


@pytest.fixture(autouse=True)
def no_pages(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Client, "page_routes", {print: "/", repr: "/slot/{name}"})
    monkeypatch.setattr(Client, "instances", {})


class Site:
    """An application that makes one page after another, and whose visitors may read slowly."""

    def __init__(self) -> None:
        self.turns = PageAdmission(self.make)
        self.now_made = self.most_at_once = 0
        self.makes_s = 0.1
        self.reads = asyncio.Event()
        self.reads.set()

    async def make(self, scope: Scope, _receive: Receive, send: Send) -> None:
        self.now_made += 1
        self.most_at_once = max(self.most_at_once, self.now_made)
        await asyncio.sleep(self.makes_s)
        self.now_made -= 1
        await send({"type": "http.response.start", "status": 200})
        await send({"type": "http.response.body", "body": b""})

    async def ask(self, session: Session | None, path: str = "/") -> int:
        status = 0

        async def send(message: Message) -> None:
            nonlocal status
            status = message.get("status", status)
            await self.reads.wait()

        async def receive() -> Message:
            raise AssertionError("nothing is sent")

        await self.turns({"type": "http", "path": path, "state": {"session": session}}, receive, send)
        return status


def test_pages_are_made_one_after_another_and_who_asks_too_often_gets_a_sentence() -> None:
    async def scene() -> None:
        site, loop = Site(), asyncio.get_running_loop()
        flood = [asyncio.create_task(site.ask(EVE)) for _ in range(100)]
        await asyncio.sleep(0)
        started = loop.time()
        assert await site.ask(ADA, "/slot/AA") == 200
        assert loop.time() - started < (MOST_WAITING + 2) * site.makes_s + 0.01
        found = [await one for one in flood]
        assert found.count(200) == MOST_WAITING + 1, "one is being made"
        assert site.turns.refused == {WAITING: 100 - MOST_WAITING - 1}
        assert site.most_at_once == 1
        assert await site.ask(EVE) == 200, "afterwards as before"

    run_virtual(scene())


def test_who_reads_an_answer_slowly_or_waits_for_the_database_holds_nobody_up() -> None:
    async def scene() -> None:
        site, loop = Site(), asyncio.get_running_loop()
        site.reads.clear()
        slow = [asyncio.create_task(site.ask(EVE)) for _ in range(4)]
        await asyncio.sleep(1.0)
        assert site.now_made == 0, "all are made, though nobody has read one"
        site.reads.set()
        assert [await one for one in slow] == [200] * 4
        site.makes_s = 5.0
        held = [asyncio.create_task(site.ask(EVE)) for _ in range(3)]
        await asyncio.sleep(0)
        started = loop.time()
        assert await site.ask(ADA) == 200
        assert loop.time() - started == pytest.approx(5.0 + 3 * LONGEST_S)
        await asyncio.gather(*held)

    run_virtual(scene())


def test_who_leaves_gives_the_turn_to_the_next() -> None:
    async def scene() -> None:
        site = Site()
        tasks = [asyncio.create_task(site.ask(EVE)) for _ in range(4)]
        await asyncio.sleep(0.01)
        for one in tasks[:3]:
            one.cancel()
        assert await tasks[3] == 200
        assert await site.ask(EVE) == 200

    run_virtual(scene())


def test_other_requests_do_not_wait() -> None:
    async def scene() -> None:
        site = Site()
        await asyncio.gather(*(site.ask(EVE, path) for path in ["/api/stop", "/web/x.css", "/handbook"] * 9))
        await asyncio.gather(*(site.ask(None) for _ in range(20)))
        assert site.most_at_once >= 20

    run_virtual(scene())


def test_pages_that_have_to_be_made_anew_are_told_when_their_turn_is() -> None:
    async def scene() -> None:
        site = Site()
        pupils = [Session(f"p{number}", Role.STUDENT, 0.0, 0.0, key=str(number)) for number in range(60)]
        turns = [site.turns.turn_s(one, 0.0) for one in pupils]
        assert turns[0] == 0.0
        steps = {round(late - early, 6) for early, late in pairwise(turns)}  # type: ignore[operator]
        assert len(steps) == 1, "one after another"
        assert 0.0 < max(turns) < 10.0  # type: ignore[type-var, operator]
        site.makes_s = LONGEST_STEP_S
        for one in pupils[:20]:
            assert await site.ask(one) == 200
        slow = PageAdmission(site.make)
        slow._made_s = site.turns._made_s
        given = [slow.turn_s(one, 0.0) for one in pupils]
        assert given[1] == pytest.approx(LONGEST_STEP_S, rel=0.1), "as long as making one has taken lately"
        assert given[-1] is None, "beyond some time nobody can say"
        assert slow.turn_s(pupils[-1], LONGEST_TURN_S) is not None

    run_virtual(scene())


def test_who_asks_for_turns_without_end_pushes_nobody_back() -> None:
    site = Site()
    mine = [site.turns.turn_s(EVE, 0.0) for _ in range(1000)]
    assert len(set(mine)) == MOST_WAITING
    ada = site.turns.turn_s(ADA, 0.0)
    assert ada is not None
    assert ada < 1.0
    assert site.turns.turn_s(EVE, 60.0) == 0.0
    assert len(site.turns._given) == 1, "turns that are over are forgotten"


async def test_pages_that_no_browser_has_connected_to_make_room(monkeypatch: pytest.MonkeyPatch) -> None:
    async def answered(scope: Scope, _receive: Receive, send: Send) -> None:
        Client(nicegui_page("/"), request=Request({**scope, "headers": []}))
        await send({"type": "http.response.start", "status": 200})

    site = Site()
    site.turns = PageAdmission(answered)
    for _ in range(MOST_OPEN):
        assert await site.ask(EVE) == 200
    assert await site.ask(EVE) == 429, "all may still be loading"
    assert site.turns.refused == {OPEN: 1}
    assert await site.ask(ADA) == 200
    connected, *others = [one for one in Client.instances.values() if one.request.scope["state"]["session"] is EVE]
    connected.tab_id = "t"
    later = time.time() + NOT_CONNECTED_S + 1
    monkeypatch.setattr(time, "time", lambda: later)
    assert await site.ask(EVE) == 200
    assert connected.id in Client.instances
    assert others[0].id not in Client.instances
    monkeypatch.setattr(page_admission, "MOST_IN_ALL", len(Client.instances))
    assert await site.ask(ADA) == 200
    assert others[1].id not in Client.instances, "of the one with most"
    for one in list(Client.instances.values()):
        one.delete()


def test_pages_are_told_from_other_paths() -> None:
    assert page_admission._is_page("/slot/AA")
    assert not page_admission._is_page("/handbook/pictures/x.png")
