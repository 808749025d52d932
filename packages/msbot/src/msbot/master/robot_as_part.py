"""A robot that is a part of a bigger one: an arm with a master of its own fills one slot, as a servo would.

Its exported topics (`export = true` in the blueprint) are the ports of that part: one that a slot of this robot
publishes goes out, one to which nobody here publishes (`from = ""`) comes in. The bigger robot sees a part like any
other: it passes both steps, beats, gets a configuration, and STOP of the bigger robot is STOP here.
"""

from __future__ import annotations

import asyncio
import hashlib
from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import partial
from typing import Final

from msbot.config import Binding, Blueprint, Library, MessageType, Scalar
from msbot.master.master import Master
from msbot.part import JoinState, Message, NotSafeYet, Part
from msbot.part.join.pnp_messages import UID_OCTETS
from msbot.pnp import StopStatus
from msbot.service_types import service_type
from msbot.sim.model_part import message_class, message_of
from msbot_agent.link import Link
from msbot_agent.space import (
    DdsTopic,
    DdsTopicsOf,
    Qos,
    Reader,
    Sample,
    Space,
    SpaceAddress,
    Topic,
    Writer,
    open_space,
    robot_partition,
)
from msbot_agent.text.sentence import printable, said
from msbot_xrce.errors import ConfigError, LinkDown
from msbot_xrce.lazy import dataclass

_GUID: Final = bytes.fromhex("4d73424f5400000000000000776f726c")
"""The first writer's identity in the data space: `MsBOT`, `worl`; the further ones are counted from it."""
AGAIN_S: Final = 2.0
"""Pause before a link to the bigger robot that failed is tried again."""
CONFIRMED_S: Final = 0.02
"""Period in which is looked whether all parts here have confirmed STOP of the bigger robot."""
_IN: Final = (JoinState.CONFIGURING, JoinState.ACTIVE)


@dataclass(frozen=True, slots=True)
class ExportedPort:
    """A topic of this robot that is a port of the part that it is for a bigger one."""

    name: str
    message: type[Message]
    publishes: bool
    """Whether it goes from this robot to the bigger one."""
    reliable: bool
    safe: Message | None = None
    """What this robot's actuators get when the bigger robot is silent, or says STOP."""


def exported_ports(blueprint: Blueprint, library: Library) -> tuple[ExportedPort, ...]:
    """The ports that a robot has for a bigger one.

    Raises:
        ConfigError: it exports nothing, or a type that no part can describe.
    """
    ports = tuple(
        ExportedPort(
            binding.topic,
            _message_of(binding.topic, binding.type_name, library),
            bool(binding.source.slot),
            binding.reliable,
            None if binding.source.slot else _safe_of(blueprint, library, binding.topic),
        )
        for binding in blueprint.bindings
        if binding.in_dds.export
    )
    if not ports:
        raise ConfigError(
            f"robot {blueprint.robot.name} has nothing to offer a bigger robot: write export = true into each "
            "[[binding]] that shall be a port of it"
        )
    return ports


def _message_of(topic: str, type_name: str, library: Library) -> type[Message]:
    known = library.messages.get(type_name)
    if known is None:
        raise ConfigError(f"topic {topic!r} is exported, but the library does not know the fields of its {type_name}")
    return message_class(known)


def _safe_of(blueprint: Blueprint, library: Library, topic: str) -> Message | None:
    """The safe value of the ports that a topic leads to, if they have the same one."""
    found: list[tuple[MessageType, dict[str, Scalar]]] = []
    for binding in blueprint.bindings:
        for end in binding.targets if binding.topic == topic else ():
            slot = blueprint.slot(end.slot)
            part_type = None if slot is None else library.find(slot.part_number)
            port = None if part_type is None else part_type.port(end.port)
            safe = {} if slot is None or port is None else slot.safe_at(port)
            if port is None or not safe or port.message is None:
                return None
            found.append((port.message, dict(safe)))
    if not found or any(other != found[0] for other in found):
        return None
    return message_of(*found[0])


