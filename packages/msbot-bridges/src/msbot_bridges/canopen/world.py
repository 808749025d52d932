"""The world of CANopen: finds nodes by heartbeat, boot-up and SDO; is the master of their NMT states."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from msbot_bridges.bridge import (
    BridgeLink,
    BridgeTraffic,
    CanClaim,
    DeviceChange,
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
        ConfigError: the library is missing, or address or options make no sense.
    """
    check_address(link.address)
    try:
        from msbot_bridges.canopen.canopen_world import CanopenWorld
        from msbot_bridges.canopen.eds_folder import EdsFolder
    except ModuleNotFoundError as error:
        raise _missing(error) from error
    folder, lss = link.option("eds"), link.option("lss", "yes")
    if lss not in ("yes", "no"):
        raise ConfigError(f"--option lss={lss}: write yes or no")
    return CanopenWorld(link.address, EdsFolder(Path(folder) if folder else None), gives_ids=lss == "yes")


def _change_bit_rate(link: BridgeLink, bit_rate: int) -> DeviceChange:
    check_address(link.address)
    try:
        from msbot_bridges.canopen.bit_rate_change import BitRateChange
    except ModuleNotFoundError as error:
        raise _missing(error) from error
    return BitRateChange(link.address, bit_rate)


def _drive(link: BridgeLink, options: Mapping[str, Any]) -> SimulatedDevice:
    return _simulated(link, options, "drive", 5)


def _io(link: BridgeLink, options: Mapping[str, Any]) -> SimulatedDevice:
    return _simulated(link, options, "io", 6)


def _simulated(link: BridgeLink, options: Mapping[str, Any], name: str, otherwise: int) -> SimulatedDevice:
    check_address(link.address)
    node, serial = (str(options.get(one, "")) for one in ("node", "serial"))
    is_right = node in ("", "none") or (node.isdecimal() and 1 <= int(node) <= 126)
    if set(options) - {"node", "serial"} or not is_right or not (serial or "1").isdecimal():
        raise ConfigError(
            "a simulated node takes --option node=N, from 1 to 126, or none for one without a node id, and "
            "--option serial=N; no other"
        )
    try:
        from msbot_bridges.canopen.simulated.drive import SimulatedDrive
        from msbot_bridges.canopen.simulated.io_module import SimulatedIo
        from msbot_bridges.canopen.simulated.unnumbered_device import UnnumberedDevice
    except ModuleNotFoundError as error:
        raise _missing(error) from error
    kind = SimulatedDrive if name == "drive" else SimulatedIo
    if node == "none":
        number = int(serial or 1)
        who = kind(link.address, 1, number).lss_address
        return UnnumberedDevice(link.address, who, lambda given: kind(link.address, given, number))
    return kind(link.address, int(node or otherwise), int(serial) if serial else None)


def _missing(error: ModuleNotFoundError) -> ConfigError:
    return ConfigError(f"CANopen takes the library {error.name}: pip install 'msbot-bridges[canopen]'")


def _fits() -> Sequence[Fit]:
    from msbot_bridges.canopen.port_mappings import mapping_fits

    return mapping_fits()


CLAIM = CanClaim(
    (
        Identifiers("NMT", 0x000, 0x000),
        Identifiers("SYNC and EMCY", 0x080, 0x0FF),
        Identifiers("TIME", 0x100, 0x100),
        Identifiers("PDOs", 0x180, 0x57F),
        Identifiers("SDO", 0x580, 0x67F),
        Identifiers("heartbeat", 0x700, 0x77F),
        Identifiers("LSS", 0x7E4, 0x7E5),
    ),
    (10_000, 20_000, 50_000, 100_000, 125_000, 250_000, 500_000, 800_000, 1_000_000),
    traffic=(
        BridgeTraffic("heartbeat of the bridge", 0x77F, 1, 4, of_bridge=True),
        BridgeTraffic("search for nodes", 0x605, 8, 12.5, of_bridge=True),
        BridgeTraffic("heartbeat", 0x705, 1, 4),
        BridgeTraffic("reports", 0x185, 8, 15),
        BridgeTraffic("orders", 0x305, 8, 8),
    ),
)
"""By the predefined connection set of CiA 301. The traffic is the mean of a simulated drive and a module, as measured;
all node ids are searched each 10 s."""

WORLD = WorldKind(
    "CANopen drives (CiA 402), inputs and outputs (CiA 401), devices with an EDS",
    "socketcan:can0?bitrate=500000",
    open_world,
    options={"eds": "a folder with EDS files", "lss": "yes or no: give node ids to devices that have none"},
    simulated={"drive": _drive, "io": _io},
    fits=_fits,
    can=CLAIM,
    change_bit_rate=_change_bit_rate,
    numbers={"drive": "vendor-0x4d53:SimDrive", "io": "vendor-0x4d53:SimIO"},
)
