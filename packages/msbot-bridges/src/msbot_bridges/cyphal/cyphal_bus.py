"""The bridge's node, made with the library `pycyphal`: everything that is said and heard on the bus."""

from __future__ import annotations

import asyncio
import importlib
import logging
import time
from collections.abc import Callable, Coroutine, Iterable
from functools import partial
from typing import Any, Final
from weakref import WeakKeyDictionary

import nunavut_support
import pycyphal.application
import uavcan.node
import uavcan.node.port
import uavcan.pnp
from pycyphal.application.node_tracker import Entry, NodeTracker
from pycyphal.presentation import Publisher, Subscriber
from pycyphal.transport import Priority, TransferFrom
from pycyphal.transport.can import CANTransport

import can
from msbot_bridges.bridge import DeviceIdentity, ForeignDevice, Value, WorldHost
from msbot_bridges.canbus import FreshReports, Heartbeats, Neighbours, is_fd
from msbot_bridges.canbus.image_folder import ImageFolder
from msbot_bridges.canbus.software_update import SoftwareVersion
from msbot_bridges.cyphal.aspect import READINESS, Builtin
from msbot_bridges.cyphal.can_media import PythonCanMedia
from msbot_bridges.cyphal.node_device import CyphalNode
from msbot_bridges.cyphal.node_ids import GivenNodeIds, hash_of
from msbot_bridges.cyphal.node_registers import RegisterSetting, SubjectPort, ports_of, settings_of
from msbot_bridges.cyphal.node_software import MODE_SOFTWARE_UPDATE, CyphalSoftware, version_of
from msbot_bridges.cyphal.register_access import IDENTIFY, RESTART, STORE, RegisterAccess, is_as_written
from msbot_bridges.cyphal.subject_groups import SubjectGroups, may_share
from msbot_bridges.cyphal.subjects import Subjects

REPEAT_S: Final = 0.1
"""Actuators stop by themselves when they have heard nothing for a while."""
MOST_LISTED: Final = 2048
"""Subjects of a node's own list; a list of all says nothing."""
MOST_GIVEN: Final = 128
ASK_TIMES: Final = 20
"""So often, three times each, a node is asked who it is."""
SEEN_UPTIME_S: Final = 2
RESTART_S: Final = 10.0
"""A node that has not started anew so long after it has been told does not restart by itself."""
GIVE_AGAIN_S: Final = 5.0
"""A node that has not answered when it was given a subject comes back so long after, and is given it again."""
Who = tuple[bytes, bytes]
SERVER: Final = -1
"""Instead of a node id: work that is not for one node."""
logging.getLogger("pycyphal").setLevel(logging.ERROR)
_log = logging.getLogger("msbot.part")


