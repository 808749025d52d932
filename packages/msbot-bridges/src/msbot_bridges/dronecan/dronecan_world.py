"""The bridge's own node on a DroneCAN bus, in a thread: node monitor, allocator of node ids, orders.

Orders to motor controllers are one array for all of them, so they are sent by the world: an element for each index up
to the highest that the robot drives; what the robot does not drive gets 0. They are repeated, because controllers stop
by themselves when nobody speaks.
"""

from __future__ import annotations

import asyncio
import logging
import time
from contextlib import nullcontext
from functools import partial
from typing import Any

import dronecan
from dronecan import uavcan
from dronecan.app.node_monitor import NodeMonitor
from dronecan.driver.common import DriverError

import can
from msbot_bridges.bridge import DeviceIdentity, World, WorldHost, WorldThread
from msbot_bridges.canbus import FreshReports, Heartbeats, Neighbours, open_bus
from msbot_bridges.canbus.image_folder import ImageFolder
from msbot_bridges.dronecan.can_driver import PythonCanDriver
from msbot_bridges.dronecan.node_device import KINDS, NodeDevice
from msbot_bridges.dronecan.node_ids import NodeIdAllocator
from msbot_bridges.dronecan.node_software import NodeSoftware, version_of
from msbot_bridges.dronecan.orders import conflicts, motor_powers, servo_angles
from msbot_bridges.dronecan.parameters import NodeParameters
from msbot_bridges.dronecan.transfer_reader import TransferReader
from msbot_xrce.errors import ConfigError, LinkDown

OWN_ID = 126
LISTEN_S = 1.5
"""So long a node is listened to before it is known what it sends: range finders may be slow."""
REPEAT_S = 0.1
WAIT_S = 0.01
"""Longest wait for a frame: so long an order may take."""
SPIN_S = 0.05
"""Without frames the library's timers are looked at so often."""
MOST_FRAMES = 50
"""Frames that are taken in before orders are looked at again: they come without end on a bus that is full."""
MOST_UNREADABLE = 1000
"""Frames of one turn that may be damaged; the next turn goes on."""
MOST_REMARKS = 100
CONFLICTS_S = 1.0
"""So often it is looked whether two nodes obey the same orders."""
MODE_SOFTWARE_UPDATE = uavcan.protocol.NodeStatus().MODE_SOFTWARE_UPDATE
logging.getLogger("dronecan").setLevel(logging.WARNING)


class _Node:
    """What is known of a node before it is a device."""

    def __init__(self, node_id: int, info: Any, parameters: NodeParameters) -> None:  # noqa: ANN401
        self.node_id = node_id
        self.parameters = parameters
        self.info = info
        self.unique = _unique(info)
        self.mode = info.status.mode
        self.since = time.monotonic()
        self.uptime_s = 0
        self.has_restarted = False
        """It is there again, and has not said anew who it is."""
        self.heartbeats = Heartbeats()
        self.is_doubtful = False
        """Another device may be there now; what it reports does not count."""
        self.seen: dict[str, Any] = {}
        self.device: NodeDevice | None = None
        self.fresh = FreshReports()

    def is_who_says(self, info: Any) -> bool:  # noqa: ANN401
        """Whether that is what this node has said of itself."""
        return self.unique == _unique(info) and _text(self.info.name) == _text(info.name)


