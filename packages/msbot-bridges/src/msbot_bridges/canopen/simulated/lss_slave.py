"""A device without a node id: the other side of layer setting services (LSS, CiA 305).

The library has no such side; its own master has found and configured this one in a test.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from typing import Final

import can
from msbot_bridges.canbus import FrameSender, open_bus
from msbot_bridges.canopen.lss import (
    ANSWER_ID,
    CONFIGURE_ID,
    FASTSCAN,
    IDENTIFIED,
    REQUEST_ID,
    STORE,
    SWITCH_GLOBAL,
    LssAddress,
)
from msbot_bridges.canopen.simulated.local_device import LocalDevice
from msbot_xrce.errors import LinkDown

WAIT_S: Final = 0.1
_ALL_BITS: Final = 0xFFFFFFFF
_ANYBODY: Final = 0x80
_SELECT, _SELECTED, _TELL_ADDRESS, _TELL_ID = 0x40, 0x44, 0x5A, 0x5E
_NO_ID: Final = 0xFF


class LssSlave:
    """Answers the questions of a master. Pure.

    Args:
        address: who it is.
    """

    def __init__(self, address: LssAddress) -> None:
        self.node_id: int | None = None
        self.is_stored = False
        self.is_started = False
        """It has got a node id, and was told to start with it."""
        self._address = address
        self._is_configured = False
        """It is the one that is being configured."""
        self._place = 0
        self._selected = 0

    def received(self, data: bytes) -> bytes | None:
        """The answer to a question; None: there is none."""
        number = int.from_bytes(data[1:5], "little")
        match data[0]:
            case command if command == FASTSCAN:
                return self._scan(number, *data[5:8])
            case command if command == SWITCH_GLOBAL:
                self._is_configured = bool(data[1])
                self.is_started = not data[1] and self.node_id is not None
            case command if _SELECT <= command < _SELECT + 4:
                return self._select(command - _SELECT, number)
            case command if not self._is_configured:
                return None
            case command if command == CONFIGURE_ID:
                is_right = 1 <= data[1] <= 127
                self.node_id = data[1] if is_right else self.node_id
                return _answer(command, 0 if is_right else 1)
            case command if command == STORE:
                self.is_stored = True
                return _answer(command, 0)
            case command if command == _TELL_ID:
                return _answer(command, self.node_id or _NO_ID)
            case command if _TELL_ADDRESS <= command < _TELL_ADDRESS + 4:
                return _answer(command, *self._address[command - _TELL_ADDRESS].to_bytes(4, "little"))
        return None

    def _scan(self, number: int, bit: int, place: int, following: int) -> bytes | None:
        if self.node_id is not None or self._is_configured:
            return None
        if bit == _ANYBODY:
            self._place = 0
            return _answer(IDENTIFIED)
        mask = _ALL_BITS << bit & _ALL_BITS
        if place != self._place or (self._address[place] ^ number) & mask:
            return None
        if bit == 0:
            self._place = following
            self._is_configured = following < place
        return _answer(IDENTIFIED)

    def _select(self, place: int, number: int) -> bytes | None:
        self._selected = self._selected + 1 if place == self._selected and self._address[place] == number else 0
        if self._selected < len(self._address):
            return None
        self._selected, self._is_configured = 0, True
        return _answer(_SELECTED)


class UnnumberedDevice:
    """A simulated device that waits for its node id, and then is what it is; it keeps the id until it ends.

    Args:
        address: `INTERFACE:CHANNEL[?bitrate=N]` of python-can.
        who: its LSS address.
        make: makes the device with a node id.
    """

    def __init__(self, address: str, who: LssAddress, make: Callable[[int], LocalDevice]) -> None:
        self.slave = LssSlave(who)
        self.device: LocalDevice | None = None
        self._address, self._make = address, make
        self._ended = threading.Event()

    async def run(self) -> None:
        """See `SimulatedDevice`."""
        running = asyncio.create_task(asyncio.to_thread(self.run_in_thread))
        try:
            await asyncio.wait([running])
        finally:
            self.end()
            await asyncio.gather(running, return_exceptions=True)
        running.result()

    def end(self) -> None:
        """Pull it off its bus."""
        self._ended.set()
        if self.device is not None:
            self.device.end()

    def run_in_thread(self) -> None:
        """Run until `end`.

        Raises:
            LinkDown: the bus cannot be opened, or has ended.
        """
        self._wait_for_id()
        if self.slave.is_started and self.slave.node_id is not None:
            self.device = self._make(self.slave.node_id)
            if not self._ended.is_set():
                self.device.run_in_thread()

    def _wait_for_id(self) -> None:
        bus = open_bus(self._address)
        sender = FrameSender(bus)
        try:
            while not (self._ended.is_set() or self.slave.is_started):
                message = bus.recv(WAIT_S)
                if message is None or message.is_extended_id or message.arbitration_id != REQUEST_ID:
                    continue
                if len(message.data) == 8 and (answer := self.slave.received(bytes(message.data))) is not None:
                    sender.send(can.Message(arbitration_id=ANSWER_ID, data=answer, is_extended_id=False))
        except can.CanError as error:
            raise LinkDown(f"{self._address}: {error}") from error
        finally:
            bus.shutdown()


def _answer(*octets: int) -> bytes:
    return bytes(octets).ljust(8, b"\0")
