"""One Modbus device in a robot.

STOP writes the safe values and reads them back. Where the table names a point that shows what the device really does
(`confirmed_by`: the turns of a motor), that one must show it, too: a register that holds 0 says only that the order has
come. Until then the safe values are written again and again.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from msbot.part import Message
from msbot_bridges.bridge import (
    DeviceIdentity,
    DeviceOutput,
    DeviceSetting,
    ForeignDevice,
    Input,
    Report,
    Value,
)
from msbot_bridges.modbus.device_table import DeviceTable
from msbot_bridges.modbus.points import ModbusPoint, PointUse


class ModbusDevice(ForeignDevice):
    """A device.

    Args:
        identity: who it is.
        table: its registers.
        write: has a point written; True: it is STOP.
        news: called when something has become known about STOP or a fault.
    """

    def __init__(
        self,
        identity: DeviceIdentity,
        table: DeviceTable,
        *,
        write: Callable[[ModbusPoint, float, bool], None],
        news: Callable[[ForeignDevice], None],
    ) -> None:
        self.identity = identity
        self.table = table
        self.outputs = tuple(DeviceOutput(one.name, one.message) for one in table.of_role(PointUse.OUT))
        self.inputs = tuple(
            Input(one.name, one.message, None if one.safe is None else one.message_of(one.safe), one.ranges)
            for one in table.of_role(PointUse.IN)
        )
        self.settings = tuple(_setting(one) for one in table.of_role(PointUse.SETTING))
        self._write, self._news = write, news
        self._points: Mapping[str, ModbusPoint] = {one.name: one for one in table.points}
        self._report: Report | None = None
        self._is_stopping = False
        self._safe = {one.name: one.safe for one in table.of_role(PointUse.IN) if one.safe is not None}
        """Points and their safe values: those of the table, or of the robot."""
        self._unconfirmed = set[str]()
        """Points that must still be read with their safe value."""
        self._written = set[str]()
        """Points whose safe value has been written since STOP: only what is read after that counts."""
        self._fault = ""

    def begin(self, report: Report) -> None:
        """See `ForeignDevice`."""
        self._report = report

    def end(self) -> None:
        """See `ForeignDevice`."""
        self._report = None
        self.go()

    def act(self, port: str, message: Message) -> None:
        """See `ForeignDevice`."""
        if not self._is_stopping:
            point = self._points[port]
            self._write(point, point.value_of(message), False)

    def set(self, name: str, value: Value) -> None:
        """See `ForeignDevice`."""
        self._write(self._points[name], float(value), False)

    def safe_is(self, port: str, message: Message) -> None:
        """See `ForeignDevice`: `stop` writes it, and waits for it."""
        self._safe[port] = self._points[port].value_of(message)

    def rests_at(self, port: str, message: Message) -> None:
        """See `ForeignDevice`."""
        self.safe_is(port, message)
        self.act(port, message)

    def stop(self) -> None:
        """See `ForeignDevice`."""
        driven = self.table.of_role(PointUse.IN)
        if not self._is_stopping:
            self._is_stopping = True
            self._written.clear()
            self._unconfirmed = {one.name for one in driven} | {one.confirmed_by for one in driven if one.confirmed_by}
        for point in driven:
            if point.name in self._unconfirmed or point.confirmed_by in self._unconfirmed:
                self._write(point, self._safe[point.name], True)

    def rest(self) -> None:
        """See `ForeignDevice`: the ports have got their safe values."""

    def leave(self) -> None:
        """See `ForeignDevice`: as at STOP, its safe values are read back."""
        self.stop()

    def go(self) -> None:
        """See `ForeignDevice`."""
        self._is_stopping = False
        self._unconfirmed.clear()

    @property
    def not_stopped(self) -> str:
        """See `ForeignDevice`."""
        if not self._unconfirmed:
            return ""
        return f"{self.identity.where} has not been read with the safe value of {', '.join(sorted(self._unconfirmed))}"

    @property
    def fault(self) -> str:
        """See `ForeignDevice`."""
        return self._fault

    def failed(self, why: str) -> None:
        """A request was refused, so that the table does not fit the device; empty: it is answered again."""
        if why != self._fault:
            self._fault = why
            self._news(self)

    def was_written(self, point: ModbusPoint, value: float) -> None:
        """The device has taken a value."""
        if self._is_stopping and value == self._safe.get(point.name):
            self._written.add(point.name)

    def read(self, point: ModbusPoint, value: float) -> None:
        """A point was read."""
        if self._report is not None and point.role is PointUse.OUT and (message := point.message_of(value)) is not None:
            self._report(point.name, message)
        if self._is_stopping:
            self._judge(point, value)

    def _judge(self, point: ModbusPoint, value: float) -> None:
        was_waiting = bool(self._unconfirmed)
        for driven in self.table.of_role(PointUse.IN):
            if point.name not in (driven.name, driven.confirmed_by) or driven.name not in self._written:
                continue
            safe = self._safe[driven.name]
            if point.is_at(value, safe):
                self._unconfirmed.discard(point.name)
            elif point.name not in self._unconfirmed:
                self._unconfirmed.add(point.name)  # somebody else has written it: it is written again
                self._write(driven, safe, True)
        if was_waiting and not self._unconfirmed:
            self._news(self)


def _setting(point: ModbusPoint) -> DeviceSetting:
    if point.table.is_bits:
        return DeviceSetting(point.name, bool, point.default != 0.0)
    return DeviceSetting(point.name, float, point.default, point.least, point.most, point.unit)
