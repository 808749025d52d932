"""The world of DroneCAN: finds nodes, and is the allocator of their node ids."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from msbot_bridges.bridge import (
    BridgeLink,
    BridgeTraffic,
    CanClaim,
    Fit,
    Identifiers,
    SimulatedDevice,
    World,
    WorldKind,
)
from msbot_bridges.canbus import check_address
from msbot_xrce.errors import ConfigError


def open_world(link: BridgeLink) -> World:
    """Make a world; the library is loaded here.

    Raises:
        ConfigError: the library is missing, or the address makes no sense.
    """
    try:
        from msbot_bridges.canbus.image_folder import ImageFolder
        from msbot_bridges.dronecan.dronecan_world import DronecanWorld
    except ModuleNotFoundError as error:
        raise _missing(error) from error
    check_address(link.address)
    folder = link.option("software")
    return DronecanWorld(link.address, ImageFolder(Path(folder)) if folder else None)


def _servo(link: BridgeLink, options: Mapping[str, Any]) -> SimulatedDevice:
    check_address(link.address)
    try:
        from msbot_bridges.dronecan.simulated_servo import SimulatedServo
    except ModuleNotFoundError as error:
        raise _missing(error) from error
    text = str(options.get("node", 42))
    if set(options) - {"node"} or not text.isdecimal() or not 1 <= int(text) <= 125:
        raise ConfigError("a simulated node takes --option node=N, from 1 to 125, and no other")
    return SimulatedServo(link.address, int(text))


def _missing(error: ModuleNotFoundError) -> ConfigError:
    return ConfigError(f"DroneCAN takes the library {error.name}: pip install 'msbot-bridges[dronecan]'")


def _fits() -> Sequence[Fit]:
    from msbot_bridges.dronecan.node_device import node_fits

    return node_fits()


CLAIM = CanClaim(
    (Identifiers("messages and services", 0, 0x1FFFFFFF, extended=True),),
    traffic=(
        BridgeTraffic("NodeStatus of the bridge", 0x1001557E, 8, 1, of_bridge=True),
        BridgeTraffic("NodeStatus", 0x1001552A, 8, 1),
        BridgeTraffic("reports, two frames each", 0x1003F32A, 8, 20),
        BridgeTraffic("orders", 0x0803F27E, 5, 10),
    ),
)
"""Priority, type and source may have any value. Nodes report and are told 10 times a second."""

WORLD = WorldKind(
    "DroneCAN servos, motor controllers, range finders, batteries, GNSS receivers",
    "socketcan:can0",
    open_world,
    options={"software": "a folder with images of new software for nodes"},
    simulated={"servo": _servo},
    fits=_fits,
    can=CLAIM,
    numbers={"servo": "org.msbot:simservo"},
)
