"""The API in words, from the same description that programs read at `/openapi.json`."""

from __future__ import annotations

from html import escape

from fastapi import FastAPI, Request
from nicegui import ui

from msbot.web.pages.layout import page_frame
from msbot.web.service import Service


def register(service: Service) -> None:
    """Make the page known."""

    @ui.page("/api-docs")
    def api_docs(request: Request) -> None:
        with page_frame(service, request, "/api-docs", "API") as page:
            ui.html(
                f"<div class='panel'><p>{escape(page.say('A program shows an API token of an administrator, teacher or student:'))}</p>"
                f"<pre class='mono scroll'>curl -H 'Authorization: Bearer msbot_…' {escape(str(request.base_url))}api/robot</pre>"
                f"<p><a href='/openapi.json'>/openapi.json</a></p></div>",
                sanitize=False,
            ).classes("w-full")
            rows = "".join(
                f"<tr><td><b>{method.upper()}</b></td><td class='mono'>{escape(path)}</td><td>{escape(_words(call))}</td></tr>"
                for path, calls in _paths(request).items()
                for method, call in calls.items()
            )
            ui.html(
                f'<div class="panel scroll"><table class="ms-table stack">{rows}</table></div>', sanitize=False
            ).classes("w-full")


def _paths(request: Request) -> dict[str, dict[str, dict[str, object]]]:
    app = request.scope["state"]["api"]
    assert isinstance(app, FastAPI)
    paths: dict[str, dict[str, dict[str, object]]] = app.openapi()["paths"]
    return paths


def _words(call: dict[str, object]) -> str:
    return str(call.get("description") or call.get("summary") or "")