class CyphalBus:
    """See `SubjectBus`, which it is for devices.

    Args:
        bus: it is closed with this.
        address: of the bus, for people.
        node_id: the bridge's own.
        host: is told what is found.
        failed: called once when the bus has ended.
        images: new software for nodes; None: there is none.
    """

    def __init__(
        self,
        bus: can.BusABC,
        address: str,
        node_id: int,
        host: WorldHost,
        failed: Callable[[Exception], None],
        *,
        images: ImageFolder | None = None,
    ) -> None:
        self._host = host
        self._devices: dict[int, CyphalNode] = {}
        self._tasks: dict[int, set[asyncio.Task[None]]] = {}
        self._publishers: dict[CyphalNode, dict[SubjectPort, Publisher[Any]]] = {}
        self._subscribers: dict[CyphalNode, list[Subscriber[Any]]] = {}
        self._groups = SubjectGroups()
        self._vectors: dict[int, tuple[str, Publisher[Any]]] = {}
        """The type and publisher of each group of motor controllers, by its subject."""
        self._repeated = set[int]()
        """Subjects of groups that were repeated in this round."""
        self._given: dict[bytes, int] = {}
        """Nodes that have got subjects and restart, by their unique id."""
        self._who: dict[int, Who] = {}
        """Who has said to be at each node id: unique id and name."""
        self._heartbeats: dict[int, Heartbeats] = {}
        self._doubtful = set[int]()
        """Node ids at which another device may be now; what they report does not count."""
        self._verifying = set[int]()
        self._silent = set[int]()
        """Node ids that were said not to answer."""
        self._node_is_closed = False
        self._fresh = WeakKeyDictionary[CyphalNode, FreshReports]()
        self._versions = WeakKeyDictionary[CyphalNode, SoftwareVersion]()
        self._written: dict[tuple[int, str], Value] = {}
        self._ids, self._subjects = GivenNodeIds(), Subjects()
        self._neighbours = Neighbours(address, f"node {node_id}", host.say)
        self._bus, self._media = bus, PythonCanMedia(bus, failed, self._neighbours.standard, fd=is_fd(address))
        transport = CANTransport(self._media, node_id)
        registry = pycyphal.application.make_registry(environment_variables={})
        info = pycyphal.application.NodeInfo(name="org.msbot.bridge")
        self._node = pycyphal.application.make_node(info, registry, transport=transport)
        self._registers = RegisterAccess(self._node)
        self._software: CyphalSoftware | None = None
        if images is not None:
            self._software = CyphalSoftware(self._node, self._registers, images, host.say)
        self._tracker = NodeTracker(self._node)
        self._tracker.get_info_attempts = 0  # an answer that comes late ends its task with an error; asked here
        self._tracker.add_update_handler(self._tracked)
        self._answers = self._node.make_publisher(uavcan.pnp.NodeIDAllocationData_1)
        self._hear(uavcan.pnp.NodeIDAllocationData_1, self._asked_for_id)
        self._hear(uavcan.node.Heartbeat_1, self._heartbeat)
        self._hear(uavcan.node.port.List_1, self._listed)
        self._node.start()
        self._repeating = asyncio.create_task(self._repeat())

    async def close(self) -> None:
        """Leave the bus."""
        tasks = [self._repeating, *(task for tasks in self._tasks.values() for task in tasks)]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        await asyncio.sleep(0)  # what was published just now is handed to the bus
        self._node_is_closed = True
        self._node.close()
        await self._media.closed()
        await asyncio.to_thread(self._bus.shutdown)

    def _hear(self, kind: Any, hear: Callable[[Any, TransferFrom], None]) -> None:  # noqa: ANN401
        self._node.make_subscriber(kind).receive_in_background(hear)

    # Who is there

    def _tracked(self, node_id: int, old: Entry | None, new: Entry | None) -> None:
        if new is None:
            self._lose(node_id, f"node {node_id} has sent no heartbeat for 3 s")
        elif node_id != self._node.id:
            if old is not None:
                self._lose(node_id, f"node {node_id} has started anew", is_reset=True)
            self._begin(node_id, self._ask_who(node_id))

    async def _ask_who(self, node_id: int) -> None:
        """Ask until it answers, is lost, or has not answered for long."""
        for _ in range(ASK_TIMES):
            if (info := await self._registers.info(node_id)) is not None:
                self._meet(node_id, info)
                return
        self._say_silent(node_id, "who it is")

    def _say_silent(self, node_id: int, what: str) -> None:
        """Once for each, until it answers: heartbeats alone may come and go."""
        if node_id not in self._silent:
            self._silent.add(node_id)
            self._host.say(f"node {node_id} does not answer when it is asked {what}")

    def _meet(self, node_id: int, info: Any) -> None:  # noqa: ANN401
        who = self._who[node_id] = _who(info)
        if any(who[0]):
            self._ids.seen(node_id, hash_of(who[0]))
        self._begin(node_id, self._introduce(node_id, info))

    async def _verify(self, node_id: int) -> None:
        """Ask who is at a node id; without an answer it stays doubtful, and the next heartbeat asks again."""
        try:
            info = await self._registers.info(node_id)
        finally:
            self._verifying.discard(node_id)
        if info is not None and _who(info) == self._who.get(node_id):
            self._doubtful.discard(node_id)
        elif info is not None:
            self._lose(node_id, f"node {node_id} is another device now")
            self._meet(node_id, info)

    def _lose(self, node_id: int, why: str, *, is_reset: bool = False) -> None:
        self._doubtful.discard(node_id)
        self._who.pop(node_id, None)
        self._heartbeats.pop(node_id, None)
        for task in self._tasks.pop(node_id, ()):
            task.cancel()
        self._subjects.forget(node_id)
        for key in [key for key in self._written if key[0] == node_id]:
            del self._written[key]
        if (device := self._devices.pop(node_id, None)) is not None:
            device.is_reset = is_reset
            updated = "" if self._software is None else self._software.state_of(device.identity.unique)
            self._host.lost(device, updated or why)

    async def _introduce(self, node_id: int, info: Any) -> None:  # noqa: ANN401
        while int(self._tracker.registry[node_id].heartbeat.mode.value) == MODE_SOFTWARE_UPDATE:  # noqa: ASYNC110
            await asyncio.sleep(REPEAT_S)  # its boot loader is no device; another start ends this
        remark, software = "", self._software
        if software is not None and software.state_of(unique_of(node_id, info)):
            info = await self._registers.info(node_id) or info
            remark = software.runs(unique_of(node_id, info), version_of(info))
        registers = await self._registers.read_all(node_id)
        if registers is None:
            self._say_silent(node_id, "for its registers")
            return
        self._silent.discard(node_id)
        ports = ports_of(registers)
        self._subjects.uses(node_id, "published", _subjects_of(ports.published))
        self._subjects.uses(node_id, "subscribed", _subjects_of(ports.subscribed))
        identity = identity_of(node_id, info)
        images = None if software is None else software.images
        device = CyphalNode(identity, node_id, ports, settings_of(registers), self, images=images, remark=remark)
        self._versions[device] = version_of(info)
        if (entry := self._tracker.registry.get(node_id)) is not None:
            device.heartbeat(int(entry.heartbeat.health.value), int(entry.heartbeat.mode.value))
        if device.left_out:
            self._host.say(f"{identity.part_number} (node {node_id}): ports left out: {', '.join(device.left_out)}")
        if not device.used:
            self._host.say(f"{identity.part_number} (node {node_id}) has no port for a part")
            return
        self._devices[node_id] = device
        self._warn_of_listener(device)
        self._host.found(device)

    def _warn_of_listener(self, newcomer: CyphalNode) -> None:
        """Messages have no receiver: say which orders a node obeys though they are for another one."""
        mine = [port for port in newcomer.ports.subscribed if port.subject is not None]
        for device in self._devices.values():
            for own, port in ((own, port) for own in mine for port in device.ports.subscribed):
                if own.subject != port.subject or device is newcomer:
                    continue
                both = f"node {newcomer.node_id} hears the orders to node {device.node_id}: both have subject"
                if not may_share(own, port):
                    self._host.say(f"{both} {port.subject}")
                elif own.type_name == READINESS:
                    self._host.say(f"{both} {port.subject}, so they are engaged only when both are in the robot")

    def _heartbeat(self, told: Any, transfer: TransferFrom) -> None:  # noqa: ANN401
        if _source(transfer) == self._node.id:
            self._neighbours.own()
        if self._software is not None and (who := self._who.get(_source(transfer))) is not None:
            self._software.reports(who[0], int(told.health.value), int(told.mode.value))
        device = self._devices.get(_source(transfer))
        if device is not None and device.is_updating and int(told.mode.value) != MODE_SOFTWARE_UPDATE:
            # It may have started so soon after the last time that its time since then tells nothing.
            self._lose(device.node_id, f"node {device.node_id} has started anew", is_reset=True)
            self._begin(device.node_id, self._ask_who(device.node_id))
        elif device is not None:
            self._doubt(device.node_id, int(told.uptime), transfer.transfer_id)
            device.heartbeat(int(told.health.value), int(told.mode.value))

    def _doubt(self, node_id: int, uptime_s: int, number: int) -> None:
        """A heartbeat of a device has come: ask anew who it is when it does not go on as before."""
        now = asyncio.get_running_loop().time()
        if not self._heartbeats.setdefault(node_id, Heartbeats()).fits(uptime_s, number, now):
            self._doubtful.add(node_id)
        if node_id in self._doubtful and node_id not in self._verifying:
            self._verifying.add(node_id)
            self._begin(node_id, self._verify(node_id))

    def _listed(self, told: Any, transfer: TransferFrom) -> None:  # noqa: ANN401
        for how, listed in (("published list", told.publishers), ("subscribed list", told.subscribers)):
            if listed.sparse_list is not None:
                found = [int(one.value) for one in listed.sparse_list]
            elif listed.mask is not None:
                found = [int(one) for one in listed.mask.nonzero()[0][:MOST_LISTED]]
            else:
                found = []
            self._subjects.uses(_source(transfer), how, found)

    def _asked_for_id(self, told: Any, transfer: TransferFrom) -> None:  # noqa: ANN401
        """Answer a node that has no node id."""
        if transfer.source_node_id is not None:
            self._neighbours.gives_ids(transfer.source_node_id)
            return
        unique_hash = int(told.unique_id_hash)
        given = self._ids.give(unique_hash, self._tracker.registry.keys())
        if given is None:
            self._neighbours.no_ids()
            return
        answer = uavcan.pnp.NodeIDAllocationData_1(unique_hash, [uavcan.node.ID_1(given)])
        self._answers.priority = transfer.priority
        self._answers.publish_soon(answer)

    # SubjectBus

    def take_in(self, device: CyphalNode) -> None:
        """See `SubjectBus`."""
        if why := self._conflict(device):
            device.failed(why)
            return
        if any(port.subject is None for port in device.used):
            self._begin(device.node_id, self._give_subjects(device))
            return
        self._given.pop(device.identity.unique, None)
        self.listen(device)

    def listen(self, device: CyphalNode) -> None:
        """See `SubjectBus`."""
        if device in self._subscribers:
            return
        for port in device.ports.published:
            if port in device.used and port.subject is not None:
                self._listen(device, port)

    def _conflict(self, device: CyphalNode) -> str:
        """Why the subjects of a node are not its own; empty: they are."""
        node_id = device.node_id
        for port in device.used:
            if port.subject is None:
                continue
            is_told = port in device.ports.subscribed
            others = self._subjects.others("published", port.subject, node_id)
            if is_told:
                listening = self._subjects.others("subscribed", port.subject, node_id)
                others += [one for one in listening if not self._shares(one, port)]
            else:
                others = [one for one in others if not self._publishes(one, port)]
            if others:
                if port.place is not None and self._is_at(others[0], port):
                    return (
                        f"nodes {node_id} and {others[0]} both have place {port.place} of subject {port.subject}: "
                        f"give node {node_id} another place, and restart it"
                    )
                return (
                    f"nodes {node_id} and {others[0]} both have subject {port.subject}: "
                    f"give {port.register} of node {node_id} another, and restart it"
                )
        return ""

    def _told_on(self, node_id: int, subject: int | None) -> list[SubjectPort]:
        device = self._devices.get(node_id)
        return [] if device is None else [one for one in device.ports.subscribed if one.subject == subject]

    def _shares(self, node_id: int, port: SubjectPort) -> bool:
        """Whether another node can be told by the same messages as this port's."""
        ports = self._told_on(node_id, port.subject)
        return bool(ports) and all(may_share(one, port) for one in ports)

    def _is_at(self, node_id: int, port: SubjectPort) -> bool:
        return any(one.place == port.place for one in self._told_on(node_id, port.subject))

    def _publishes(self, node_id: int, like: SubjectPort) -> bool:
        """Whether a node publishes on a subject with the same data type, so that both can be heard."""
        device = self._devices.get(node_id)
        ports = () if device is None else device.ports.published
        return any((one.subject, one.type_name) == (like.subject, like.type_name) for one in ports)

    def leave(self, device: CyphalNode) -> None:
        """See `SubjectBus`."""
        for subscriber in self._subscribers.pop(device, []):
            subscriber.close()
        self._groups.leave(device)
        for publisher in self._publishers.pop(device, {}).values():
            asyncio.get_running_loop().call_later(REPEAT_S, publisher.close)  # the last order is still going out

    def publish(
        self, device: CyphalNode, port: SubjectPort, fields: Builtin, *, urgent: bool, again: bool = False
    ) -> None:
        """See `SubjectBus`."""
        if port.subject is None or self._devices.get(device.node_id) is not device or self._node_is_closed:
            return
        if urgent and not again:
            self._fresh.setdefault(device, FreshReports()).told(device.stop_number, time.monotonic())
        if (again and port.subject in self._repeated) or (device.node_id in self._doubtful and not urgent):
            return
        if port.place is not None:
            self._repeated.add(port.subject)
            type_name, elements = self._groups.vector(port.subject, device, port.place, fields["value"])
            self._send(self._vector_publisher(port.subject, type_name), {"value": elements}, urgent=urgent)
            return
        if port.type_name == READINESS:
            self._repeated.add(port.subject)
            hearing = [one for one in self._devices.values() if any(self._told_on(one.node_id, port.subject))]
            fields = {"value": self._groups.readiness(port.subject, device, fields["value"], hearing)}
        publishers = self._publishers.setdefault(device, {})
        if port not in publishers:
            made = self._node.presentation.make_publisher(class_of(port.type_name), port.subject)
            publishers[port] = made
        self._send(publishers[port], fields, urgent=urgent)

    def _vector_publisher(self, subject: int, type_name: str) -> Publisher[Any]:
        has = self._vectors.get(subject)
        if has is None or has[0] != type_name:
            if has is not None:
                has[1].close()  # the library has one type for a subject
            has = self._vectors[subject] = (
                type_name,
                self._node.presentation.make_publisher(class_of(type_name), subject),
            )
        return has[1]

    @staticmethod
    def _send(publisher: Publisher[Any], fields: Builtin, *, urgent: bool) -> None:
        publisher.priority = Priority.EXCEPTIONAL if urgent else Priority.NOMINAL
        publisher.publish_soon(nunavut_support.update_from_builtin(publisher.dtype(), fields))

    def write(self, device: CyphalNode, setting: RegisterSetting, value: Value) -> None:
        """See `SubjectBus`."""
        self._written[device.node_id, setting.register] = value
        self._begin(device.node_id, self._write(device, setting, value))

    def restart(self, node_id: int) -> None:
        """See `SubjectBus`."""
        self._begin(node_id, self._command(node_id, RESTART, "restart"))

    def update(self, device: CyphalNode, image: str) -> None:
        """See `SubjectBus`."""
        assert self._software is not None
        node_id, unique = device.node_id, device.identity.unique
        ended = partial(self._updated, device)
        begin = self._software.begin(node_id, unique, image, before=self._versions[device], ended=ended)
        # It goes on while the node starts anew, which ends all other work for it.
        self._begin(SERVER, begin)

    def _updated(self, device: CyphalNode, outcome: str) -> None:
        self._host.say(outcome)
        if self._devices.get(device.node_id) is device:
            device.not_updated(outcome)
        elif all(who[0] != device.identity.unique for who in self._who.values()):
            self._host.explain(device, outcome)

    def identify(self, node_id: int) -> None:
        """See `SubjectBus`."""
        self._begin(node_id, self._command(node_id, IDENTIFY, "show itself"))

    def news(self, device: ForeignDevice) -> None:
        """See `SubjectBus`."""
        self._host.news(device)

    # What takes time

    def _begin(self, node_id: int, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.create_task(work)
        tasks = self._tasks.setdefault(node_id, set())
        tasks.add(task)

        def ended(_: object) -> None:
            tasks.discard(task)
            if not task.cancelled() and (error := task.exception()) is not None:
                _log.warning("node %d: %s: %s", node_id, type(error).__name__, error)

        task.add_done_callback(ended)

    def _listen(self, device: CyphalNode, port: SubjectPort) -> None:
        assert port.subject is not None

        def hear(told: Any, transfer: TransferFrom) -> None:  # noqa: ANN401
            if transfer.source_node_id == device.node_id and device.node_id not in self._doubtful:
                fresh = self._fresh.setdefault(device, FreshReports())
                is_old = fresh.is_old(device.stop_number, port, float(transfer.timestamp.monotonic))
                device.heard(port, told, is_old=is_old)

        subscriber = self._node.presentation.make_subscriber(class_of(port.type_name), port.subject)
        self._subscribers.setdefault(device, []).append(subscriber)
        subscriber.receive_in_background(hear)

    async def _give_subjects(self, device: CyphalNode) -> None:
        """Give subjects to ports that have none, and have the node restart, as it has to for that."""
        node_id = device.node_id
        without = [port for port in device.used if port.subject is None]
        if lost := next((port for port in without if not port.is_kept), None):
            device.failed(f"node {node_id} has no subject in {lost.register}, and does not keep one that it is given")
            return
        if device.identity.unique in self._given:
            device.failed(f"node {node_id} has not kept the subject that it was given in {without[0].register}")
            return
        subjects = self._subjects.give(device.identity.unique, [port.register for port in without])
        for port in without:
            subject = subjects.get(port.register)
            answer = (
                None if subject is None else await self._registers.write(node_id, port.register, "natural16", subject)
            )
            if subject is not None and answer is None:
                device.failed(f"node {node_id} does not answer when it is given subject {subject} in {port.register}")
                await asyncio.sleep(GIVE_AGAIN_S)  # when it is lost meanwhile, this ends
                device.failed("")
                return
            if answer is None or answer.values != (subject,):
                device.failed(f"node {node_id} does not take subject {subject} in {port.register}")
                return
        self._given[device.identity.unique] = node_id
        if len(self._given) > MOST_GIVEN:
            del self._given[next(iter(self._given))]
        await self._registers.command(node_id, STORE)  # some keep what they were given only then
        self._host.say(f"{device.identity.part_number} (node {node_id}): its ports get subjects, and it restarts")
        # A restart is seen by the time since the start, in whole seconds.
        while self._tracker.registry[node_id].heartbeat.uptime < SEEN_UPTIME_S:  # noqa: ASYNC110 - the library counts it
            await asyncio.sleep(REPEAT_S)
        if await self._registers.command(node_id, RESTART):
            await asyncio.sleep(RESTART_S)  # when it starts anew, this ends
        device.failed(f"node {node_id} has got subjects for its ports: switch it off and on")

    async def _command(self, node_id: int, command: int, what: str) -> None:
        if not await self._registers.command(node_id, command):
            self._host.say(f"node {node_id} does not {what} when it is told to")

    async def _write(self, device: CyphalNode, setting: RegisterSetting, value: Value) -> None:
        answer = await self._registers.write(device.node_id, setting.register, setting.kind, value)
        if self._written.get((device.node_id, setting.register)) != value:
            return  # another value was written since
        if answer is None:
            _log.warning("node %d has not answered that its %s is %s", device.node_id, setting.register, value)
        elif not is_as_written(answer, value):
            has = answer.values[0] if answer.values else "nothing"
            _log.warning("node %d does not take %s for %s; it has %s", device.node_id, value, setting.register, has)

    async def _repeat(self) -> None:
        while True:
            await asyncio.sleep(REPEAT_S)
            self._repeated.clear()
            if self._software is not None:
                self._software.look()
            for device in list(self._devices.values()):
                device.repeat()


def _source(transfer: TransferFrom) -> int:
    """Who has sent it; -1: a node without an id."""
    return -1 if transfer.source_node_id is None else int(transfer.source_node_id)


def _who(info: Any) -> Who:  # noqa: ANN401
    """What tells a device from others: its unique id, and its name, as there may be none."""
    return bytes(info.unique_id), bytes(info.name)


def unique_of(node_id: int, info: Any) -> bytes:  # noqa: ANN401
    """The unique id of a node; one that has none is where it is."""
    unique = bytes(info.unique_id)
    return unique if any(unique) else b"node %d" % node_id


def _subjects_of(ports: Iterable[SubjectPort]) -> list[int]:
    return [one.subject for one in ports if one.subject is not None]


def class_of(type_name: str) -> Any:  # noqa: ANN401
    """The library's class of a data type: `uavcan.si.unit.length.Scalar.1.0`."""
    *path, name, major, minor = type_name.split(".")
    return getattr(importlib.import_module(".".join(path)), f"{name}_{major}_{minor}")


def identity_of(node_id: int, info: Any) -> DeviceIdentity:  # noqa: ANN401
    """Who a node says it is; its name is `com.maker.product`."""
    maker, _, product = bytes(info.name).decode(errors="replace").rpartition(".")
    hardware, software = info.hardware_version, info.software_version
    return DeviceIdentity(
        maker,
        product,
        unique_of(node_id, info),
        f"Cyphal {product} of {maker}",
        f"node {node_id}",
        f"{hardware.major}.{hardware.minor}",
        f"{software.major}.{software.minor}",
    )
