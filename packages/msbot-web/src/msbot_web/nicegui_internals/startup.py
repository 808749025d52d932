"""How the page's libraries are loaded, and how their server begins: three tricks, each with its reason."""

from __future__ import annotations

import contextlib
import gc
import sys
from collections.abc import AsyncIterator
from typing import TYPE_CHECKING, Any

from msbot.process.daemon_threads import leave_out, load_lazily

if TYPE_CHECKING:
    from fastapi import FastAPI
    from starlette.types import Lifespan

_LONG_S = 1.0


def load_less() -> None:
    """Keep libraries from loading what nobody here uses; to be called before they are imported.

    Without it a page's first import loads some 250 modules more.
    """
    load_lazily("aiohttp", "requests")  # for socket.io's client, which comes with its server and is used by nobody here
    load_lazily("ifaddr")  # for NiceGUI's list of its addresses, which asks a program of the system for a library
    leave_out("pydantic.v1")  # FastAPI asks of each argument whether it is of pydantic 1, which is loaded for it


def undisturbed(lifespan: Lifespan[FastAPI]) -> Lifespan[FastAPI]:
    """Begin the server where no other thread is in the middle of something.

    NiceGUI begins with `gc.get_objects()`. A tuple that another thread (the database's, the lessons') is filling at
    that moment would be held twice, and CPython ends the filling with a SystemError. What is there already is kept from
    that list, and between the two no other thread has its turn.
    """

    @contextlib.asynccontextmanager
    async def begin(app: FastAPI) -> AsyncIterator[Any]:
        usual_s = sys.getswitchinterval()
        sys.setswitchinterval(_LONG_S)
        gc.freeze()
        try:
            async with lifespan(app) as state:
                sys.setswitchinterval(usual_s)
                yield state
        finally:
            sys.setswitchinterval(usual_s)

    return begin
