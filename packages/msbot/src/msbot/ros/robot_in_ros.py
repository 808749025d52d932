"""A robot in ROS 2: a node for the robot and one for each part, with diagnostics, parameters, description and clock.

A part is a node, not only the robot: parts come and go by themselves, `ros2 node info /ROVER/knob` then shows the ports
of that part alone, and parameters in ROS 2 belong to a node, as ours belong to a slot. The node has the slot's name, so
that it stays the same when the part in it is swapped.
"""

from __future__ import annotations

import asyncio
import secrets
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from xml.etree import ElementTree

from msbot.config import Blueprint
from msbot.master import Master
from msbot.master.ros_services import RosService, ros_services
from msbot.operations.dispatch import InProcessOperations
from msbot.part import Message
from msbot.part.join.part_log import LogLevel
from msbot.pnp import PartEvent
from msbot.pnp.model import ProgramLogLine
from msbot.ros.diagnostics import diagnostics, stamp
from msbot.ros.parameter_server import ParameterServer, asker_from_ros
from msbot.ros.ros_log import ERROR, INFO, WARN, RosLog
from msbot.ros.service_client import ServiceClient
from msbot.ros.service_server import ServiceServer
from msbot.ros2 import Clock, DiagnosticArray, String
from msbot_agent.ros.graph import EVERYBODY, LAST_ONE, RosGraph, node_of_participant
from msbot_agent.ros.node_names import NodeName, robot_node, slot_nodes, topic_of
from msbot_agent.space import OwnEndpoint, Owner, Qos, SharedSpace, Topic, Writer
from msbot_agent.text.untrusted_input import open_input_file
from msbot_xrce.errors import ConfigError

DIAGNOSTICS_S = 1.0
"""Period of the topic `diagnostics`, as usual in ROS."""
CLOCK_S = 0.1
"""Period of the topic `clock`."""

_LEVELS = {LogLevel.INFO: INFO, LogLevel.WARNING: WARN, LogLevel.ERROR: ERROR}

TEN = Qos(depth=10, partitions=EVERYBODY)


def is_in_ros(blueprint: Blueprint) -> bool:
    """Whether a robot shows itself to ROS 2: it shares a topic with it, or has options for it."""
    ros = blueprint.ros
    return bool(ros.urdf) or ros.clock or any(binding.in_dds.ros for binding in blueprint.bindings)


def shown_slots(blueprint: Blueprint) -> list[str]:
    """The slots that are nodes: those at the ends of topics with `ros = true`, in the order of the blueprint."""
    ends = {end.slot for binding in blueprint.bindings if binding.in_dds.ros for end in binding.ends}
    return [slot.name for slot in blueprint.slots if slot.name in ends]


