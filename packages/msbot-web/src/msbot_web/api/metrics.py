"""`/metrics`: the robot's figures for Prometheus, for everybody who may see the robot."""

from __future__ import annotations

import asyncio

from fastapi import APIRouter
from fastapi.responses import Response

from msbot.metrics.exposition import exposition
from msbot_web.api.session import SignedIn
from msbot_web.service import Service


def make_metrics(service: Service) -> APIRouter:
    """The one call."""
    router = APIRouter()

    @router.get("/metrics", include_in_schema=False)
    async def metrics(session: SignedIn) -> Response:
        """The figures: read here, in the robot's loop, and written down in a thread."""
        figures = service.figures(session)
        text, content_type = await asyncio.to_thread(exposition, lambda: figures)
        return Response(text, media_type=content_type)

    return router
