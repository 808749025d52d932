"""DDS through Cyclone's C library (extra `msbot[dds]`, or Debian's libddsc0debian)."""

from msbot.space.dds.library import load
from msbot.space.dds.space import DdsSpace

__all__ = ["DdsSpace", "load"]
