"""Errors as answers of the API: a status that fits, one sentence, never a traceback."""

from __future__ import annotations

import logging

import httpx
import pytest
from fastapi import FastAPI

from msbot_web.access.accounts import NotAllowed, SignedOut
from msbot_web.access.sign_in_throttle import SignInRefused
from msbot_web.api.exception_handlers import add_exception_handlers, status_of
from msbot_xrce.errors import ConfigError, DatabaseBusy, MsbotError, NotThere, RegistryError

ERRORS = [
    (NotThere("no slot"), 404), (NotAllowed("a viewer may not"), 403), (SignedOut("sign in"), 401),
    (SignInRefused("wrong"), 401), (RegistryError("no room"), 409), (DatabaseBusy("locked"), 423),
    (ConfigError("out of range"), 400),
]  # fmt: skip


async def ask(error: Exception | None, path: str = "/1") -> httpx.Response:
    app = FastAPI()
    add_exception_handlers(app)

    @app.get("/{number}")
    async def fail(number: int) -> int:
        if error is not None:
            raise error
        return number

    transport = httpx.ASGITransport(app, raise_app_exceptions=False)
    async with httpx.AsyncClient(transport=transport, base_url="http://robot") as client:
        return await client.get(path)


@pytest.mark.parametrize(("error", "status"), ERRORS)
async def test_a_known_error_is_its_sentence_with_the_status_that_fits(error: MsbotError, status: int) -> None:
    assert status_of(error) == status
    answer = await ask(error)
    assert (answer.status_code, answer.json()) == (status, {"error": str(error)})


async def test_a_request_that_makes_no_sense_is_told_where() -> None:
    answer = await ask(None, "/x")
    assert answer.status_code == 422
    assert answer.json()["error"].startswith("path.number: ")


async def test_anything_else_is_logged_and_not_shown(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.ERROR):
        answer = await ask(ZeroDivisionError("secret path"))
    assert answer.status_code == 500
    assert "secret" not in answer.text
    assert "GET /1" in caplog.text
