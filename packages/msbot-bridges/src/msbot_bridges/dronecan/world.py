"""The world of DroneCAN: finds nodes, and is the allocator of their node ids."""

from __future__ import annotations

from msbot_bridges.bridge import BridgeLink, World, WorldKind
from msbot_bridges.canbus import check_address
from msbot_xrce.errors import ConfigError


def open_world(link: BridgeLink) -> World:
    """Make a world; the library is loaded here.

    Raises:
        ConfigError: the library is missing, or the address makes no sense.
    """
    try:
        from msbot_bridges.dronecan.dronecan_world import DronecanWorld
    except ModuleNotFoundError as error:
        raise ConfigError(f"DroneCAN takes the library {error.name}: pip install 'msbot-bridges[dronecan]'") from error
    check_address(link.address)
    return DronecanWorld(link.address)


WORLD = WorldKind("DroneCAN servos, motor controllers, range finders, batteries", "socketcan:can0", open_world)
