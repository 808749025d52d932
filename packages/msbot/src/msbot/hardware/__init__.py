"""Drivers for part types of the library, their wiring, and the parts that use them."""

from msbot.hardware.driver import Driver, Mount, Values, driver_class
from msbot.hardware.hardware_fault import HardwareFault
from msbot.hardware.hardware_part import HardwarePart
from msbot.hardware.machine import Machine
from msbot.hardware.parts_host import HardwareParts, PartsHost
from msbot.hardware.scan import FoundThing, ScanResult, scan
from msbot.hardware.wiring import HostedPart, PartWiring, make_wiring, read_parts

__all__ = [
    "Driver",
    "FoundThing",
    "HardwareFault",
    "HardwarePart",
    "HardwareParts",
    "HostedPart",
    "Machine",
    "Mount",
    "PartWiring",
    "PartsHost",
    "ScanResult",
    "Values",
    "driver_class",
    "make_wiring",
    "read_parts",
    "scan",
]
