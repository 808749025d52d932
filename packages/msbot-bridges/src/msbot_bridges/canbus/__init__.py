"""What the worlds on CAN share: buses of python-can, and their addresses"""

from msbot_bridges.canbus.bus import FrameSender, check_address, open_bus

__all__ = ["FrameSender", "check_address", "open_bus"]