class DronecanWorld(World):
    """All nodes of one bus.

    Args:
        address: `INTERFACE:CHANNEL[?bitrate=N]` of python-can.
        images: new software for nodes; None: there is none.
    """

    def __init__(self, address: str, images: ImageFolder | None = None) -> None:
        self._address, self._images = address, images
        self._remarks: dict[bytes, str] = {}
        """How nodes got new software, by their unique ids, until they are devices again."""
        self._nodes: dict[int, _Node] = {}
        self._driven: dict[int, NodeDevice] = {}
        self._reading = set[asyncio.Task[None]]()
        """Images that are being read."""
        self._conflicts = set[str]()
        """Nodes that obey the same orders, as was said."""

    async def run(self, host: WorldHost) -> None:
        """See `World`."""
        self._host = host
        self._thread = WorldThread(f"DroneCAN on {self._address}")
        async with nullcontext() if self._images is None else self._images.watched():
            await self._thread.run(self._main)

    # In the thread

    def _main(self) -> None:
        bus = open_bus(self._address)
        info = uavcan.protocol.GetNodeInfo.Response()
        info.name = "org.msbot.bridge"
        self._neighbours = Neighbours(self._address, f"node {OWN_ID}", self._say)
        driver = PythonCanDriver(bus, self._neighbours.standard)
        node = self._node = dronecan.node.Node(
            driver, OWN_ID, node_info=info, mode=uavcan.protocol.NodeStatus().MODE_OPERATIONAL
        )
        reader = TransferReader(node, self._address, self._say)
        try:
            monitor = NodeMonitor(node)
            monitor.add_update_handler(self._monitored)
            self._allocator = NodeIdAllocator(node, monitor, other=self._neighbours.gives_ids)
            self._software = NodeSoftware(node, self._say, serves=self._images is not None)
            node.add_handler(uavcan.protocol.NodeStatus, self._status)
            for kind in KINDS:
                message_type = uavcan
                for word in kind.split(".")[1:]:
                    message_type = getattr(message_type, word)
                node.add_handler(message_type, lambda event, kind=kind: self._heard(kind, event))
            node.periodic(REPEAT_S, self._drive)
            node.periodic(CONFLICTS_S, self._look_for_conflicts)
            spin_at = 0.0
            while not self._thread.is_ended:
                self._thread.work()
                if driver.wait(WAIT_S) or time.monotonic() >= spin_at:
                    spin_at = time.monotonic() + SPIN_S
                    driver.begin_turn(MOST_FRAMES)
                    reader.spin(0, MOST_UNREADABLE)
                    self._finish()
            self._drive()
        except (DriverError, can.CanError) as error:
            raise LinkDown(f"{self._address}: {error}") from error
        finally:
            node.close()

    def _monitored(self, event: Any) -> None:  # noqa: ANN401
        entry = event.entry
        known = self._nodes.get(entry.node_id)
        if event.event_id == event.EVENT_ID_OFFLINE:
            if known is not None:
                self._lose(known, f"node {entry.node_id} has sent no NodeStatus for 3 s")
        elif event.event_id == event.EVENT_ID_INFO_UPDATE and entry.info is not None and entry.node_id != OWN_ID:
            self._is_there(entry.node_id, entry.info)

    def _is_there(self, node_id: int, info: Any) -> None:  # noqa: ANN401
        """A node has said who it is; perhaps it was asked again, or somebody else has asked."""
        known = self._nodes.get(node_id)
        if known is not None:
            is_same = known.is_who_says(info)
            if is_same and not known.has_restarted:
                known.is_doubtful = False
                return
            if is_same and known.device is not None:
                known.device.is_reset = True
            self._lose(known, f"node {node_id} " + ("has started anew" if is_same else "is another device now"))
        known = self._nodes[node_id] = _Node(node_id, info, NodeParameters(self._node, node_id))
        known.parameters.read()

    def _ask_who(self, node_id: int) -> None:
        def answered(event: Any) -> None:  # noqa: ANN401
            if event is not None:
                self._is_there(node_id, event.response)

        self._node.request(uavcan.protocol.GetNodeInfo.Request(), node_id, answered)

    def _lose(self, known: _Node, why: str) -> None:
        self._nodes.pop(known.node_id, None)
        self._driven.pop(known.node_id, None)
        known.parameters.end()
        if (device := known.device) is not None:
            why = self._software.state_of(known.unique) or why
            self._thread.tell(lambda: self._host.lost(device, why))

    def _finish(self) -> None:
        """Nodes that have been listened to for long enough become devices."""
        for known in self._nodes.values():
            if known.device is not None or known.mode == MODE_SOFTWARE_UPDATE:
                continue
            if known.parameters.is_read and time.monotonic() - known.since >= LISTEN_S and known.seen:
                device = known.device = NodeDevice(
                    identity_of(known.node_id, known.info),
                    known.node_id,
                    known.seen,
                    tuple(known.parameters.settings),
                    order=partial(self._ordered, known),
                    write=partial(self._write, known),
                    restart=partial(self._thread.post, partial(self._software.restart, known.node_id)),
                    update=partial(self._update, known),
                    images=self._images,
                    remark=self._remarks.pop(known.unique, ""),
                    news=self._host.news,
                )
                self._thread.tell(partial(self._host.found, device))

    def _status(self, event: Any) -> None:  # noqa: ANN401
        if event.transfer.source_node_id == OWN_ID:
            self._neighbours.own()
        known, status = self._nodes.get(event.transfer.source_node_id), event.message
        if known is None:
            return
        known.has_restarted |= status.uptime_sec < known.uptime_s
        known.uptime_s, known.mode = status.uptime_sec, status.mode
        if not known.heartbeats.fits(status.uptime_sec, event.transfer.transfer_id, time.monotonic()):
            known.is_doubtful = True
        if known.is_doubtful and not known.has_restarted:  # of a node that has, the library asks by itself
            self._ask_who(known.node_id)
        if not known.has_restarted:
            self._software.lives(known, known.unique, status, version_of(known.info.software_version))
        if (device := known.device) is not None:
            health = status.health == status.HEALTH_CRITICAL, status.mode == MODE_SOFTWARE_UPDATE
            if health != (device.is_critical, device.is_updating):
                self._thread.tell(partial(device.health, *health))

    def _heard(self, kind: str, event: Any) -> None:  # noqa: ANN401
        known = self._nodes.get(event.transfer.source_node_id)
        if known is None or known.is_doubtful or known.has_restarted:
            return
        if known.device is None:
            known.seen[kind] = event.message
        elif kind in known.device.kinds:  # its ports are those of what it sent at first
            device, message = known.device, event.message
            device.numbered(kind, message)
            is_old = known.fresh.is_old(device.stop_number, kind, time.monotonic())
            self._thread.tell(lambda: device.heard(kind, message, is_old=is_old))

    # New software

    def _update(self, known: _Node, image: str) -> None:
        """From the loop: a device has left its robot, and is to take new software."""
        reading = asyncio.create_task(self._read_image(known, image))
        self._reading.add(reading)
        reading.add_done_callback(self._reading.discard)

    async def _read_image(self, known: _Node, image: str) -> None:
        """In neither the loop nor the thread of the bus, which must not wait for a disk."""
        assert self._images is not None
        ended = partial(self._updated, known)
        try:
            octets = await asyncio.to_thread(self._images.read, image)
        except ConfigError as error:
            self._thread.post(partial(ended, str(error)))
            return

        def begin() -> None:
            before = version_of(known.info.software_version)
            self._software.begin(
                known, known.node_id, known.unique, name=image, octets=octets, before=before, ended=ended
            )

        self._thread.post(begin)

    def _updated(self, known: _Node, outcome: str) -> None:
        self._say(outcome)
        device = known.device
        is_gone = all(one.unique != known.unique or one.device is None for one in self._nodes.values())
        if device is not None and is_gone:
            self._thread.tell(partial(self._host.explain, device, outcome))
        if self._nodes.get(known.node_id) is known and device is not None:
            self._thread.tell(lambda: device.not_updated(outcome))
        else:
            if len(self._remarks) >= MOST_REMARKS:
                del self._remarks[next(iter(self._remarks))]
            self._remarks[known.unique] = outcome

    def _say(self, words: str) -> None:
        self._thread.tell(partial(self._host.say, words))

    # Orders

    def _ordered(self, known: _Node, urgent: bool) -> None:
        """From the loop: what a device is to do has changed."""
        stop = known.device.stop_number if urgent and known.device is not None else 0

        def take() -> None:
            device = known.device
            if device is None or self._nodes.get(known.node_id) is not known:
                return
            if device.is_driven:
                self._driven[known.node_id] = device
            self._drive()
            if stop:
                known.fresh.told(stop, time.monotonic())
            if not device.is_driven:
                self._driven.pop(known.node_id, None)  # its safe value was sent just now

        self._thread.post(take, urgent=urgent)

    def _drive(self) -> None:
        if powers := motor_powers(self._driven.values()):
            self._node.broadcast(uavcan.equipment.esc.RawCommand(cmd=powers))
        for angles in servo_angles(self._driven.values()):
            commands = [
                uavcan.equipment.actuator.Command(actuator_id=number, command_type=1, command_value=radians)
                for number, radians in angles
            ]
            self._node.broadcast(uavcan.equipment.actuator.ArrayCommand(commands=commands))

    def _write(self, known: _Node, name: str, value: object) -> None:
        """From the loop: give a parameter its value."""
        self._thread.post(partial(known.parameters.write, name, value))

    def _look_for_conflicts(self) -> None:
        """Say once which nodes obey the same orders; again when it was over meanwhile."""
        found = conflicts(known.device for known in self._nodes.values() if known.device is not None)
        for device, words in found:
            if words not in self._conflicts:
                self._thread.tell(partial(self._host.warn, device, words))
        self._conflicts = {words for _, words in found}


def identity_of(node_id: int, info: Any) -> DeviceIdentity:  # noqa: ANN401
    """Who a node says it is; its name is `com.maker.product`."""
    maker, _, product = _text(info.name).rpartition(".")
    hardware, software = info.hardware_version, info.software_version
    return DeviceIdentity(
        maker,
        product,
        _unique(info),
        f"DroneCAN {product} of {maker}",
        f"node {node_id}",
        f"{hardware.major}.{hardware.minor}",
        f"{software.major}.{software.minor}",
    )


def _unique(info: Any) -> bytes:  # noqa: ANN401
    return bytes(info.hardware_version.unique_id.to_bytes())


def _text(array: Any) -> str:  # noqa: ANN401
    """A text of a node, whatever octets it has sent."""
    return bytes(array.to_bytes()).decode(errors="replace")
