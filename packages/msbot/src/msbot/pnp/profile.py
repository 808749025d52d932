"""The robot's profile: all that the master tells everybody (thesis 3.12.1, step 1).

The profile names the robot so that a part can recognise it before it says anything about itself. It never says
anything about parts.
"""

from __future__ import annotations

import zlib

from msbot_xrce.lazy import dataclass

PROFILE_TOPIC = "msbot_masterTopic"
"""Name of the profile's topic, as in the thesis' programs."""
PROFILE_TYPE = "msbot_master"
PROFILE_PERIOD_S = 5.0
"""Seconds between two publications (thesis 3.12.1)."""


@dataclass(frozen=True, slots=True)
class Profile:
    """Who the robot is; the defaults are the thesis' sample robot."""

    name: str = "MSBOT_MASTER"
    version: str = "MSBOT_V1"
    serial_number: str = "X100Y100Z100"
    released: str = "8-4-2021"
    """Release date as text, in whatever format the maker uses."""
    manufacturer: str = "MASSEY_ENGINEERING_DEP"

    def profile_hash(self) -> int:
        """CRC-32 of name, version and serial number, joined by NUL; goes into the beacon of a CAN bus."""
        return zlib.crc32("\0".join((self.name, self.version, self.serial_number)).encode())
