"""Routes that are made when somebody needs them: the API's hundred calls take as long to make as the first page.

They are made in a thread, at the first request for one of them, or as soon as somebody has got the first page: what
that page asks of the API then waits for a part of that time at most.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable

from fastapi import FastAPI
from starlette.routing import BaseRoute
from starlette.types import ASGIApp, Message, Receive, Scope, Send

FIRST_PAGE = "/"


class LazyRoutes:
    """ASGI middleware, see the module's docstring.

    Args:
        app: what comes behind it.
        of: where the routes are put, before all others.
        paths: how the paths of these routes begin.
        make: makes them, in a thread.
        but: the paths that begin like these and wait for nothing: their routes are there already.
    """

    def __init__(
        self,
        app: ASGIApp,
        of: FastAPI,
        paths: tuple[str, ...],
        make: Callable[[], Iterable[BaseRoute]],
        but: tuple[str, ...] = (),
    ) -> None:
        self._app = app
        self._of = of
        self._paths = paths
        self._but = but
        self._make = make
        self._making: asyncio.Task[None] | None = None

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let a request through, once there is what it asks for."""
        if scope["type"] == "http":
            if scope["path"].startswith(self._paths) and scope["path"] not in self._but:
                await asyncio.shield(self._made())
            elif self._making is None and scope["path"] == FIRST_PAGE:
                send = self._and_then_make(send)
        await self._app(scope, receive, send)

    def _made(self) -> asyncio.Task[None]:
        if self._making is None:
            self._making = asyncio.create_task(self._make_them(), name="the API's routes")
        return self._making

    async def _make_them(self) -> None:
        routes = await asyncio.to_thread(lambda: list(self._make()))
        self._of.router.routes[:0] = routes

    def _and_then_make(self, send: Send) -> Send:
        async def sending(message: Message) -> None:
            await send(message)
            if message["type"] == "http.response.body" and not message.get("more_body"):
                self._made()

        return sending
