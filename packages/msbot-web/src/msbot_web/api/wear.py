"""How the session of a part has gone, as pages and API show it."""

from __future__ import annotations

from msbot_web.api.model import Model


class Wear(Model):
    """What went wrong between the agent and a part since its session was opened."""

    repeated: int
    """Messages of the part that came twice, or too late."""
    resent: int
    """Messages that were sent to it again."""
    unread: int
    """Samples for it that were thrown away because it takes them too slowly."""
