"""The world of Cyphal: finds nodes, gives them node ids and their ports subjects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.util import find_spec
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
    """Make a world; the library is loaded when it runs.

    Raises:
        ConfigError: the library is missing, or the address makes no sense.
    """
    _check(link)
    from msbot_bridges.canbus.image_folder import ImageFolder
    from msbot_bridges.cyphal.cyphal_world import CyphalWorld

    folder = link.option("software")
    return CyphalWorld(link.address, ImageFolder(Path(folder)) if folder else None)


def _simulated(kind: str, node_id: int, link: BridgeLink, options: Mapping[str, Any]) -> SimulatedDevice:
    _check(link)
    text = str(options.get("node", node_id))
    if set(options) - {"node"} or not text.isdecimal() or not 0 <= int(text) <= 124:
        raise ConfigError("a simulated node takes --option node=N, from 1 to 124, or 0: it asks for one; and no other")
    from msbot_bridges.cyphal.simulated.device import SimulatedCyphalDevice

    return SimulatedCyphalDevice(kind, link.address, int(text))


def _range(link: BridgeLink, options: Mapping[str, Any]) -> SimulatedDevice:
    return _simulated("range", 43, link, options)


def _servo(link: BridgeLink, options: Mapping[str, Any]) -> SimulatedDevice:
    return _simulated("servo", 44, link, options)


def _check(link: BridgeLink) -> None:
    for library in ("pycyphal", "can"):
        if find_spec(library) is None:
            raise ConfigError(f"Cyphal takes the library {library}: pip install 'msbot-bridges[cyphal]'")
    check_address(link.address, may_be_fd=True)


def _fits() -> Sequence[Fit]:
    from msbot_bridges.cyphal.port_types import port_fits

    return port_fits()


CLAIM = CanClaim(
    (Identifiers("messages and services", 0, 0x1FFFFFFF, extended=True),),
    traffic=(
        BridgeTraffic("heartbeat of the bridge", 0x107D557D, 8, 1, of_bridge=True),
        BridgeTraffic("heartbeat", 0x107D552B, 8, 1),
        BridgeTraffic("reports, two frames each", 0x1068002B, 8, 20),
        BridgeTraffic("orders", 0x1068017D, 8, 20),
    ),
)
"""Priority, subject and source may have any value. Nodes report and are told 10 times a second."""

WORLD = WorldKind(
    "Cyphal sensors, servos, batteries, by their registers",
    "socketcan:can0",
    open_world,
    options={"software": "a folder with images of new software for nodes"},
    simulated={"range": _range, "servo": _servo},
    numbers={"range": "org.msbot:simrange", "servo": "org.msbot:simcyphalservo"},
    fits=_fits,
    can=CLAIM,
)
