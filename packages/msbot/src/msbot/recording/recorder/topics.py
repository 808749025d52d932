"""Names in recordings that both writers and readers use."""

from typing import Final

MEASURED: Final = "/msbot/measured"
"""What was measured at the robot itself: how late the master is, and the beats of each slot."""
BLUEPRINT: Final = "/msbot/blueprint"
"""The robot's slots and wires."""
SHOWN: Final = "/msbot/shown"
"""What people do by hand, and planted faults."""
SLOTS: Final = "/msbot/slots"
"""What holds a slot."""
BITRATE: Final = "bits_per_second"
"""In the metadata of a bus' channel."""
DATA_BITRATE: Final = "data_bits_per_second"
"""Likewise, where CAN FD frames have a faster part."""
