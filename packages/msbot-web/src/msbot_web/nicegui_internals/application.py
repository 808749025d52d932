"""NiceGUI inside an application of our own."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

from fastapi import FastAPI
from nicegui import client, core, ui
from nicegui.middlewares import RedirectWithPrefixMiddleware
from starlette.requests import Request
from starlette.responses import Response

from msbot_web.access.content_policy import NonceLoader
from msbot_web.nicegui_internals.deleted_elements import free_deleted_elements
from msbot_web.nicegui_internals.outboxes import let_outboxes_sleep
from msbot_web.nicegui_internals.startup import undisturbed

LOGGER = logging.getLogger("nicegui")
"""Where NiceGUI says that a page could not be made."""

Refusal = Callable[[Request, Exception], Awaitable[Response]]


def serve_pages(app: FastAPI, *, title: str, icon: Path, kept_s: float, not_there: Refusal, failed: Refusal) -> None:
    """Serve NiceGUI's pages from an application.

    Args:
        app: the application.
        title: of the pages.
        icon: shown by the browser.
        kept_s: how long a page whose connection is lost is kept as it was.
        not_there: answers for an address that there is not; NiceGUI would build a whole page.
        failed: answers for a page that cannot be made.
    """
    _mark_page_scripts()
    let_outboxes_sleep()
    free_deleted_elements()
    ui.run_with(
        app, title=title, dark=None, show_welcome_message=False, tailwind=False, reconnect_timeout=kept_s, favicon=icon
    )
    # `ProxyHeadersMiddleware` leads redirects into the page's folder; NiceGUI would do so once more.
    leads_twice: object = RedirectWithPrefixMiddleware
    core.app.user_middleware = [one for one in core.app.user_middleware if one.cls is not leads_twice]
    app.router.lifespan_context = undisturbed(app.router.lifespan_context)
    core.app.config.socket_io_js_transports = ["websocket", "polling"]  # the second where the first does not pass
    core.app.add_exception_handler(404, not_there)
    core.app.add_exception_handler(Exception, failed)


def set_ping(interval_s: float, patience_s: float) -> None:
    """How often pages are asked whether they are there, and how long they may take to answer; NiceGUI sets its own
    values when the server begins."""
    core.sio.eio.ping_interval, core.sio.eio.ping_timeout = interval_s, patience_s


def _mark_page_scripts() -> None:
    """Let the scripts in NiceGUI's own template run."""
    environment = client.templates.env
    if environment.loader is not None and not isinstance(environment.loader, NonceLoader):
        environment.loader = NonceLoader(environment.loader)


# Names of elements that NiceGUI has and does not offer.


# The protocol of websockets, loaded when the first of them comes or the first page has gone, not before that page.


class LazyWebSocket(asyncio.Protocol):
    """Becomes a `WebSocketConnection` when a connection asks for one."""

    def __new__(cls, **given: Any) -> Any:  # noqa: ANN401 - whatever uvicorn gives and wants
        """The protocol for one connection."""
        return websocket_protocol()(**given)


def websocket_protocol() -> type[asyncio.Protocol]:
    """The protocol."""
    from msbot_web.websocket_connection import WebSocketConnection

    return WebSocketConnection
