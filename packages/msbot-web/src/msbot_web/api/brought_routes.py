"""Calls of the API that extensions bring, below `/api/x/NAME`, for people who are signed in."""

from __future__ import annotations

from collections.abc import Iterator

from fastapi import APIRouter, Depends

from msbot_agent.startup.extensions import extensions
from msbot_web.api.answers import PROBLEMS
from msbot_web.api.operation_routes import PREFIX
from msbot_web.api.session import session_of
from msbot_web.service import Service


def brought_routers(service: Service) -> Iterator[APIRouter]:
    """The routers of all extensions; one whose function fails is left out."""
    for name, make in extensions().all("routes", object).items():
        router = APIRouter(prefix=f"{PREFIX}/x/{name}", responses=PROBLEMS, dependencies=[Depends(session_of)])
        try:
            router.include_router(make(service))  # type: ignore[operator]  # what cannot be called is left out
        except Exception as error:
            extensions().leave_out_named("routes", name, f"{type(error).__name__}: {error}")
            continue
        yield router
