"""The bridge's place on a CANopen bus: frames in, PDOs and NMT out in one thread, questions by SDO in another.

A question waits for its answer, an order does not wait for questions: so they have a thread each. The library's own
notifier reads the bus.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from collections.abc import Callable, Container, Sequence
from functools import partial
from random import Random
from typing import Final

import canopen
from canopen.network import MessageListener
from canopen.sdo import SdoCommunicationError

import can
from msbot_bridges.bridge import WorldThread
from msbot_bridges.canbus import BEACON_ID, FrameSender, Neighbours, open_bus
from msbot_bridges.canopen.canopen_device import OPERATIONAL, OWN_ID, CanopenDevice
from msbot_bridges.canopen.eds_folder import EdsFolder
from msbot_bridges.canopen.lss import ANSWER_ID, REQUEST_ID
from msbot_bridges.canopen.node_description import NodeDescription, ask_node
from msbot_bridges.canopen.objects import Entry
from msbot_bridges.canopen.pdo_layout import PdoLayout
from msbot_bridges.canopen.sdo_requests import READ_S, SdoRefused, SdoRequests
from msbot_xrce.errors import LinkDown

BEAT_S: Final = 0.25
"""Longest period of the bridge's own heartbeat."""
_NMT: Final = 0x000
SDO_ANSWER, SDO_REQUEST, HEARTBEAT, EMERGENCY = 0x580, 0x600, 0x700, 0x080
_REPORTS: Final = frozenset({EMERGENCY, 0x180, 0x280, 0x380, 0x480, SDO_ANSWER, HEARTBEAT})
"""What nodes send with the node's id in the identifier."""
SYNC_ID: Final = 0x080
SYNC_S: Final = 0.1
"""Period of SYNC, while a device in the robot has PDOs that need it and nobody else sends it."""
OTHER_SYNC_S: Final = 2.0
"""Somebody who has sent no SYNC for so long sends none."""
MOST_ANSWERS: Final = 16
"""Answers of one node that wait to be read."""
_WHO_ARE_YOU: Final = b"\x40\x00\x10\x00\0\0\0\0"
logging.getLogger("canopen").setLevel(logging.CRITICAL)  # the bridge says what is wrong itself
_log = logging.getLogger("msbot.part")


class BridgeNetwork(canopen.Network):  # type: ignore[misc]  # the library has no types
    """The library's network; it does not wait for room in the controller, and leaves frames of others alone.

    Args:
        bus: it is closed with this.
        heard: called in the notifier's thread, with the identifier and data of each frame of a node.
        asked: called there with the identifier of each remote frame.
    """

    NOTIFIER_CYCLE = 0.1

    def __init__(
        self, bus: can.BusABC, heard: Callable[[int, bytes], None], asked: Callable[[int], None] = lambda _: None
    ) -> None:
        super().__init__(bus)
        self.sender = FrameSender(bus)
        self.unasked = 0
        """Answers of nodes that nobody has asked for, and that were left out."""
        self.listeners: list[can.Listener] = [_Listener(self, heard, asked)]

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        """See the library."""
        self.hand_over(can_id, data, remote=remote)

    def hand_over(self, can_id: int, data: bytes, *, remote: bool = False) -> bool:
        """The same; False: the controller has no room for it."""
        message = can.Message(is_extended_id=False, arbitration_id=can_id, data=data, is_remote_frame=remote)
        with self.send_lock:
            if self.bus is None:
                raise can.CanOperationError("the bus was left")
            return self.sender.send(message)

    def takes(self, can_id: int) -> bool:
        """Whether there is room for a frame: the library keeps answers that nobody has asked for without end."""
        node = self.nodes.get(can_id - SDO_ANSWER)
        if node is None or not isinstance(node, canopen.RemoteNode) or node.sdo.responses.qsize() < MOST_ANSWERS:
            return True
        self.unasked += 1
        return False

    def disconnect(self) -> None:
        """See the library; what has ended the bus was told by `check`."""
        with contextlib.suppress(can.CanError):
            super().disconnect()


