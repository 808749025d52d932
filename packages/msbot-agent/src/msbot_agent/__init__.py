"""A DDS-XRCE agent for any client, with its links and data spaces. The names that a program needs; the rest is below.

::

    from msbot_agent import Agent, MemorySpace, open_link

    agent = Agent(MemorySpace())
    agent.add_link(open_link("udp:127.0.0.1:8888", serve=True))
    asyncio.run(agent.run())
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from msbot_xrce.lazy import lazy_face

if TYPE_CHECKING:
    from msbot_agent.agent import Agent, AgentSettings
    from msbot_agent.link import Link, open_link
    from msbot_agent.space import MemorySpace, Space, open_space

_NAMES = {
    "msbot_agent.agent": ("Agent", "AgentSettings"),
    "msbot_agent.link": ("Link", "open_link"),
    "msbot_agent.space": ("MemorySpace", "Space", "open_space"),
}

__getattr__ = lazy_face(__name__, _NAMES)

__all__ = ["Agent", "AgentSettings", "Link", "MemorySpace", "Space", "open_link", "open_space"]
