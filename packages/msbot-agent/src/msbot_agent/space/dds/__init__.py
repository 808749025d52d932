"""DDS through Cyclone's C library (extra `msbot-agent[dds]`, or Debian's libddsc0debian)."""

from msbot_agent.space.dds.library import load
from msbot_agent.space.dds.space import DdsSpace

__all__ = ["DdsSpace", "load"]
