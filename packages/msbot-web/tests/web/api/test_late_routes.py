"""Routes that are made when somebody needs them."""

import asyncio
from collections.abc import Awaitable, Callable
from threading import Event, current_thread, main_thread
from typing import cast

import httpx
from fastapi import FastAPI
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import BaseRoute, Route

from msbot_web.access.access_middleware import HEALTH_PATH, STOP_PATH
from msbot_web.api.health_route import make_health_api
from msbot_web.api.lazy_routes import LazyRoutes
from msbot_web.api.stop_route import make_stop_api
from msbot_web.service import Service


async def _answer(request: Request) -> Response:
    return PlainTextResponse(f"late {request.url.path}")


async def _page(_request: Request) -> Response:
    return PlainTextResponse("page")


class _App:
    def __init__(self) -> None:
        self.made: list[bool] = []
        self.may_go_on = Event()
        self.may_go_on.set()
        self.app = FastAPI()
        self.app.include_router(make_health_api())
        self.app.router.routes.append(Route("/{rest:path}", _page))
        self.app.router.routes.insert(0, Route(STOP_PATH, _answer, methods=["POST"]))
        at_once = (STOP_PATH, HEALTH_PATH)
        self.app.add_middleware(LazyRoutes, of=self.app, paths=("/api", "/metrics"), make=self._make, but=at_once)

    def _make(self) -> list[BaseRoute]:
        self.may_go_on.wait()
        self.made.append(current_thread() is main_thread())
        return [Route("/api/robot", _answer), Route("/metrics", _answer)]


def _run(steps: Callable[[_App, httpx.AsyncClient], Awaitable[None]]) -> None:
    async def main() -> None:
        app = _App()
        async with httpx.AsyncClient(transport=httpx.ASGITransport(app.app), base_url="http://robot") as client:
            await steps(app, client)

    asyncio.run(main())


def test_they_are_made_once_in_a_thread_at_the_first_request_for_one_of_them() -> None:
    async def steps(app: _App, client: httpx.AsyncClient) -> None:
        assert (await client.get("/bus")).text == "page"
        assert app.made == []
        answers = await asyncio.gather(client.get("/api/robot"), client.get("/metrics"), client.get("/api/robot"))
        assert [answer.text for answer in answers] == ["late /api/robot", "late /metrics", "late /api/robot"]
        assert app.made == [False]

    _run(steps)


def test_they_are_made_when_the_first_page_has_been_sent() -> None:
    async def steps(app: _App, client: httpx.AsyncClient) -> None:
        assert (await client.get("/")).text == "page"
        (making,) = (task for task in asyncio.all_tasks() if task.get_name() == "the API's routes")
        await making
        assert app.made == [False]
        assert (await client.get("/api/robot")).text == "late /api/robot"
        assert (await client.get("/")).text == "page"
        assert app.made == [False]

    _run(steps)


def test_stop_and_the_health_check_wait_for_nothing() -> None:
    async def steps(app: _App, client: httpx.AsyncClient) -> None:
        app.may_go_on.clear()
        waiting = asyncio.create_task(client.get("/api/robot"))
        assert (await client.get("/")).text == "page"
        assert (await client.post("/api/stop")).text == "late /api/stop"
        assert (await client.get("/api/health")).json() == {"status": "ok"}
        assert app.made == []
        app.may_go_on.set()
        assert (await waiting).text == "late /api/robot"

    _run(steps)


def test_the_call_of_stop_is_one_of_its_own() -> None:
    (route,) = make_stop_api(cast("Service", None)).routes
    assert isinstance(route, Route)
    assert (route.path, route.methods) == (STOP_PATH, {"POST"}) == ("/api/stop", {"POST"})
