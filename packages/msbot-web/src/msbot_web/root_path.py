"""Where the page is for the browser that asks: under a path of its own when a reverse proxy puts it into a folder.

Everything here knows paths without that folder: `/login`. What is written into a page for a browser begins with
`root()`. A page keeps the folder it was asked under for as long as it is open, because whatever is done for it later is
done in the context of its requests.
"""

from __future__ import annotations

from contextvars import ContextVar

from starlette.requests import HTTPConnection

ROOT: ContextVar[str] = ContextVar("root", default="")


def root() -> str:
    """The folder, without a slash at its end: `/robots/rex`; empty: there is none."""
    return ROOT.get()


def base_of(request: HTTPConnection) -> str:
    """The address of the page as its person has opened it, with a slash at its end."""
    return f"{request.url.scheme}://{request.headers.get('host', '')}{root()}/"


THIS_COMPUTER = ("127.0.0.1", "localhost", "::1")
"""Names and addresses by which no other computer can ask."""
