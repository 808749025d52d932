"""The page as an app on a device: what it is called, and what it shows while no robot answers.

A browser that has been on the page keeps one thing of it: a small page that says that no robot answers, and goes back
to the robot's own as soon as one does. Nothing else is kept, so nobody sees old values. Browsers keep it only where
nobody in between can change what travels: from this computer itself, or by TLS.
"""

from __future__ import annotations

import hashlib
from importlib.metadata import version
from importlib.resources import files

from fastapi import APIRouter, Request, Response
from fastapi.responses import HTMLResponse, JSONResponse

from msbot_web.html import render
from msbot_web.language import language_of
from msbot_web.root_path import root

MANIFEST_PATH, WORKER_PATH, SHELL_PATH = "/manifest.webmanifest", "/service-worker.js", "/no-robot"


def make_installed(robot: str) -> APIRouter:
    """The calls of browsers that keep the page; all may be had without signing in.

    Args:
        robot: its name.
    """
    router = APIRouter(include_in_schema=False)
    script = (files("msbot_web") / "static" / "service_worker.js").read_text("utf-8")

    @router.get(MANIFEST_PATH)
    async def manifest(request: Request) -> Response:
        content = {
            "name": f"{robot} · MsBOT",
            "short_name": robot,
            "lang": language_of(request).code,
            "start_url": f"{root()}/",
            "scope": f"{root()}/",
            "display": "standalone",
            "theme_color": "#0b6e99",
            "background_color": "#f0f4f7",
            "icons": [{"src": f"{root()}/web/icon.svg", "sizes": "any", "type": "image/svg+xml", "purpose": "any"}],
        }
        return JSONResponse(content, media_type="application/manifest+json")

    @router.get(SHELL_PATH)
    async def shell(request: Request) -> Response:
        return HTMLResponse(_shell(request))

    @router.get(WORKER_PATH)
    async def worker(request: Request) -> Response:
        # Another text, another worker: it then keeps the page anew, as it is in the person's language.
        mark = hashlib.sha256(f"{version('msbot-web')}\n{_shell(request)}".encode()).hexdigest()[:12]
        return Response(script.replace("@MARK@", mark), media_type="text/javascript")

    def _shell(request: Request) -> str:
        language = language_of(request)
        return render(
            "no_robot", language=language, say=language.translate, title=language.translate("No robot"), robot="MsBOT"
        )

    return router
