"""A device whose ports are numbers in its PDOs: inputs and outputs (CiA 401), and what an EDS describes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Final

from msbot.part import Message
from msbot_bridges.bridge import DeviceOutput, ForeignDevice, Input
from msbot_bridges.canopen import objects
from msbot_bridges.canopen.canopen_device import CanopenDevice, NodeBus, SetUp, watch_each_other
from msbot_bridges.canopen.node_description import NodeDescription
from msbot_bridges.canopen.objects import Entry
from msbot_bridges.canopen.pdo_layout import PdoLayout, distribute
from msbot_bridges.canopen.port_mappings import PortMapping
from msbot_bridges.canopen.sdo_requests import SdoRequests

REPORT_MS: Final = 200
"""Inputs are sent when they change, and so often."""


class MappedDevice(CanopenDevice):
    """See `CanopenDevice`."""

    def __init__(self, description: NodeDescription, bus: NodeBus, news: Callable[[ForeignDevice], None]) -> None:
        super().__init__(description, bus, news)
        self._heard = description.heard
        self._told = {one.port: one for one in description.told}
        self.outputs = tuple(DeviceOutput(one.port, one.message) for one in self._heard)
        self.inputs = tuple(Input(one.port, one.message, safe=one.safe) for one in description.told)
        self._values = dict[Entry, int]()
        """What each of its outputs is to have."""
        self._stated = dict[str, Message]()
        """Safe values of ports that the robot has said, with this STOP or when it left them."""
        self._safe = self._safe_values()

    def _safe_values(self) -> dict[Entry, int]:
        """What STOP leaves its outputs with."""
        safe = dict[Entry, int]()
        for port, one in self._told.items():
            if (message := self._stated.get(port, one.safe)) is not None:
                safe[one.entry] = one.to_value(message, safe.get(one.entry, 0))
        return safe

    def configure(self, ask: SdoRequests) -> SetUp:
        """See `CanopenDevice`."""
        period = watch_each_other(ask)
        if self.description.reports or self.description.orders:
            return SetUp(self.description.reports, self.description.orders, period)
        heard, told = _entries(self._heard), _entries(self.description.told)
        if any(entry.index == objects.ANALOGUE_INPUTS for entry in heard):
            ask.write_if_there(objects.ANALOGUE_INTERRUPTS, 1)
        return SetUp(_map(ask, heard, is_sent=True), _map(ask, told, is_sent=False), period)

    def end(self) -> None:
        """See `ForeignDevice`."""
        self._stated.clear()
        super().end()

    def act(self, port: str, message: Message) -> None:
        """See `ForeignDevice`."""
        self._stated.pop(port, None)
        mapping = self._told[port]
        self._values[mapping.entry] = mapping.to_value(message, self._values.get(mapping.entry, 0))
        if self.is_operational and not self.is_stopping:
            self.order(self._values, mapping.entry)

    def rests_at(self, port: str, message: Message) -> None:
        """See `ForeignDevice`."""
        self.act(port, message)
        self._stated[port] = message

    def rest(self) -> None:
        """See `ForeignDevice`; each port has got its safe value."""

    def safe_is(self, port: str, message: Message) -> None:
        """See `ForeignDevice`: `stop` writes it, and waits until it is read back."""
        self._stated[port] = message

    def stop(self) -> None:
        """See `ForeignDevice`."""
        self._safe = self._safe_values()
        super().stop()

    def go(self) -> None:
        """See `ForeignDevice`."""
        self._stated.clear()
        super().go()

    def still_entries(self) -> Sequence[Entry]:
        """See `CanopenDevice`."""
        return list(self._safe)

    def tell_still(self) -> None:
        """See `CanopenDevice`."""
        self._values |= self._safe
        for entry, value in self._safe.items():
            if self.is_operational:
                self.order(self._values, entry, urgent=True)
            else:
                self._bus.write(self, entry, value, urgent=True)
        if not self._safe:
            self.confirm_still()

    @property
    def not_still(self) -> str:
        """See `CanopenDevice`."""
        return "that its outputs have their safe values"

    def started(self) -> None:
        """See `CanopenDevice`."""
        for entry in self._values:
            self.order(self._values, entry)

    def told(self, values: Mapping[Entry, int], *, is_answer: bool = False) -> None:
        """See `CanopenDevice`."""
        for mapping in self._heard:
            if (value := values.get(mapping.entry)) is None:
                continue
            if (message := mapping.to_message(value)) is not None:
                self.report(mapping.port, message)
        if is_answer and self._safe and all(values.get(entry) == safe for entry, safe in self._safe.items()):
            self.confirm_still()


def _entries(mappings: Sequence[PortMapping]) -> list[Entry]:
    return list(dict.fromkeys(one.entry for one in mappings))


def _map(ask: SdoRequests, entries: Sequence[Entry], *, is_sent: bool) -> tuple[PdoLayout, ...]:
    """As CiA 401 has it by default: bits in the first PDO, analogue values in the others."""
    bits, levels = ([one for one in entries if (one.bits == 8) is is_bits] for is_bits in (True, False))
    pdos = [(1, group) for group in distribute(bits, 1)] + list(enumerate(distribute(levels, 3), 2))
    return tuple(ask.map_pdo(number, group, is_sent=is_sent, event_ms=REPORT_MS) for number, group in pdos)
