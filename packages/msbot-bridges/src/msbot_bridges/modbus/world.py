"""The world of Modbus: a line or a gateway, and tables that say what its registers are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from msbot_bridges.bridge import BridgeLink, Fit, SimulatedDevice, World, WorldKind
from msbot_bridges.modbus.address import read_address
from msbot_bridges.modbus.device_table import DeviceTable, read_device_table
from msbot_xrce.errors import ConfigError

MOST_PLACES = 120


def _missing(error: ModuleNotFoundError) -> ConfigError:
    return ConfigError(f"Modbus takes the library {error.name}: pip install 'msbot-bridges[modbus]'")


def tables_of(link: BridgeLink) -> list[DeviceTable]:
    """The tables that the option names.

    Raises:
        ConfigError: there is none, it has a mistake, or two of them are for the same unit.
    """
    files = [one.strip() for one in link.option("table").split(",") if one.strip()]
    if not files:
        raise ConfigError("say what the registers are: --option table=pump.toml (several: a.toml,b.toml)")
    tables = [read_device_table(Path(file)) for file in files]
    units = [unit for table in tables for unit in table.units]
    twice = sorted({unit for unit in units if units.count(unit) > 1})
    if twice:
        raise ConfigError(f"--option table={','.join(files)}: unit {twice[0]} is in two places; name each unit once")
    if len(units) > MOST_PLACES:
        raise ConfigError(f"--option table={','.join(files)}: {len(units)} units; a bridge has at most {MOST_PLACES}")
    return tables


def open_world(link: BridgeLink) -> World:
    """Make a world; the library is loaded here.

    Raises:
        ConfigError: the library is missing, or address or table make no sense.
    """
    address, tables = read_address(link.address), tables_of(link)
    try:
        from msbot_bridges.modbus.modbus_world import ModbusWorld
    except ModuleNotFoundError as error:
        raise _missing(error) from error
    return ModbusWorld(address, tables)


def _simulated(link: BridgeLink, options: Mapping[str, Any]) -> SimulatedDevice:  # noqa: ARG001 - the link has them
    address, tables = read_address(link.address), tables_of(link)
    try:
        from msbot_bridges.modbus.simulated import SimulatedLine
    except ModuleNotFoundError as error:
        raise _missing(error) from error
    return SimulatedLine(address, tables)


def _fits() -> Sequence[Fit]:
    from msbot_bridges.modbus.points import register_fits

    return register_fits()


WORLD = WorldKind(
    "Modbus RTU and TCP: registers that a table names",
    "tcp:192.168.1.20",
    open_world,
    {"table": "the TOML file that says what the registers are; several: a.toml,b.toml"},
    {"devices": _simulated},
    _fits,
)
