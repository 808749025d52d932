"""The devices of one line or gateway, polled one after the other; an order goes before the next poll, STOP before all.

A line has one request at a time. A device that answers is there; one that does not answer several requests in a row is
lost, and is asked again now and then.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable
from typing import Any

from pymodbus.client import AsyncModbusSerialClient, AsyncModbusTcpClient
from pymodbus.client.base import ModbusBaseClient
from pymodbus.exceptions import ModbusException
from pymodbus.framer import FramerType

from msbot_bridges.bridge import DeviceIdentity, World, WorldHost
from msbot_bridges.modbus.address import LineAddress
from msbot_bridges.modbus.device_table import DeviceTable
from msbot_bridges.modbus.modbus_device import ModbusDevice
from msbot_bridges.modbus.points import Block, ModbusPoint, PointUse, RegisterTable, blocks
from msbot_xrce.errors import ConfigError, LinkDown
from msbot_xrce.lazy import dataclass

ANSWER_S = 0.5
"""Longest wait for an answer."""
SEEK_S = 2.0
"""Period in which a device that is not there is asked again."""
MOST_ORDERS = 1000
_REFUSED = {
    1: "it does not have this function",
    2: "it has no such address",
    3: "it does not take such a value",
    4: "it has failed",
    6: "it is busy",
    10: "the gateway has no way to it",
    11: "the gateway gets no answer from it",
}
_NOT_THERE = (10, 11)
"""A gateway answers in place of a device that does not."""
_log = logging.getLogger("msbot.part")
logging.getLogger("pymodbus").setLevel(logging.CRITICAL)  # what is wrong is told by sentences of our own


class _NoAnswer(Exception):
    """Nothing has come in time."""


class _Refused(Exception):
    """The device does not do it."""


@dataclass(slots=True)
class _Place:
    """One address of the line at which a device may be."""

    unit: int
    table: DeviceTable
    due: float = 0.0
    missed: int = 0
    device: ModbusDevice | None = None


class ModbusWorld(World):
    """All devices of one line.

    Args:
        address: where it is.
        tables: which devices it may have.
    """

    def __init__(self, address: LineAddress, tables: list[DeviceTable]) -> None:
        self._address = address
        self._places = [_Place(unit, table) for table in tables for unit in table.units]
        self._orders: dict[tuple[int, str], tuple[_Place, ModbusPoint, float]] = {}
        """Values that wait to be written, the newest for each point."""
        self._urgent: dict[tuple[int, str], tuple[_Place, ModbusPoint, float]] = {}
        self._ordered = asyncio.Event()
        self._rotation = 0

    async def run(self, host: WorldHost) -> None:
        """See `World`."""
        self._host, self._clock = host, asyncio.get_running_loop().time
        self._client = _client(self._address)
        try:
            if not await self._connected():
                raise LinkDown(f"{self._address.words} cannot be opened")
            while True:
                await self._turn()
        finally:
            try:
                await self._write_urgent()  # parts that end make their devices safe
            finally:
                self._client.close()

    async def _connected(self) -> bool:
        try:
            return await self._client.connect()
        except Exception as error:  # the library of a serial port may raise anything
            raise LinkDown(f"{self._address.words} cannot be opened: {error}") from error

    async def _turn(self) -> None:
        """Orders, then the poll that is due, then a wait for whichever comes first."""
        if not self._client.connected and not await self._reconnected():
            return
        await self._write_urgent()
        await self._write_one()
        await self._write_urgent()
        now = self._clock()
        due = min(self._places, key=lambda one: one.due)
        if due.due <= now:
            await self._visit(due)
        elif not self._orders and not self._urgent:
            self._ordered.clear()
            try:
                async with asyncio.timeout(due.due - now):
                    await self._ordered.wait()
            except TimeoutError:
                return

    async def _reconnected(self) -> bool:
        """The line has gone: all devices are lost until it is there again."""
        for place in self._places:
            self._lose(place, f"{self._address.words} is gone")
        self._orders.clear()
        self._urgent.clear()
        await asyncio.sleep(SEEK_S)
        try:
            return await self._client.connect()
        except Exception as error:  # as above
            _log.debug("%s: %s", self._address.words, error)
            return False

    # One device

    async def _visit(self, place: _Place) -> None:
        place.due = self._clock() + place.table.poll_s
        try:
            if place.device is None:
                await self._seek(place)
            else:
                await self._poll(place, place.device)
        except _NoAnswer:
            place.missed += 1
            if place.device is None:
                place.due = self._clock() + SEEK_S
            elif place.missed >= place.table.lost_after:
                self._lose(place, f"unit {place.unit} has not answered {place.missed} times")
        except _Refused as error:
            place.missed = 0
            if place.device is not None:
                place.device.failed(f"{error}: the table does not fit this device")
            else:
                self._host.say(f"unit {place.unit}: {error}: the table {place.table.product} does not fit")
                place.due = self._clock() + SEEK_S
        else:
            place.missed = 0

    async def _seek(self, place: _Place) -> None:
        """Read all once: a device that answers everything is there."""
        for block in blocks(place.table.points):
            await self._read(place.unit, block)
        told = await self._identification(place.unit)
        number = await self._serial(place)
        place.device = ModbusDevice(
            _identity(self._address, place, told, number),
            place.table,
            write=lambda point, value, is_urgent: self._order(place, point, value, is_urgent),
            news=self._host.news,
        )
        self._host.found(place.device)

    async def _identification(self, unit: int) -> dict[int, str]:
        """What function 43 says; devices without it refuse it, or do not answer."""
        try:
            answer = await self._ask(lambda: self._client.read_device_information(read_code=1, device_id=unit))
        except (_Refused, _NoAnswer):
            return {}
        told = getattr(answer, "information", {})
        return {
            key: value.decode(errors="replace").strip()
            for key, value in told.items()
            if isinstance(value, bytes) and isinstance(key, int)
        }

    async def _serial(self, place: _Place) -> str:
        point = place.table.serial
        if point is None:
            return ""
        (block,) = blocks([point])
        return " ".join(f"{word:04x}" for word in await self._read(place.unit, block))

    async def _poll(self, place: _Place, device: ModbusDevice) -> None:
        wanted = [one for one in place.table.points if one.role is not PointUse.SETTING]
        for block in blocks(wanted):
            values = await self._read(place.unit, block)
            if place.device is not device:
                return
            for point in block.points:
                at = point.address - block.address
                device.read(point, point.read(values[at : at + point.count]))
            await self._write_urgent()
        device.failed("")

    def _lose(self, place: _Place, why: str) -> None:
        device, place.device, place.missed = place.device, None, 0
        for orders in (self._orders, self._urgent):
            for key in [key for key in orders if key[0] == place.unit]:
                del orders[key]
        if device is not None:
            self._host.lost(device, why)

    # Orders

    def _order(self, place: _Place, point: ModbusPoint, value: float, is_urgent: bool) -> None:
        key = (place.unit, point.name)
        self._orders.pop(key, None)  # what came before it must not come after it
        orders = self._urgent if is_urgent else self._orders
        if key not in orders and len(orders) >= MOST_ORDERS:
            orders.pop(next(iter(orders)))
        orders[key] = (place, point, value)
        self._ordered.set()

    async def _write_urgent(self) -> None:
        while self._urgent and self._client.connected:
            await self._write(*self._urgent.pop(next(iter(self._urgent))))

    async def _write_one(self) -> None:
        if self._orders:
            await self._write(*self._orders.pop(next(iter(self._orders))))

    async def _write(self, place: _Place, point: ModbusPoint, value: float) -> None:
        try:
            words = point.write(value)
        except ConfigError as error:
            self._host.say(f"unit {place.unit}: {error}")
            return
        client, unit, address = self._client, place.unit, point.address
        if point.table is RegisterTable.COIL:
            asking = lambda: client.write_coil(address, bool(words[0]), device_id=unit)  # noqa: E731
        elif len(words) == 1:
            asking = lambda: client.write_register(address, words[0], device_id=unit)  # noqa: E731
        else:
            asking = lambda: client.write_registers(address, words, device_id=unit)  # noqa: E731
        try:
            await self._ask(asking)
            if place.device is not None:
                place.device.was_written(point, value)
        except _NoAnswer:
            place.missed += 1  # its next poll decides whether it is lost
        except _Refused as error:
            if place.device is not None:
                place.device.failed(f"{point.name} cannot be written: {error}")

    # Requests

    async def _read(self, unit: int, block: Block) -> list[int]:
        client, address, count = self._client, block.address, block.count
        asking: Callable[[], Awaitable[Any]] = {
            RegisterTable.COIL: lambda: client.read_coils(address, count=count, device_id=unit),
            RegisterTable.DISCRETE: lambda: client.read_discrete_inputs(address, count=count, device_id=unit),
            RegisterTable.INPUT: lambda: client.read_input_registers(address, count=count, device_id=unit),
            RegisterTable.HOLDING: lambda: client.read_holding_registers(address, count=count, device_id=unit),
        }[block.table]
        try:
            answer = await self._ask(asking)
        except _Refused as error:
            raise _Refused(f"{block.table.value} {address} to {address + count - 1}: {error}") from None
        values = answer.bits if block.table.is_bits else answer.registers
        if len(values) < count:
            raise _NoAnswer
        return [int(one) for one in values[:count]]

    async def _ask(self, asking: Callable[[], Awaitable[Any]]) -> Any:  # noqa: ANN401 - an answer of the library
        try:
            answer = await asking()
        except (ModbusException, OSError) as error:
            raise _NoAnswer from error
        if answer.isError():
            code = getattr(answer, "exception_code", 0)
            if code in _NOT_THERE:
                raise _NoAnswer
            raise _Refused(_REFUSED.get(code, f"it answers with exception {code}"))
        return answer


def _identity(address: LineAddress, place: _Place, told: dict[int, str], number: str) -> DeviceIdentity:
    """Who a device is: what it says itself, else what its table says. Without a number of its own its place counts."""
    table = place.table
    maker, product = told.get(0) or table.maker, told.get(1) or table.product
    return DeviceIdentity(
        maker,
        product,
        (number or f"{address.words} {place.unit}").encode(),
        table.words or f"{product} of {maker}",
        f"unit {place.unit}",
        software=told.get(2, ""),
    )


def _client(address: LineAddress) -> ModbusBaseClient:
    """A client that does not connect again by itself: the world does, and says so."""
    if address.is_serial:
        return AsyncModbusSerialClient(
            address.host,
            baudrate=address.baud,
            parity=address.parity,
            stopbits=address.stop_bits,
            timeout=ANSWER_S,
            retries=0,
            reconnect_delay=0,
        )
    framer = FramerType.RTU if address.is_rtu else FramerType.SOCKET
    return AsyncModbusTcpClient(
        address.host, port=address.port, framer=framer, timeout=ANSWER_S, retries=0, reconnect_delay=0
    )
