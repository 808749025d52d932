"""What a browser needs to run a program: MsBOT's package for MicroPython, the host, and the worker with its rules.

The VM itself and the scripts are files under `/web`; here are those that lie elsewhere or need rules of their own.
"""

from __future__ import annotations

import asyncio
import base64
import hashlib
import json
from functools import cache
from importlib.resources import files
from pathlib import Path

from fastapi import FastAPI, Request, Response

from msbot.carried.carried_files import OF_GENERIC_BOARDS, board_sources, browser_sources, carried_folder, package_files
from msbot_web.root_path import root

FILES_PATH = "/program/files.json"
WORKER_PATH = "/program/worker.js"
BOARD_PATH = "/program/board.json"
PACKAGE = Path(__file__).parents[1]


@cache
def home_files() -> str:
    """`{path: text}` as JSON: the package `msbot` for MicroPython, and what runs it in a browser."""
    found = {f"msbot/{path.name}": path.read_text("utf-8") for path in sorted(board_sources().glob("*.py"))}
    ours = browser_sources()
    return json.dumps(found | {path.name: path.read_text("utf-8") for path in sorted(ours.glob("*.py"))})


@cache
def examples() -> dict[str, str]:
    """The examples by their file names: the project's, those for the worlds, and those for a phone, which only a
    browser can run."""
    ours, others = browser_sources() / "programs", carried_folder(PACKAGE, "examples", "examples")
    found = [path for folder in (others, others / "arena", ours) for path in sorted(folder.glob("*.py"))]
    return {path.name: path.read_text("utf-8") for path in found}


@cache
def board_files(mpy_version: int | None) -> str:
    """`{name: [sha256, content, generic]}` as JSON, in hexadecimal digits and base64: the package as it is put on a
    board; `generic` is what only a generic board needs."""
    return json.dumps(
        {
            name: [
                hashlib.sha256(octets).hexdigest(),
                base64.b64encode(octets).decode(),
                name.partition(".")[0] in OF_GENERIC_BOARDS,
            ]
            for name, octets in package_files(mpy_version).items()
        }
    )


def add_browser_files(app: FastAPI) -> None:
    """Serve them; the guard lets only signed-in people through."""

    @app.get(FILES_PATH, include_in_schema=False)
    async def program_files() -> Response:
        return Response(home_files(), media_type="application/json")

    @app.get(BOARD_PATH, include_in_schema=False)
    async def program_board(mpy: int = 0) -> Response:
        # Compiled for the only version there is since MicroPython 1.19; boards with another one get sources.
        text = await asyncio.to_thread(board_files, 6 if mpy == 6 else None)
        return Response(text, media_type="application/json")

    @app.get(WORKER_PATH, include_in_schema=False)
    async def program_worker(request: Request) -> Response:
        text = (files("msbot_web") / "static" / "program" / "worker.js").read_text("utf-8")
        rules = {"content-security-policy": worker_rules(f"{request.headers.get('host', '')}{root()}")}
        return Response(text, media_type="text/javascript", headers=rules)


def worker_rules(page: str) -> str:
    """What a program may reach: the VM's files and the robot's link, nothing else.

    A program may be somebody else's, opened by a link, and MicroPython lets it use what a worker of the page can. It
    must not be able to act on the page in the name of the person who runs it.

    Args:
        page: host and folder of the page, as the browser asks for it.
    """
    reach = " ".join(
        [
            *(f"{scheme}://{page}/api/link" for scheme in ("ws", "wss")),
            *(f"{scheme}://{page}/web/micropython/" for scheme in ("http", "https")),
        ]
    )
    return f"default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; connect-src {reach}; worker-src 'none'"
