"""The call by which services and containers see that the robot's page runs: there before all others, from memory.

Who asks waits for seconds at most, again and again from the start on, also where the other calls take longer to make.
"""

from __future__ import annotations

from fastapi import APIRouter

from msbot_web.access.access_middleware import HEALTH_PATH
from msbot_web.models.common_models import Health


def make_health_api() -> APIRouter:
    """This call alone."""
    router = APIRouter()

    @router.get(HEALTH_PATH)
    async def health() -> Health:
        """Whether the server runs; needs no session."""
        return Health()

    return router
