"""The devices of tables, simulated with the library's server; what is driven shows in its `confirmed_by` at once."""

from __future__ import annotations

import asyncio

from pymodbus.constants import ExcCodes
from pymodbus.pdu.device import ModbusDeviceIdentification
from pymodbus.server import ModbusSerialServer, ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from msbot_bridges.modbus.address import LineAddress
from msbot_bridges.modbus.device_table import DeviceTable
from msbot_bridges.modbus.points import ModbusPoint, PointUse, RegisterTable, blocks
from msbot_xrce.errors import ConfigError


class SimulatedLine:
    """All devices of some tables at one address.

    Args:
        address: where they are.
        tables: which there are.
    """

    def __init__(self, address: LineAddress, tables: list[DeviceTable]) -> None:
        self._address = address
        self._table = tables[0] if len(tables) == 1 else None  # the library's server is one device for function 43
        self._devices = [_Device(unit, table) for table in tables for unit in table.units]

    async def run(self) -> None:
        """Run until cancelled.

        Raises:
            ConfigError: the address cannot be served.
        """
        devices = [one.made for one in self._devices]
        identity = _identification(self._table)
        address = self._address
        server: ModbusSerialServer | ModbusTcpServer
        if address.is_serial:
            server = ModbusSerialServer(
                devices,
                identity=identity,
                port=address.host,
                baudrate=address.baud,
                parity=address.parity,
                stopbits=address.stop_bits,
            )
        else:
            server = ModbusTcpServer(devices, identity=identity, address=(address.host, address.port))
        try:
            await server.serve_forever(background=True)
        except (RuntimeError, OSError) as error:
            raise ConfigError(f"{address.words} cannot be served: {error}") from error
        try:
            await asyncio.Event().wait()
        finally:
            await server.shutdown()  # type: ignore[no-untyped-call]  # the library has no types for it


def _identification(table: DeviceTable | None) -> ModbusDeviceIdentification | None:
    if table is None:
        return None
    told = {"VendorName": table.maker, "ProductCode": table.product, "MajorMinorRevision": "1.0"}
    return ModbusDeviceIdentification(info_name=told)  # type: ignore[no-untyped-call]


class _Device:
    """One unit: it holds its registers, and follows its orders."""

    def __init__(self, unit: int, table: DeviceTable) -> None:
        self._table = table
        registers: dict[tuple[RegisterTable, int], int] = {}
        for point in table.points:
            value = point.default if point.role is PointUse.SETTING else 0.0
            for at, word in enumerate(_words(point, value)):
                registers[point.table, point.address + at] = word
        self._registers = registers
        data: dict[RegisterTable, list[SimData]] = {kind: [] for kind in RegisterTable}
        serial = [] if table.serial is None else [table.serial]
        for block in blocks([*table.points, *serial]):
            words = [registers.get((block.table, block.address + at), unit) for at in range(block.count)]
            data[block.table].append(_data(block.table, block.address, words))
        for kind, found in data.items():
            if not found:  # none of the tables may be empty
                found.append(_data(kind, 0, [0]))
        self.made = SimDevice(
            unit,
            (
                data[RegisterTable.COIL],
                data[RegisterTable.DISCRETE],
                data[RegisterTable.HOLDING],
                data[RegisterTable.INPUT],
            ),
            action=self._asked,
        )

    async def _asked(  # noqa: PLR0917 - the library calls it so
        self,
        function: int,
        start: int,
        address: int,
        count: int,
        registers: list[int],
        values: list[int] | list[bool] | None,
    ) -> ExcCodes | None:
        kind = {
            1: RegisterTable.COIL, 5: RegisterTable.COIL, 15: RegisterTable.COIL, 2: RegisterTable.DISCRETE,
            3: RegisterTable.HOLDING, 6: RegisterTable.HOLDING, 16: RegisterTable.HOLDING, 4: RegisterTable.INPUT,
        }.get(function)  # fmt: skip
        if kind is None:
            return None
        if values is not None:
            for at, written in enumerate(values):
                self._registers[kind, address + at] = int(written)
            self._follow()
            return None
        if kind.is_bits:
            return None
        for at in range(count):
            if (word := self._registers.get((kind, address + at))) is not None:
                registers[address + at - start] = word
        return None

    def _follow(self) -> None:
        """What is driven shows at once in the point that confirms it."""
        points = {one.name: one for one in self._table.points}
        for driven in self._table.of_role(PointUse.IN):
            shown = points.get(driven.confirmed_by)
            if shown is not None:
                words = [self._registers[driven.table, driven.address + at] for at in range(driven.count)]
                for at, word in enumerate(_words(shown, driven.read(words))):
                    self._registers[shown.table, shown.address + at] = word


def _data(kind: RegisterTable, address: int, words: list[int]) -> SimData:
    if kind.is_bits:
        return SimData(address, values=[bool(word) for word in words], datatype=DataType.BITS)
    return SimData(address, values=words, datatype=DataType.REGISTERS)


def _words(point: ModbusPoint, value: float) -> list[int]:
    try:
        return point.write(value)
    except ConfigError:
        return [0] * point.count  # a range without what was meant
