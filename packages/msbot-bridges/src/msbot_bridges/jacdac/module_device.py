"""One module as a device: its services are ports, and it has stopped when its registers say so."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

from msbot.part import Message
from msbot_bridges.bridge import DeviceIdentity, DeviceOutput, DeviceSetting, ForeignDevice, Input, Report
from msbot_bridges.bridge.contract import Value
from msbot_bridges.jacdac.frames import GET, Packet
from msbot_bridges.jacdac.jacdac_bus import Module, Register
from msbot_bridges.jacdac.services import (
    DESCRIPTION,
    FIRMWARE,
    IDENTIFY,
    PRODUCT,
    READING,
    U32,
    Actuator,
    Sensor,
    ServiceSetting,
)


class ModuleDevice(ForeignDevice):
    """A module.

    Args:
        module: as the bus knows it.
        wake: called when there is something to send.
        news: called when it has reported something that decides whether it has stopped.
    """

    def __init__(self, module: Module, wake: Callable[[], None], news: Callable[[ForeignDevice], None]) -> None:
        self.module = module
        self.identity = identity_of(module)
        self._wake, self._news = wake, news
        self._report: Report | None = None
        self._sensors: dict[int, tuple[str, Sensor]] = {}
        self._actuators: dict[str, tuple[int, Actuator]] = {}
        self._settings: dict[str, tuple[int, ServiceSetting]] = {}
        self._is_stopping = False
        self._unconfirmed: dict[Register, bytes] = {}
        self._safe: dict[str, Message] = {}
        """What STOP, or a partner that is gone, leaves ports with, where the robot says another value than the module's
        own."""
        self._name_ports()
        self.outputs = [DeviceOutput(name, sensor.message) for name, sensor in self._sensors.values()]
        self.inputs = [
            Input(name, actuator.message, actuator.safe, actuator.ranges(module.registers(index)), actuator.stops_by)
            for name, (index, actuator) in self._actuators.items()
        ]
        self.settings = [
            DeviceSetting(name, one.kind, one.kind(one.default), one.least, one.most, one.unit)
            for name, (_, one) in self._settings.items()
        ]

    def _name_ports(self) -> None:
        taken = dict[str, int]()
        for index, service in self.module.services():
            number = taken[service.name] = taken.get(service.name, 0) + 1
            port = service.name if number == 1 else f"{service.name}{number}"
            if isinstance(service, Sensor):
                self._sensors[index] = port, service
            else:
                self._actuators[port] = index, service
            for setting in service.settings:
                self._settings[f"{port}_{setting.name}"] = index, setting

    def begin(self, report: Report) -> None:
        """See `ForeignDevice`."""
        self._report = report
        self.module.start_streaming(time.monotonic())
        self._wake()

    def end(self) -> None:
        """See `ForeignDevice`."""
        self._report = None
        self.module.release()
        self.go()

    def act(self, port: str, message: Message) -> None:
        """See `ForeignDevice`."""
        if self._is_stopping:
            return
        index, actuator = self._actuators[port]
        self.module.keep(index, actuator.write(message, self.module.registers(index)))
        if (order := actuator.tell(message)) is not None:
            self.module.send_once(Packet(index, *order))
        self._wake()

    def set(self, name: str, value: Value) -> None:
        """See `ForeignDevice`."""
        index, setting = self._settings[name]
        self.module.keep(index, {setting.register: setting.form.write(float(value) / setting.scale)})
        self._wake()

    def safe_is(self, port: str, message: Message) -> None:
        """See `ForeignDevice`: `stop` writes it, and waits for it."""
        actuator = self._actuators[port][1]
        if message == actuator.safe or actuator.stops_by:
            self._safe.pop(port, None)  # the module's own way to be safe
        else:
            self._safe[port] = message

    def rests_at(self, port: str, message: Message) -> None:
        """See `ForeignDevice`."""
        self.safe_is(port, message)
        if not self._actuators[port][1].stops_without_power:
            self.act(port, message)

    def rest(self) -> None:
        """See `ForeignDevice`: lamps and switches have got their safe values."""
        for port, (index, actuator) in self._actuators.items():
            if actuator.stops_without_power:
                self.module.keep(index, self._safe_registers(port))
        self._safe = {}
        self.module.write_at_once()
        self._wake()

    def leave(self) -> None:
        """See `ForeignDevice`: as at STOP, its registers say that it is safe."""
        self.stop()

    def _safe_registers(self, port: str) -> Mapping[int, bytes]:
        index, actuator = self._actuators[port]
        known, safe = self.module.registers(index), self._safe.get(port)
        return actuator.stop(known) if safe is None else actuator.write(safe, known)

    def stop(self) -> None:
        """See `ForeignDevice`."""
        if not self._is_stopping:
            self._is_stopping = True
            self._unconfirmed = {}
            for port, (index, _) in self._actuators.items():
                registers = self._safe_registers(port)
                self.module.keep(index, registers)
                self._unconfirmed |= {(index, register): data for register, data in registers.items()}
        self.module.write_at_once()
        self.module.send_once(*(Packet(index, GET | register) for index, register in self._unconfirmed))
        self._wake()

    def go(self) -> None:
        """See `ForeignDevice`."""
        self._is_stopping = False
        self._unconfirmed = {}
        self._safe = {}

    @property
    def not_stopped(self) -> str:
        """See `ForeignDevice`."""
        for port, (index, actuator) in self._actuators.items():
            if any(service == index for service, _ in self._unconfirmed):
                what = "its safe value" if port in self._safe else actuator.stopped
                return f"{port} has not reported {what}"
        return ""

    def identify(self) -> None:
        """See `ForeignDevice`."""
        self.module.send_once(Packet(0, IDENTIFY))
        self._wake()

    def heard(self, service: int, register: int | None, event: int, data: bytes) -> None:
        """It has reported a register, or an event when that is None."""
        if register is not None and self._unconfirmed.get((service, register)) == data:
            del self._unconfirmed[(service, register)]
            if not self._unconfirmed:
                self._news(self)
        if self._report is None or service not in self._sensors:
            return
        port, sensor = self._sensors[service]
        if register == READING and data:
            self._report(port, sensor.read(data, self.module.registers(service)))
        elif register is None and event in sensor.events:
            self._report(port, sensor.events[event])


def identity_of(module: Module) -> DeviceIdentity:
    """Who a module is: its services, and its maker's number of the product where it says one."""
    services = [service for _, service in module.services()]
    product = "-".join(dict.fromkeys(service.words.replace(" ", "_") for service in services))
    if number := int(U32.read(module.known.get((0, PRODUCT), b""))):
        product = f"{product}-{number:08x}"
    words = module.text(DESCRIPTION) or "module of " + ", ".join(service.words for service in services)
    device = module.device[::-1].hex()
    return DeviceIdentity("jacdac", product, module.device, f"Jacdac {words}", device, software=module.text(FIRMWARE))
