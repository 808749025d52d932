"""The bridge's own node on a DroneCAN bus, in a thread: node monitor, allocator of node ids, orders.

Orders to motor controllers are one array for all of them, so they are sent by the world: an element for each index up
to the highest that the robot drives; what the robot does not drive gets 0. They are repeated, because controllers stop
by themselves when nobody speaks.
"""

from __future__ import annotations

import logging
import time
from functools import partial
from typing import Any

import dronecan
from dronecan import uavcan
from dronecan.app.node_monitor import NodeMonitor
from dronecan.driver.common import DriverError

import can
from msbot_bridges.bridge import DeviceIdentity, DeviceSetting, World, WorldHost, WorldThread
from msbot_bridges.canbus import Heartbeats, Neighbours, open_bus
from msbot_bridges.canbus.software_update import ImageFolder
from msbot_bridges.dronecan.bounded_transfers import BoundedTransfers
from msbot_bridges.dronecan.can_driver import PythonCanDriver
from msbot_bridges.dronecan.node_device import KINDS, NodeDevice
from msbot_bridges.dronecan.node_ids import NodeIdAllocator
from msbot_bridges.dronecan.node_software import NodeSoftware, version_of
from msbot_xrce.errors import LinkDown

OWN_ID = 126
LISTEN_S = 1.5
"""So long a node is listened to before it is known what it sends: range finders may be slow."""
REPEAT_S = 0.1
WAIT_S = 0.01
"""Longest wait for a frame: so long an order may take."""
SPIN_S = 0.05
"""Without frames the library's timers are looked at so often."""
MOST_SETTINGS = 60
"""Parameters read of one node; a description has no room for more."""
WRITE_TIMES = 3
"""So often a parameter is written to a node that does not answer."""
MOST_FRAMES = 50
"""Frames that are taken in before orders are looked at again: they come without end on a bus that is full."""
MOST_UNREADABLE = 1000
"""Frames of one turn that may be damaged; the next turn goes on."""
MOST_REMARKS = 100
MODE_SOFTWARE_UPDATE = uavcan.protocol.NodeStatus().MODE_SOFTWARE_UPDATE
_RAW_MOST = 8191
_log = logging.getLogger("msbot.part")
logging.getLogger("dronecan").setLevel(logging.WARNING)


