"""DDS through Cyclone's C library (extra `msbot-agent[dds]`, or Debian's libddsc0debian)."""

from msbot_agent.space.dds.dds_space import DdsSpace
from msbot_agent.space.dds.libddsc import load

__all__ = ["DdsSpace", "load"]