class _Listener(MessageListener):  # type: ignore[misc]
    def __init__(
        self, network: BridgeNetwork, heard: Callable[[int, bytes], None], asked: Callable[[int], None]
    ) -> None:
        super().__init__(network)
        self._heard, self._asked = heard, asked

    def on_error(self, exc: Exception) -> None:
        """The bus cannot be read: `check` raises it."""

    def on_message_received(self, msg: can.Message) -> None:
        if msg.is_extended_id:
            return  # 29 bits: DroneCAN, Cyphal, MsBOT's own
        if not self.network.takes(msg.arbitration_id):
            return
        super().on_message_received(msg)
        if msg.is_error_frame:
            return
        if msg.is_remote_frame:
            self._asked(msg.arbitration_id)
        else:
            self._heard(msg.arbitration_id, bytes(msg.data))


class CanopenBus:
    """See the module's docstring; implements `NodeBus`.

    Args:
        address: `INTERFACE:CHANNEL[?bitrate=N]` of python-can.
        folder: EDS files.
        heard: called in the event loop with the identifier and data of each frame of a node.
        say: called there with what a person should know.
    """

    def __init__(
        self, address: str, folder: EdsFolder, heard: Callable[[int, bytes], None], say: Callable[[str], None]
    ) -> None:
        self._address, self._folder, self._heard_in_loop = address, folder, heard
        self._network: BridgeNetwork | None = None
        self._reading = dict[int, int]()
        """Nodes that are being asked, and about which STOP."""
        self._to_read = dict[int, tuple[CanopenDevice, Sequence[Entry], int]]()
        """What they are asked next."""
        self._synchronous = set[int]()
        """Nodes with PDOs that need SYNC."""
        self._other_sync_at = -OTHER_SYNC_S
        self._ordered = 0
        """Orders so far."""
        self._overruled = dict[tuple[int, int], int]()
        """The newest urgent one of them, by node and identifier; those before it are old."""
        self._unsent = dict[tuple[int, int], Callable[[], None]]()
        """Orders for which the controller had no room, by node and identifier: only the newest of each counts."""
        self._beat_at = self._sync_at = 0.0
        self._random = Random()
        self._orders = WorldThread(f"CANopen on {address}")
        self._neighbours = Neighbours(address, f"node {OWN_ID}", lambda words: self._orders.tell(partial(say, words)))
        self._questions = WorldThread(f"questions on {address}")
        self._newcomers = WorldThread(f"newcomers on {address}")
        """Nodes of which nothing is known hold up no device."""
        self._is_open = asyncio.Event()

    async def run(self) -> None:
        """Be on the bus until cancelled.

        Raises:
            LinkDown: the bus cannot be opened, or has ended.
        """
        sending = asyncio.create_task(self._orders.run(self._main))
        asking = [asyncio.create_task(one.run(partial(self._ask, one))) for one in (self._questions, self._newcomers)]
        try:
            await asyncio.wait([sending, *asking], return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in asking:
                task.cancel()
            await asyncio.wait(asking)
            sending.cancel()
            await asyncio.wait([sending])
        for task in (sending, *asking):
            if not task.cancelled() and (error := task.exception()) is not None:
                raise error

    async def opened(self) -> None:
        """Wait until frames can be sent."""
        await self._is_open.wait()

    # Orders, from the event loop

    def send(self, node_id: int, layout: PdoLayout, data: bytes, *, urgent: bool = False) -> None:
        """See `NodeBus`."""
        self._order(node_id, layout.cob_id, data, urgent=urgent)

    def command(self, node_id: int, command: int, *, urgent: bool = False) -> None:
        """See `NodeBus`."""
        self._order(node_id, _NMT, bytes([command, node_id]), urgent=urgent)

    def _order(self, node_id: int, can_id: int, data: bytes, *, urgent: bool) -> None:
        """Send an order; one that waits already is not sent after one that is urgent."""
        key = (node_id, can_id)
        number = self._ordered = self._ordered + 1
        if urgent:
            self._overruled[key] = number

        def send() -> None:
            if self._network is None or number < self._overruled.get(key, 0):
                return
            self._unsent.pop(key, None)
            if not self._network.hand_over(can_id, data):
                self._unsent[key] = send

        self._orders.post(send, urgent=urgent)

    def guard(self, node_id: int) -> None:
        """See `NodeBus`."""

        def ask() -> None:
            if self._network is not None:
                self._network.send_message(HEARTBEAT + node_id, b"", remote=True)

        self._orders.post(ask)

    def synchronise(self, node_id: int, *, is_needed: bool) -> None:
        """See `NodeBus`."""
        (self._synchronous.add if is_needed else self._synchronous.discard)(node_id)

    def ask_all(self, data: bytes) -> None:
        """Send a question of LSS, to all devices."""
        self._post(REQUEST_ID, data)

    def probe(self, node_id: int) -> None:
        """Ask one node who it is, without waiting: an answer is heard as other frames are."""
        self._post(SDO_REQUEST + node_id, _WHO_ARE_YOU)

    def search(self, known: Container[int]) -> None:
        """Ask all node ids who they are, but those that are known: nodes that send no heartbeat answer."""
        unknown = iter([node_id for node_id in range(1, OWN_ID) if node_id not in known])

        def ask_next() -> None:
            network, node_id = self._network, next(unknown, None)
            if network is None or node_id is None:
                return
            unsent = network.sender.unsent
            network.send_message(SDO_REQUEST + node_id, _WHO_ARE_YOU)
            if network.sender.unsent == unsent:  # otherwise nobody else is on the bus
                self._orders.post(ask_next)

        self._orders.post(ask_next)

    # Questions, from the event loop

    def describe(self, node_id: int, then: Callable[[NodeDescription | str], None]) -> None:
        """Ask a node who it is; a text says why no part can be made of it now."""

        def ask() -> None:
            try:
                found = ask_node(self._node(node_id), self._folder)
            except Exception as error:  # the library raises whatever it stumbles over in what a node answers
                found = f"node {node_id} cannot be asked who it is: {error}"
            self._newcomers.tell(partial(then, found))

        self._newcomers.post(ask)

    def forget(self, node_id: int) -> None:
        """A node is gone."""

        def forget() -> None:
            if self._network is not None and node_id in self._network:
                del self._network[node_id]

        def forget_orders() -> None:
            for key in [key for key in self._unsent if key[0] == node_id]:
                del self._unsent[key]  # it is not to come back to them

        self._newcomers.post(forget)
        self._orders.post(forget_orders, urgent=True)

    def set_up(self, device: CanopenDevice) -> None:
        """See `NodeBus`."""

        def configure() -> None:
            try:
                ask = SdoRequests(self._node(device.node_id))
                set_up = device.configure(ask)
                if set_up.is_synchronous:
                    ask.expect_sync()
            except Exception as error:  # as in `describe`
                words = f"node {device.node_id} cannot be set up: {error}"
                self._questions.tell(partial(device.failed, words))
            else:
                self._questions.tell(partial(device.configured, set_up))

        self._questions.post(configure)

    def read(self, device: CanopenDevice, entries: Sequence[Entry], stop: int = 0) -> None:
        """See `NodeBus`."""
        if not entries:
            return
        if device.node_id in self._reading:
            if stop and stop != self._reading[device.node_id]:
                self._to_read[device.node_id] = (device, entries, stop)
            return
        self._reading[device.node_id] = stop

        def read() -> None:
            values = dict[Entry, int]()
            try:
                ask = SdoRequests(self._node(device.node_id), READ_S)
                values = {entry: value for entry in entries if (value := ask.number(entry)) is not None}
            except Exception as error:  # as in `describe`; it is asked again, or found to be lost
                _log.debug("%s: %s", self._address, error)
            self._questions.tell(partial(self._has_read, device, values, stop))

        # After the orders that were given before: asked at once, the device would answer what it had before them.
        self._orders.post(partial(self._questions.post, read, urgent=True), urgent=True)

    def write(self, device: CanopenDevice, entry: Entry, value: int, *, urgent: bool = False) -> None:
        """See `NodeBus`."""

        def write() -> None:
            try:
                SdoRequests(self._node(device.node_id)).write(entry, value)
            except (SdoCommunicationError, SdoRefused) as error:
                _log.warning("%s: %s was not written: %s", self._address, entry.where, error)

        self._questions.post(write, urgent=urgent)

    def _has_read(self, device: CanopenDevice, values: dict[Entry, int], stop: int) -> None:
        self._reading.pop(device.node_id, None)
        waiting = self._to_read.pop(device.node_id, None)
        if values:
            device.reported(values, stop)
        if waiting is not None:
            self.read(*waiting)

    # In the threads

    def _main(self) -> None:
        bus = open_bus(self._address)
        network = BridgeNetwork(bus, self._hear)
        try:
            network.connect()
            self._network = network
            self._orders.tell(self._is_open.set)
            while not self._orders.is_ended:
                self._orders.work()
                self._send_unsent()
                wait_s = min(self._beat(network), self._send_sync(network))
                network.check()
                self._orders.wait(wait_s)
            self._orders.work()  # what makes devices safe at the end
            self._send_unsent()
        except can.CanError as error:
            raise LinkDown(f"{self._address}: {error}") from error
        finally:
            network.disconnect()

    def _send_unsent(self) -> None:
        """There may be room by now."""
        for send in list(self._unsent.values()):
            send()

    def _beat(self, network: BridgeNetwork) -> float:
        """Send the bridge's heartbeat when it is due; returns the time until the next."""
        now = time.monotonic()
        if now >= self._beat_at:
            # Two bridges on one wire would otherwise send the same frame at the same time, and never hear each other.
            self._beat_at = now + BEAT_S * self._random.uniform(0.8, 1.0)
            network.send_message(HEARTBEAT + OWN_ID, bytes([OPERATIONAL]))
        return max(0.0, self._beat_at - time.monotonic())

    def _send_sync(self, network: BridgeNetwork) -> float:
        """The same for SYNC, while it is needed."""
        if not self._synchronous:
            return BEAT_S
        now = time.monotonic()
        if now >= self._sync_at:
            self._sync_at = max(self._sync_at + SYNC_S, now)
            if now - self._other_sync_at >= OTHER_SYNC_S:
                network.send_message(SYNC_ID, b"")
        return max(0.0, self._sync_at - time.monotonic())

    @staticmethod
    def _ask(thread: WorldThread) -> None:
        while not thread.is_ended:
            thread.work()
            thread.wait(1.0)

    def _hear(self, can_id: int, data: bytes) -> None:
        if can_id == BEACON_ID:
            self._neighbours.standard(can_id, data)
        elif can_id == HEARTBEAT + OWN_ID:
            self._neighbours.own()
        elif can_id == SYNC_ID:
            self._other_sync_at = time.monotonic()
        elif can_id == ANSWER_ID or (can_id & 0x780 in _REPORTS and can_id & 0x7F not in (0, OWN_ID)):
            self._orders.tell(partial(self._heard_in_loop, can_id, data))

    def _post(self, can_id: int, data: bytes, *, urgent: bool = False) -> None:
        def send() -> None:
            if self._network is not None:
                self._network.send_message(can_id, data)

        self._orders.post(send, urgent=urgent)

    def _node(self, node_id: int) -> canopen.RemoteNode:
        """The library's node for SDO.

        Raises:
            CanError: the bus is not open.
        """
        network = self._network
        if network is None or network.bus is None:
            raise can.CanOperationError(f"{self._address} is not open")
        if node_id not in network:
            network.add_node(canopen.RemoteNode(node_id, canopen.ObjectDictionary()))
        return network[node_id]
