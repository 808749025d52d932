"""Easy to read: texts in plain words, larger letters, fewer things at a time; each browser keeps it for its person."""

from __future__ import annotations

from typing import Final

from nicegui import ui
from starlette.requests import HTTPConnection

COOKIE: Final = "msbot_easy"
ENTRIES: Final = frozenset({"/", "/arrivals", "/bus", "/wires", "/program", "/arena", "/learn"})
"""What stays in the menu: the pages that lessons send people to. The others are behind one more word."""


def is_easy(request: HTTPConnection) -> bool:
    """Whether the person reads the pages that way."""
    return request.cookies.get(COOKIE, "") == "yes"


def read_easily(*, easy: bool) -> None:
    """Keep what the person wants, and show the page anew."""
    word = "yes" if easy else ""
    ui.run_javascript(f"document.cookie = '{COOKIE}={word};path=/;max-age=31536000;samesite=lax'; location.reload()")