class RobotAsPart:
    """Runs a robot's master as a part of a bigger robot.

    Args:
        master: the robot that is the part.
        ports: what it has for the bigger one.
        number: the part number that it shows there.
        open_link: makes a new link to the bigger robot's master, for a part with that UID.
        say: called with what people should know, in words.
        key: the key with which it proves who it is, if the bigger robot asks for one.
    """

    def __init__(
        self,
        master: Master,
        ports: tuple[ExportedPort, ...],
        *,
        number: str,
        open_link: Callable[[bytes], Link],
        say: Callable[[str], object],
        key: bytes | None = None,
    ) -> None:
        self._master = master
        self._ports = ports
        self._open_link = open_link
        self._say: Callable[[str], object] = lambda words: say(printable(words))  # some are the bigger robot's
        self._is_stop_passed_on = False
        """This robot was told of the STOP that holds in the bigger one."""
        self._stop_number = 0
        """The STOP of this robot that the bigger one has said; 0 = none."""
        self._look: asyncio.TimerHandle | None = None
        profile = master.profile
        self.name = profile.name
        """What the part is called in the bigger robot."""
        identity = "\0".join((profile.name, profile.serial_number)).encode()
        self._uid = hashlib.sha256(identity).digest()[:UID_OCTETS]
        self.part = Part(
            number,
            local_name=profile.name,
            uid=self._uid,
            key=key,
            describes=f"The robot {profile.name}",
        )
        self._writers: list[Writer] = []
        self._readers: list[Reader] = []
        for port in ports:
            if port.publishes:
                self.part.publishes(port.name, port.message)
            else:
                self._take_in(port)
        self.part.safe_state(self._be_safe)
        self.part.on_go(self._go)
        self.part.on_join(self._joined)
        self.part.on_lost(self._lost)
        master.refuse_go(self._why_no_go)
        master.on_stop(self._go_here)

    async def run(self) -> None:
        """Be a part until cancelled; a bigger robot that is away, or a mistake there, does not end this one."""
        told = ""
        space = self._master.space
        for port in self._ports:
            if port.publishes:
                topic = Topic(port.name, port.message.type_name)
                self._readers.append(space.reader(topic, Qos(reliable=port.reliable), partial(self._give_out, port)))
        try:
            while True:
                try:
                    await self.part.run_async(self._open_link(self._uid))
                except (LinkDown, ConfigError) as error:
                    if str(error) != told:
                        told = str(error)
                        self._say(f"{self.name} is not a part of the bigger robot: {told}")
                await asyncio.sleep(AGAIN_S)
        finally:
            if self._look is not None:
                self._look.cancel()
            for reader in self._readers:
                reader.close()
            for writer in self._writers:
                writer.close()

    def _take_in(self, port: ExportedPort) -> None:
        """What the bigger robot says at a port goes to this robot's parts."""
        guid = _GUID[:-1] + bytes((len(self._writers),))
        topic = Topic(port.name, port.message.type_name)
        writer = self._master.space.writer(topic, Qos(reliable=port.reliable), guid)
        self._writers.append(writer)

        def take(message: Message) -> None:
            writer.write(message.encode())

        self.part.on(port.name, port.message, optional=True, safe=port.safe)(take)

    def _give_out(self, port: ExportedPort, sample: Sample) -> bool:
        """A sample of one of this robot's parts goes to the bigger robot, unless that does not use the port."""
        if self.part.state is JoinState.ACTIVE and self.part.bound(port.name):
            self.part.publish_octets(port.name, port.message.type_name, sample.payload)
        return True

    def _be_safe(self) -> None:
        """STOP of the bigger robot is STOP here, and confirmed there when all parts here have confirmed it.

        Raises:
            NotSafeYet: some have not.
        """
        if not self.part.stopped:
            return
        if self.part.state in _IN and not (self._is_stop_passed_on and self._master.stop.stopped):
            self._is_stop_passed_on = True
            self._pass_stop_on()
        if silent := self._master.stop.silent:
            if self._look is None:
                self._look = asyncio.get_running_loop().call_later(CONFIRMED_S, self._look_again)
            raise NotSafeYet(f"not confirmed here: {', '.join(silent)}")

    def _look_again(self) -> None:
        self._look = None
        self.part.is_safe_now()

    def _pass_stop_on(self) -> None:
        is_first = not self._master.stop.stopped  # a STOP that somebody here has said is theirs to end
        self._master.say_stop("the bigger robot", f"STOP was said there, where this robot is slot {self.part.slot}")
        if is_first:
            self._stop_number = self._master.stop.number

    def _why_no_go(self) -> str:
        """Why nobody here may say GO now; while the bigger robot is away, people here decide."""
        if not (self.part.stopped and self.part.state is JoinState.ACTIVE):
            return ""
        return said(
            "STOP holds in the bigger robot, where this robot is slot {slot}: say GO there", slot=str(self.part.slot)
        )

    def _go_here(self, status: StopStatus) -> None:
        """Whoever is here has ended STOP while the bigger robot is away: if it holds there, it is news when it is back,
        and confirmed anew."""
        if not status.stopped and self.part.stopped:
            self.part.end()

    def _go(self) -> None:
        """GO of the bigger robot ends only the STOP that it has said itself."""
        self._is_stop_passed_on = False
        status = self._master.stop
        if status.stopped and status.number == self._stop_number:
            try:
                self._master.say_go("the bigger robot")
            except ConfigError as error:  # a part here says STOP by itself
                self._say(f"{self.name} stays stopped: {error}")
        self._stop_number = 0

    def _joined(self) -> None:
        """A STOP that was over before the bigger robot was heard again is over here, too."""
        self._say(f"{self.name} is in slot {self.part.slot} of the bigger robot")
        if self._stop_number and not self.part.stopped:
            self._go()

    def _lost(self) -> None:
        self._say(f"{self.name} has lost the bigger robot, its ports have their safe values: {self.part.reason}")


