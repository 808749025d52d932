"""What all bridges share: the contract of a world, and parts that are made of devices.

A world implements `World` and `ForeignDevice`; `Bridge` does the rest: part number, UID, description, settings, life,
STOP.
"""

from msbot_bridges.bridge.bridge import Bridge
from msbot_bridges.bridge.bridged_part import BridgedPart
from msbot_bridges.bridge.can_claim import BridgeTraffic, CanClaim, Identifiers
from msbot_bridges.bridge.contract import (
    BridgeLink,
    DeviceChange,
    DeviceIdentity,
    DeviceOutput,
    DeviceService,
    DeviceSetting,
    Fit,
    ForeignDevice,
    Input,
    Report,
    SimulatedDevice,
    Value,
    World,
    WorldHost,
    WorldKind,
    fits_of,
    worlds,
)
from msbot_bridges.bridge.thread import WorldThread
from msbot_bridges.bridge.threaded_device import ThreadedDevice

__all__ = [
    "Bridge",
    "BridgeLink",
    "BridgeTraffic",
    "BridgedPart",
    "CanClaim",
    "DeviceChange",
    "DeviceIdentity",
    "DeviceOutput",
    "DeviceService",
    "DeviceSetting",
    "Fit",
    "ForeignDevice",
    "Identifiers",
    "Input",
    "Report",
    "SimulatedDevice",
    "ThreadedDevice",
    "Value",
    "World",
    "WorldHost",
    "WorldKind",
    "WorldThread",
    "fits_of",
    "worlds",
]
