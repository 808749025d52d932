"""The API in words, from the same description that programs read at `/openapi.json`."""

from __future__ import annotations

import re

from fastapi import FastAPI, Request
from markupsafe import escape
from nicegui import ui

from msbot_web.html import Markup, render
from msbot_web.pages.layout import page_frame
from msbot_web.root_path import base_of
from msbot_web.service import Service


def register(service: Service) -> None:
    """Make the page known."""

    @ui.page("/api-docs")
    def api_docs(request: Request) -> None:
        with page_frame(service, request, "/api-docs", "API") as page:
            calls = [
                (method.upper(), path, _words(call))
                for path, calls in _paths(request).items()
                for method, call in calls.items()
            ]
            ui.html(render("api", say=page.translate, base=base_of(request), calls=calls), sanitize=False).classes(
                "w-full"
            )


def _paths(request: Request) -> dict[str, dict[str, dict[str, object]]]:
    app = request.scope["state"]["api"]
    assert isinstance(app, FastAPI)
    paths: dict[str, dict[str, dict[str, object]]] = app.openapi()["paths"]
    return paths


def _words(call: dict[str, object]) -> Markup:
    """What a call does, with its arguments as code."""
    words = str(escape(call.get("description") or call.get("summary") or ""))
    return Markup(re.sub("`([^`]+)`", r"<code>\1</code>", words))