# The names of a robot's topics in DDS: in its own partition, and those that the blueprint shares with others.


EVERYBODY = ""
"""The partition without a name, used by programs that name none."""


def robot_space(address: SpaceAddress, blueprint: Blueprint, library: Library) -> AbstractContextManager[Space]:
    """The data space for a robot, to be used with `with` on a running event loop.

    In DDS and Zenoh all its topics are in a partition of their own, so that robots do not hear each other.

    Raises:
        ConfigError: DDS is not available here, or a binding asks for something impossible in ROS 2; the text says what
            to do.
    """
    partition = robot_partition(address, blueprint.robot.name)
    return open_space(address, partition=partition, dds_topics_of=dds_topic_lookup(blueprint, library, partition))


def dds_topic_lookup(blueprint: Blueprint, library: Library, partition: str) -> DdsTopicsOf:
    """The names of each topic of a robot; in ROS 2 they are in its namespace, unless its blueprint says otherwise.

    Raises:
        ConfigError: ROS 2 has no form for a topic that should be shared with it; the text names topic and remedy.
    """
    known: dict[str, tuple[DdsTopic, ...]] = {}
    if any(binding.in_dds.ros and service_type(binding.type_name) is not None for binding in blueprint.bindings):
        from msbot.master.ros_services import ros_services  # with all messages of ROS 2, which few robots need

        for service in ros_services(blueprint, library):
            for topic, form in ((service.requests, service.form.request), (service.replies, service.form.reply)):
                known[topic.name] = (DdsTopic(topic.name, topic.type_name, type_hash=form.type_hash),)
    for binding in blueprint.bindings:
        if binding.topic not in known and service_type(binding.type_name) is None:
            known[binding.topic] = _dds_topics(binding, library, partition, blueprint.robot.name)

    def find(topic: Topic) -> tuple[DdsTopic, ...]:
        return known.get(topic.name) or (DdsTopic(topic.name, topic.type_name),)

    return find


def _dds_topics(binding: Binding, library: Library, partition: str, robot: str) -> tuple[DdsTopic, ...]:
    wish = binding.in_dds
    partitions = (partition, EVERYBODY) if wish.export else None
    found = [DdsTopic(binding.topic, binding.type_name, partitions)]
    if wish.ros:
        from msbot.ros2.forms import form_of, topic_name  # with all messages of ROS 2, which few robots need

        try:
            form = form_of(message_class(library.messages[binding.type_name]), wish.ros_type, dict(wish.ros_fields))
            name = topic_name(robot, wish.ros_topic or binding.topic)
        except ConfigError as error:
            raise ConfigError(f'the binding of "{binding.topic}" with ros = true: {error}') from None
        found.append(DdsTopic(name, form.theirs.type_name, (EVERYBODY,), form.outward, form.inward, form.type_hash))
    return tuple(found)
