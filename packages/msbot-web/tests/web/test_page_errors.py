"""The same error of a page is written once a minute."""

from __future__ import annotations

import ast
import logging
from pathlib import Path
from typing import Any

import httpx
import pytest
from nicegui import Client, core, ui
from nicegui.events import ClickEventArguments, handle_event
from nicegui.page import page as nicegui_page
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route
from starlette.types import Message, Scope

import msbot_web
from msbot_web.nicegui_internals.page_sockets import COMPLAINTS, NONSENSE
from msbot_web.page_errors import (
    MOST_PLACES,
    SAY_S,
    HandledErrors,
    NotFromOurPage,
    RepeatedErrorFilter,
    read_from_browser,
    somebody_waits,
)


def record(error: object, *, raised: bool = False) -> logging.LogRecord:
    info = (type(error), error, error.__traceback__) if raised and isinstance(error, BaseException) else None
    return logging.LogRecord("nicegui", logging.ERROR, __file__, 1, "failed" if raised else error, (), info)


def failing(where: int) -> BaseException:
    try:
        raise ValueError(where) if where else KeyError(where)
    except (ValueError, KeyError) as error:
        return error


def test_the_same_error_is_written_once_a_minute_with_how_often_it_came() -> None:
    now = 0.0
    once = RepeatedErrorFilter(lambda: now)
    assert once.filter(record(failing(1)))
    assert [once.filter(record(failing(number), raised=True)) for number in range(1, 51)] == [False] * 50
    assert once.filter(record(failing(0))), "another one"
    assert once.filter(record("no error"))
    assert once.filter(record("no error"))
    now = SAY_S
    again = record(failing(7), raised=True)
    assert once.filter(again)
    assert again.getMessage() == "failed (and 50 times before, since it was said last)"


@pytest.mark.promise("Hostile packets and files end in a sentence or a count, never a traceback")
@pytest.mark.parametrize("told", [None, [[]], {"slot": 1}, "x", 1e400])
def test_what_no_page_of_ours_sends_with_an_event_is_counted_and_not_traced(
    told: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    once = RepeatedErrorFilter(lambda: 0.0)

    def ours() -> None:
        with read_from_browser():
            str(told["plug"])

    def counted() -> int:
        return sum(count for words, count in COMPLAINTS.counts.items() if words.startswith(f"{NONSENSE} (event: "))

    before = counted()
    with pytest.raises(NotFromOurPage) as error:
        ours()
    assert not once.filter(record(error.value, raised=True))
    assert counted() == before + 1
    failed: list[BaseException] = []
    monkeypatch.setattr(core.app, "handle_exception", failed.append)
    with Client(nicegui_page("/")):
        toggle = ui.toggle(["a", "b"])
    (listener,) = toggle._event_listeners.values()
    toggle._handle_event({"listener_id": listener.id, "args": told})
    if told is not None:  # it chooses nothing
        assert not once.filter(record(failed.pop(), raised=True))
        assert counted() == before + 2
    with Client(nicegui_page("/")) as client:
        clicked = ClickEventArguments(sender=client.content, client=client)
        handle_event(lambda: str(told["plug"]), clicked, expect_args=False)
    assert once.filter(record(failed.pop(), raised=True)), "a mistake of ours is written"
    with read_from_browser():
        pass


def test_what_is_remembered_is_bounded() -> None:
    once = RepeatedErrorFilter(lambda: 0.0)
    kinds = [type(f"Error{number}", (Exception,), {}) for number in range(3 * MOST_PLACES)]
    assert all(once.filter(record(kind())) for kind in kinds)
    assert len(once._places) == MOST_PLACES


def waits_for_the_browser(tree: ast.AST, *, prepared: bool = False) -> list[bool]:
    """For each wait for what a browser answers: whether somebody is prepared for a browser that sleeps."""
    found = []
    if isinstance(tree, ast.Await):
        call = tree.value
        if isinstance(call, ast.Call) and ast.unparse(call.func) == "ui.run_javascript":
            found.append(prepared)
    for part, value in ast.iter_fields(tree):
        ready = prepared or (part == "body" and _takes_a_timeout(tree))
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST):
                found += waits_for_the_browser(child, prepared=ready)
    return found


def _takes_a_timeout(tree: ast.AST) -> bool:
    if isinstance(tree, ast.With):
        return "suppress(TimeoutError)" in [ast.unparse(one.context_expr) for one in tree.items]
    return isinstance(tree, ast.Try) and "TimeoutError" in map(_caught, tree.handlers)


def _caught(handler: ast.ExceptHandler) -> str:
    return "" if handler.type is None else ast.unparse(handler.type)


def test_a_browser_that_sleeps_is_no_error_of_a_page() -> None:
    """A tab in the background may be put to sleep; what is asked of it is then not answered: nobody's fault."""
    found = {
        path.name: waits_for_the_browser(ast.parse(path.read_text("utf-8")))
        for path in Path(str(msbot_web.__path__[0])).rglob("*.py")
    }
    assert {name: waits for name, waits in found.items() if waits} == {
        "gallery.py": [True],
        "program_blocks.py": [True],
    }


def failing_pages(log: logging.Logger, waiting: list[bool]) -> HandledErrors:
    """Pages of which each fails, and are handled as the robot's are."""

    async def fail(_: Request) -> Response:
        raise ValueError("a mistake of ours")

    async def failed(request: Request, _error: Exception) -> Response:
        waiting.append(await somebody_waits(request))
        return PlainTextResponse("could not be made", 500)

    return HandledErrors(Starlette(routes=[Route("/", fail)], exception_handlers={Exception: failed}), log, lambda: 0.0)


async def test_a_page_that_fails_is_answered_once_and_raises_nothing_more() -> None:
    waiting: list[bool] = []
    transport = httpx.ASGITransport(failing_pages(logging.getLogger("test"), waiting), raise_app_exceptions=True)
    async with httpx.AsyncClient(transport=transport, base_url="http://robot") as visitor:
        answer = await visitor.get("/")
    assert (answer.status_code, answer.text, waiting) == (500, "could not be made", [True])


async def test_visitors_who_have_left_are_counted_and_told_once(caplog: pytest.LogCaptureFixture) -> None:
    waiting: list[bool] = []
    pages = failing_pages(logging.getLogger("test"), waiting)
    sent: list[Message] = []

    async def receive() -> Message:
        return {"type": "http.disconnect"}

    async def send(message: Message) -> None:
        sent.append(message)

    with caplog.at_level(logging.INFO, "test"):
        for _ in range(3):
            scope: Scope = {"type": "http", "method": "GET", "path": "/", "headers": [], "query_string": b""}
            await pages(scope, receive, send)
    assert waiting == [False] * 3
    assert pages.left == 3
    assert caplog.messages == ["1 visitor left before the page was made"]
    assert all(record.exc_info is None for record in caplog.records)


async def test_an_error_that_nobody_has_handled_is_raised() -> None:
    async def broken(*_: object) -> None:
        raise ValueError("not handled")

    transport = httpx.ASGITransport(HandledErrors(broken, logging.getLogger("test")), raise_app_exceptions=True)
    async with httpx.AsyncClient(transport=transport, base_url="http://robot") as visitor:
        with pytest.raises(ValueError, match="not handled"):
            await visitor.get("/")
