"""What the agent's settings mean for one session."""

from __future__ import annotations

from msbot_agent.agent.agent_settings import AgentSettings
from msbot_agent.link import LinkInfo
from msbot_xrce import AgentSessionSettings


def session_settings(settings: AgentSettings, link: LinkInfo, *, is_stock: bool) -> AgentSessionSettings:
    """The settings of sessions on such a link.

    `is_stock`: the client may be a stock one, as it has not said at its login that it is one of ours.
    """
    is_fast = link.bits_per_second is None  # all messages leave at once
    return AgentSessionSettings(
        window=settings.window,
        heartbeat_s=settings.heartbeat_s,
        # On a bus, silence means that others go first, hardly ever a loss; asking more often would make it worse.
        heartbeat_min_s=settings.heartbeat_s if link.shared_bus else settings.heartbeat_min_s,
        max_message=settings.max_message,
        queue_limit=settings.max_burst,
        packs=settings.packs and is_fast,
        peer_is_stock=is_stock,
        may_reorder=not link.keeps_order,
    )
