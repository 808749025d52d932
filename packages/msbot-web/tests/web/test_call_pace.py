"""How often the API may be called: by a person, a program, from an address; and STOP, always."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterable

import pytest
from starlette.types import Message, Receive, Scope, Send

from msbot.operations.rights import Role
from msbot_web.access.access_middleware import STOP_PATH
from msbot_web.access.accounts import Accounts
from msbot_web.access.sessions import Session
from msbot_web.access.users import MemoryUsers, User
from msbot_web.api_rate_limit import (
    ADDRESS,
    ADDRESS_BURST,
    ADDRESS_CALLS_PER_S,
    BURST,
    CALLS_PER_S,
    PERSON,
    SAY_S,
    ApiRateLimit,
)
from tests.web.access.test_accounts import PlainHasher, user

ANN = Session("ann", Role.STUDENT, 0.0, 0.0, key="ann's browser")
ANN_AT_HOME = Session("ann", Role.STUDENT, 0.0, 0.0, key="ann's other browser")
BEN = Session("ben", Role.STUDENT, 0.0, 0.0, key="ben's browser")
LOOP = Session("ann", Role.STUDENT, 0.0, 0.0, program="one token")
OTHER_LOOP = Session("ann", Role.STUDENT, 0.0, 0.0, program="another token")
GUEST = Session("ann", Role.VIEWER, 0.0, 0.0, key="a guest's browser", guest_of="ben")
DEMO = Session("ann", Role.ADMINISTRATOR, 0.0, 0.0, key="the demo's browser", is_lasting=True)


class Site:
    """An API behind the pace, and a clock that the test turns."""

    def __init__(self) -> None:
        self.now = 0.0
        self.answered = 0
        self.pace = ApiRateLimit(self.answer, ("/api", "/metrics"), STOP_PATH, lambda: self.now)

    async def answer(self, _scope: Scope, _receive: Receive, send: Send) -> None:
        self.answered += 1
        await send({"type": "http.response.start", "status": 200, "headers": []})

    async def ask(
        self, session: Session | None = ANN, path: str = "/api/robot", *, address: str = "10.0.0.1", language: str = ""
    ) -> list[Message]:
        sent: list[Message] = []

        async def send(message: Message) -> None:
            sent.append(message)

        async def receive() -> Message:
            raise AssertionError("nothing is read")

        headers = [(b"accept-language", language.encode())] if language else []
        scope = {"type": "http", "path": path, "headers": headers, "client": (address, 5), "state": {}}
        scope["state"] = {"session": session}
        await self.pace(scope, receive, send)
        return sent

    async def count(self, times: float, session: Session | None = ANN, path: str = "/api/robot", **more: str) -> int:
        """How many of so many calls are answered."""
        before = self.answered
        for _ in range(int(times)):
            await self.ask(session, path, **more)
        return self.answered - before


async def test_a_person_who_calls_too_often_is_told_when_to_go_on() -> None:
    site = Site()
    assert await site.count(BURST) == BURST
    start, body = await site.ask()
    assert start["status"] == 429
    assert (b"retry-after", b"1") in start["headers"]
    assert json.loads(body["body"]) == {
        "error": "you make more than 50 calls a second: ask again in 1 s, and less often"
    }
    _, body = await site.ask(language="de")
    assert "50 Aufrufe in der Sekunde" in json.loads(body["body"])["error"]
    site.now += 1.0
    assert await site.count(3 * CALLS_PER_S) == CALLS_PER_S
    site.now += 1000.0
    assert await site.count(2 * BURST) == BURST
    assert set(site.pace.refused) == {PERSON}


async def test_a_persons_browsers_count_together_and_everybody_else_alone() -> None:
    site = Site()
    assert await site.count(2 * BURST, ANN) == BURST
    assert await site.count(5, ANN_AT_HOME) == 0
    for one in (BEN, LOOP, OTHER_LOOP, GUEST, DEMO):
        assert await site.count(5, one, address=one.key or one.program) == 5


async def test_an_address_has_a_bound_of_its_own_whoever_calls_from_there() -> None:
    site = Site()
    people = [Session(f"pupil {number}", Role.STUDENT, 0.0, 0.0, key=str(number)) for number in range(30)]
    a_second_each = ADDRESS_BURST / len(people)
    answered = [await site.count(a_second_each + 1, pupil) for pupil in people]
    assert sum(answered) == ADDRESS_BURST
    start, body = await site.ask(None)
    assert (start["status"], dict(start["headers"])[b"retry-after"]) == (429, b"1")
    assert json.loads(body["body"]) == {
        "error": "more than 200 calls a second come from your address: ask again in 1 s"
    }
    assert await site.count(10, people[0], address="10.0.0.2") == 10
    site.now += 2.0
    assert await site.count(ADDRESS_BURST, None) == 2 * ADDRESS_CALLS_PER_S
    assert set(site.pace.refused) == {ADDRESS}


@pytest.mark.parametrize("session", [ANN, LOOP, GUEST, None])
async def test_stop_is_never_refused_and_costs_nobody_a_call(session: Session | None) -> None:
    site = Site()
    await site.count(2 * ADDRESS_BURST, session)
    assert await site.count(2000, session, STOP_PATH) == 2000
    other = Site()
    assert await other.count(2000, session, STOP_PATH) == 2000
    assert await other.count(BURST, session) == BURST


async def test_pages_and_what_belongs_to_them_are_not_calls() -> None:
    site = Site()
    assert await site.count(2000, ANN, "/slot/AA") == 2000
    sent: list[Message] = []

    async def send(message: Message) -> None:
        sent.append(message)

    async def receive() -> Message:
        raise AssertionError

    for _ in range(2000):
        await site.pace({"type": "websocket", "path": "/api/link", "state": {"session": ANN}}, receive, send)
    assert len(sent) == 2000


async def test_it_is_said_once_a_minute(caplog: pytest.LogCaptureFixture) -> None:
    site = Site()
    with caplog.at_level(logging.WARNING):
        await site.count(BURST + 7)
        site.now += SAY_S
        await site.count(BURST + 3)
    assert [record.message for record in caplog.records] == [
        "the API is called too often by ann from 10.0.0.1: 1 call refused so far",
        "the API is called too often by ann from 10.0.0.1: 8 calls refused so far",
    ]


async def test_each_token_of_a_person_is_told_apart() -> None:
    def people() -> Iterable[User]:
        yield user("ada")

    accounts = Accounts(MemoryUsers(*people()), clock=lambda: 0.0, hasher=PlainHasher())
    tokens = [await accounts.new_token("ada", purpose, who="ada") for purpose in ("one", "other")]
    found = [accounts.by_api_token(token) for token in (*tokens, tokens[0])]
    programs = [one.program for one in found if one is not None]
    assert len(programs) == 3
    assert programs[0] == programs[2] != programs[1]
    assert tokens[0] not in programs, "a digest is enough"
