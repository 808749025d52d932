"""A simulated device without a node id: it waits until it gets one by LSS, and then is what it is."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import can
from msbot_bridges.bridge import ThreadedDevice
from msbot_bridges.canbus import FrameSender, open_bus
from msbot_bridges.canopen.lss import ANSWER_ID, REQUEST_ID, LssAddress
from msbot_bridges.canopen.simulated.local_device import LocalDevice
from msbot_bridges.canopen.simulated.lss_slave import LssSlave
from msbot_xrce.errors import LinkDown

WAIT_S: Final = 0.1


class UnnumberedDevice(ThreadedDevice):
    """A simulated device that waits for its node id, and then is what it is; it keeps the id until it ends.

    Args:
        address: `INTERFACE:CHANNEL[?bitrate=N]` of python-can.
        who: its LSS address.
        make: makes the device with a node id.
    """

    def __init__(self, address: str, who: LssAddress, make: Callable[[int], LocalDevice]) -> None:
        super().__init__()
        self.slave = LssSlave(who)
        self.device: LocalDevice | None = None
        self._address, self._make = address, make

    def end(self) -> None:
        """Pull it off its bus."""
        super().end()
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