class _Node:
    """What is known of a node before it is a device."""

    def __init__(self, node_id: int, info: Any) -> None:  # noqa: ANN401
        self.node_id = node_id
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
        self.settings: list[DeviceSetting] = []
        self.is_read = False
        self.device: NodeDevice | None = None

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
        self._written = dict[tuple[int, str], object]()
        """The newest value of each parameter, by the function that writes it."""
        self.unreadable = 0
        """Transfers that were left out."""

    async def run(self, host: WorldHost) -> None:
        """See `World`."""
        self._host = host
        self._thread = WorldThread(f"DroneCAN on {self._address}")
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
        node._transfer_manager = BoundedTransfers()  # noqa: SLF001 - it has no other way
        try:
            monitor = NodeMonitor(node)
            monitor.add_update_handler(self._monitored)
            self._allocator = NodeIdAllocator(node, monitor, other=self._neighbours.gives_ids)
            self._software = NodeSoftware(node, self._images, self._say)
            node.add_handler(uavcan.protocol.NodeStatus, self._status)
            for kind in KINDS:
                message_type = uavcan
                for word in kind.split(".")[1:]:
                    message_type = getattr(message_type, word)
                node.add_handler(message_type, lambda event, kind=kind: self._heard(kind, event))
            node.periodic(REPEAT_S, self._drive)
            spin_at = 0.0
            while not self._thread.is_ended:
                self._thread.work()
                if driver.wait(WAIT_S) or time.monotonic() >= spin_at:
                    spin_at = time.monotonic() + SPIN_S
                    driver.begin_turn(MOST_FRAMES)
                    self._spin(node)
                    self._finish()
            self._drive()
        except (DriverError, can.CanError) as error:
            raise LinkDown(f"{self._address}: {error}") from error
        finally:
            node.close()

    def _spin(self, node: Any) -> None:  # noqa: ANN401
        """Take in the frames that have come; what nobody can read is counted, and said once."""
        for _ in range(MOST_UNREADABLE):
            try:
                node.spin(0)
            except DriverError:
                raise
            except Exception as error:  # the library raises whatever it stumbles over in what others have sent
                self.unreadable += 1
                _log.debug("%s: a transfer cannot be read", self._address, exc_info=True)
                if self.unreadable == 1:
                    self._say(f"something on this bus cannot be read, and is left out: {error}")
            else:
                return

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
            self._lose(known, f"node {node_id} " + ("has started anew" if is_same else "is another device now"))
        self._nodes[node_id] = _Node(node_id, info)
        self._read_setting(self._nodes[node_id], 0)

    def _ask_who(self, node_id: int) -> None:
        def answered(event: Any) -> None:  # noqa: ANN401
            if event is not None:
                self._is_there(node_id, event.response)

        self._node.request(uavcan.protocol.GetNodeInfo.Request(), node_id, answered)

    def _lose(self, known: _Node, why: str) -> None:
        self._nodes.pop(known.node_id, None)
        self._driven.pop(known.node_id, None)
        for key in [key for key in self._written if key[0] == known.node_id]:
            del self._written[key]
        if (device := known.device) is not None:
            why = self._software.state_of(known.unique) or why
            self._thread.tell(lambda: self._host.lost(device, why))

    def _read_setting(self, known: _Node, index: int) -> None:
        """Ask for a parameter; a node that has no more answers with an empty name."""

        def answered(event: Any) -> None:  # noqa: ANN401
            if event is None or not event.response.name or index >= MOST_SETTINGS:
                known.is_read = True
                return
            if (setting := setting_of(event.response)) is not None:
                known.settings.append(setting)
            self._read_setting(known, index + 1)

        request = uavcan.protocol.param.GetSet.Request(index=index)
        self._node.request(request, known.node_id, answered)

    def _finish(self) -> None:
        """Nodes that have been listened to for long enough become devices."""
        for known in self._nodes.values():
            if known.device is not None or known.mode == MODE_SOFTWARE_UPDATE:
                continue
            if known.is_read and time.monotonic() - known.since >= LISTEN_S and known.seen:
                device = known.device = NodeDevice(
                    identity_of(known.node_id, known.info),
                    known.node_id,
                    known.seen,
                    tuple(known.settings),
                    order=partial(self._ordered, known),
                    write=self._write,
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
            self._thread.tell(lambda: device.heard(kind, message))

    # New software

    def _update(self, known: _Node, image: str) -> None:
        """From the loop: a device has left its robot, and is to take new software."""

        def begin() -> None:
            before = version_of(known.info.software_version)
            ended = partial(self._updated, known)
            self._software.begin(known, known.node_id, known.unique, name=image, before=before, ended=ended)

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

        def take() -> None:
            device = known.device
            if device is None or self._nodes.get(known.node_id) is not known:
                return
            if device.is_driven:
                self._driven[known.node_id] = device
            self._drive()
            if not device.is_driven:
                self._driven.pop(known.node_id, None)  # its safe value was sent just now

        self._thread.post(take, urgent=urgent)

    def _drive(self) -> None:
        motors = {one.esc_index: one.power for one in self._driven.values() if one.esc_index is not None}
        if motors:
            command = [int(_RAW_MOST * motors.get(index, 0.0) / 100) for index in range(max(motors) + 1)]
            self._node.broadcast(uavcan.equipment.esc.RawCommand(cmd=command))
        servos = {one.actuator_id: one.radians for one in self._driven.values() if one.actuator_id is not None}
        if servos:
            commands = [
                uavcan.equipment.actuator.Command(actuator_id=number, command_type=1, command_value=radians)
                for number, radians in servos.items()
            ]
            self._node.broadcast(uavcan.equipment.actuator.ArrayCommand(commands=commands[:15]))

    def _write(self, node_id: int, name: str, value: object) -> None:
        """From the loop: give a parameter its value."""

        def write(times: int = WRITE_TIMES) -> None:
            def answered(event: Any) -> None:  # noqa: ANN401
                if event is not None or self._written.get((node_id, name)) is not write:
                    return  # done, or another value was written since
                if times > 1:
                    write(times - 1)
                else:
                    _log.warning("node %d has not answered that its parameter %s is %s", node_id, name, value)

            request = uavcan.protocol.param.GetSet.Request(name=name)
            request.value = parameter_value(value)
            self._node.request(request, node_id, answered)

        self._written[node_id, name] = write
        self._thread.post(write)


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


def setting_of(answer: Any) -> DeviceSetting | None:  # noqa: ANN401
    """A parameter as a setting; None for one that no setting can be."""
    name = _text(answer.name)
    union = dronecan.get_active_union_field
    kind = union(answer.value)
    if "." in name or not name.isprintable():
        return None
    default = answer.default_value if union(answer.default_value) == kind else answer.value
    if kind == "boolean_value":
        return DeviceSetting(name, bool, bool(default.boolean_value))
    if kind == "string_value":
        return DeviceSetting(name, str, _text(default.string_value))
    if kind not in ("integer_value", "real_value"):
        return None
    least, most = (
        float(getattr(limit, union(limit))) if union(limit) in ("integer_value", "real_value") else None
        for limit in (answer.min_value, answer.max_value)
    )
    if kind == "integer_value":
        return DeviceSetting(name, int, int(default.integer_value), least, most)
    return DeviceSetting(name, float, float(default.real_value), least, most)


def parameter_value(value: object) -> Any:  # noqa: ANN401
    """The value of a setting, as a node takes it."""
    made = uavcan.protocol.param.Value()
    if isinstance(value, bool):
        made.boolean_value = int(value)
    elif isinstance(value, int):
        made.integer_value = value
    elif isinstance(value, float):
        made.real_value = value
    else:
        made.string_value = str(value)
    return made


def _unique(info: Any) -> bytes:  # noqa: ANN401
    return bytes(info.hardware_version.unique_id.to_bytes())


def _text(array: Any) -> str:  # noqa: ANN401
    """A text of a node, whatever octets it has sent."""
    return bytes(array.to_bytes()).decode(errors="replace")
