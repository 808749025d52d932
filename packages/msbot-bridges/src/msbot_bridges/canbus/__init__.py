"""What the worlds on CAN share: buses of python-can, and their addresses"""

from msbot_bridges.canbus.bus import check_address, open_bus, send_frame

__all__ = ["check_address", "open_bus", "send_frame"]
