"""Names in recordings that both writers and readers use."""

from typing import Final

MEASURED: Final = "/msbot/measured"
"""What was measured at the robot itself: how late the master is, and the time between the beats of each slot."""
BITRATE: Final = "bits_per_second"
"""In the metadata of a bus' channel."""