class RobotInRos:
    """Shows a running robot to ROS 2. Must be made on its event loop; `run` does the work."""

    def __init__(
        self,
        master: Master,
        operations: InProcessOperations,
        space: SharedSpace,
        *,
        description: str = "",
        epoch_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        """Begin to tell the nodes.

        Args:
            master: the robot.
            operations: what can be done to it.
            space: where its topics are.
            description: its URDF; empty: it has none.
            epoch_ns: the robot's time.
        """
        blueprint = master.blueprint
        self._master = master
        self._space = space
        self._description = description
        self._epoch_ns = epoch_ns
        self._clock = asyncio.get_running_loop().time
        self._is_shown = is_in_ros(blueprint)
        self._robot = robot_node(blueprint.robot.name)
        self._slots = slot_nodes(blueprint.robot.name, shown_slots(blueprint))
        self._nodes: dict[str, NodeName] = {}
        """The slots whose parts are registered now."""
        self._parameters = ParameterServer(
            space, operations, asker_from_ros(may_set=blueprint.ros.parameters == "set"), epoch_ns
        )
        self._log = RosLog(space, self._robot, self._clock, epoch_ns) if self._is_shown else None
        self._services: dict[str, list[RosService]] = {}
        """By the slot that serves."""
        self._clients: list[ServiceClient] = []
        self._server: ServiceServer | None = None
        if self._log is not None and operations.library is not None:
            self._server = ServiceServer(operations, space, asker_from_ros(may_set=True), self._log)
            for service in ros_services(blueprint, operations.library):
                if service.binding.source.slot:
                    self._services.setdefault(service.binding.source.slot, []).append(service)
                else:
                    self._clients.append(ServiceClient(master, space, service, self._robot, self._log))
        self._graph = RosGraph(space, node_of=self._node_of, standing=self._standing)
        master.inventory.on_event(self._part_changed)
        master.inventory.log.on_line(self._program_said)
        master.inventory.on_rights(self._rights_changed)
        for slot in self._slots:
            self._look_at(slot)

    async def run(self) -> None:
        """Serve until cancelled."""
        try:
            async with asyncio.TaskGroup() as tasks:
                tasks.create_task(self._parameters.run())
                if self._is_shown:
                    tasks.create_task(self._diagnose())
                if self._master.blueprint.ros.clock:
                    tasks.create_task(self._tell_time())
                if self._description:
                    text: type[Message] = String
                    self._writer("robot_description", text, LAST_ONE).write(String(data=self._description).encode())
        finally:
            if self._server is not None:
                self._server.close()
            for client in self._clients:
                client.close()
            if self._log is not None:
                self._log.close()
            self._graph.close()

    # Nodes.

    def _standing(self) -> Iterable[NodeName]:
        return (self._robot, *self._nodes.values()) if self._is_shown else ()

    def _node_of(self, endpoint: OwnEndpoint) -> NodeName | None:
        if endpoint.owner.client == 0:
            # What nobody is named for is the master's own: what the page shows and the recorder keeps.
            return node_of_participant(endpoint) or (self._robot if self._is_shown else None)
        configuration = self._master.inventory.configuration_of(endpoint.owner.client)
        if configuration is None:
            return node_of_participant(endpoint)
        return self._slots.get(configuration.slot) or node_of_participant(endpoint)

    def _part_changed(self, event: PartEvent) -> None:
        if event.slot is not None and event.slot in self._slots:
            self._look_at(event.slot)
        self._graph.changed()

    def _program_said(self, line: ProgramLogLine) -> None:
        if self._log is not None:
            self._log.write(self._slots.get(line.slot, self._robot), _LEVELS[line.level], line.words)

    def _look_at(self, slot: str) -> None:
        """Bring the node of a slot in line with the inventory."""
        holder = self._master.inventory.holder(slot, self._clock())
        is_there = holder is not None and holder.state.is_registered
        if is_there and slot not in self._nodes:
            self._nodes[slot] = self._slots[slot]
            self._parameters.open(slot, self._slots[slot])
            for service in self._services.get(slot, ()):
                assert self._server is not None
                self._server.offer(service, self._slots[slot])
        elif not is_there and slot in self._nodes:
            del self._nodes[slot]
            self._parameters.close(slot)
            for service in self._services.get(slot, ()):
                assert self._server is not None
                self._server.withdraw(service)

    def _rights_changed(self, client: int) -> None:
        """The configuration of a part may have changed, and with it the values of its parameters."""
        configuration = self._master.inventory.configuration_of(client)
        if configuration is not None:
            self._parameters.changed(configuration.slot)

    # Topics.

    def _writer(self, topic: str, message: type[Message], qos: Qos) -> Writer:
        owner = Owner(participant=str(self._robot))
        wanted = self._master.blueprint.ros.global_topics
        name = topic_of(self._master.blueprint.robot.name, f"/{topic}" if topic in wanted else topic)
        return self._space.writer(Topic(name, message.type_name), qos, secrets.token_bytes(16), owner)

    async def _diagnose(self) -> None:
        writer = self._writer("diagnostics", DiagnosticArray, TEN)
        blueprint = self._master.blueprint
        slots = [slot.name for slot in blueprint.slots]
        while True:
            parts = self._master.inventory.view(self._clock())
            told = diagnostics(blueprint.robot.name, slots, parts, self._master.stop, self._epoch_ns())
            writer.write(told.encode())
            await asyncio.sleep(DIAGNOSTICS_S)

    async def _tell_time(self) -> None:
        writer = self._writer("clock", Clock, TEN)
        while True:
            writer.write(Clock(clock=stamp(self._epoch_ns())).encode())
            await asyncio.sleep(CLOCK_S)


# The robot's description for ROS 2: the URDF file that the blueprint names, as it is.


LARGEST = 1 << 20
"""Octets; a description only names its meshes, so it is far smaller."""


def read_description(blueprint: Blueprint) -> str:
    """The text for `/robot_description`; empty if the blueprint names no file. Reads a file: not for an event loop.

    Raises:
        ConfigError: the file cannot be read, is too large, or is no URDF; the text says which.
    """
    if not blueprint.ros.urdf:
        return ""
    folder = Path() if blueprint.source is None else blueprint.source.parent
    path = folder / blueprint.ros.urdf
    where = f'[ros] urdf = "{blueprint.ros.urdf}"'
    try:
        with open_input_file(path) as file:
            octets = file.read(LARGEST + 1) or b""
    except OSError as error:
        raise ConfigError(
            f"{where}: {path} cannot be read ({error.strerror}): name a URDF file beside the blueprint"
        ) from error
    if len(octets) > LARGEST:
        raise ConfigError(
            f"{where}: {path} has more than {LARGEST} bytes: name meshes in it instead of containing them"
        )
    try:
        text = octets.decode()
        root = ElementTree.fromstring(octets)
    except (UnicodeDecodeError, ElementTree.ParseError) as error:
        raise ConfigError(f"{where}: {path} is not XML in UTF-8 ({error}): a URDF file is needed") from error
    if root.tag != "robot" or "\0" in text:
        raise ConfigError(f"{where}: {path} is not URDF: it begins with <{root.tag}>, not with <robot>")
    return text
