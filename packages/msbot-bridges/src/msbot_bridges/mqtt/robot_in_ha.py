"""A robot in Home Assistant: a device for each slot, with its values; commands drive ports by hand.

Home Assistant drives a port as a person does at the page: the port's wire is not heard meanwhile, the ranges of the
port hold, and during STOP nothing is driven. All ports that it holds are let go when the broker or Home Assistant
itself is gone, so that nobody drives a robot who does not see it.
"""

from __future__ import annotations

import asyncio
import json
import logging
from collections.abc import Mapping
from typing import Any

from msbot.master import Master
from msbot.operations.dispatch import InProcessOperations
from msbot.operations.message_classes import MessageClasses
from msbot.operations.rights import Principal, Right, role_named
from msbot.part.messages.leaves import leaves_of
from msbot_agent.space import Qos, Reader, Sample, Topic
from msbot_bridges.mqtt.broker import Broker, BrokerAddress, LastWill
from msbot_bridges.mqtt.ha_components import (
    Shown,
    base_topic,
    command_value,
    config_topic,
    robot_fields,
    shown_fields,
    state_text,
    topic_word,
)
from msbot_xrce.errors import ConfigError, MsbotError, RemoteProtocolError
from msbot_xrce.lazy import dataclass

NAME = "Home Assistant"
LOOK_S = 0.5
"""Period in which values and states are compared with what was told."""
HOLD_S = 3600.0
"""So long a port is held that Home Assistant drives."""
MOST_COMMANDS = 100
"""Ports for which a command waits; further ones are dropped."""
LONGEST_COMMAND = 1000

_log = logging.getLogger("msbot.bridges")


def home_assistant() -> Principal:
    """Who asks: nobody knows who has touched its screen, so it may do what a student may."""
    role = role_named("student")

    def require(right: Right) -> None:
        if role < right.least:
            raise ConfigError(f"{NAME} may do what a student may, and not this")

    return Principal(NAME, require, lambda right: role >= right.least)


class _Heard:
    """The newest sample of a topic."""

    def __init__(self, type_name: str) -> None:
        self.type_name = type_name
        self.payload = b""
        self.reader: Reader | None = None

    def deliver(self, sample: Sample) -> bool:
        self.payload = sample.payload
        return True


@dataclass(frozen=True, slots=True)
class _Slot:
    number: str
    heard: frozenset[str]
    shown: list[Shown]


class RobotInHa:
    """Shows a running robot. Must be made on its event loop; `run` does the work.

    Args:
        master: the robot.
        operations: what can be done to it.
        address: the broker.
        prefix: Home Assistant's discovery prefix.
    """

    def __init__(
        self, master: Master, operations: InProcessOperations, address: BrokerAddress, prefix: str = "homeassistant"
    ) -> None:
        self._master = master
        self._operations = operations
        self._prefix = prefix
        self._clock = asyncio.get_running_loop().time
        self._robot = master.blueprint.robot.name
        self._base = base_topic(self._robot)
        self._class_of = MessageClasses(lambda: operations.library)
        self._who = home_assistant()
        self._slots: dict[str, _Slot] = {}
        self._own = robot_fields(self._robot)
        self._heard: dict[str, _Heard] = {}
        self._told: dict[str, str] = {}
        """What was published last, by topic."""
        self._commands: dict[str, str] = {}
        """What waits to be done, by topic: the newest for each."""
        self._look = asyncio.Event()
        self._broker = Broker(
            address,
            on_message=self._message,
            on_connected=self._connected,
            on_lost=self._lost,
            on_leaving=lambda: self._tell(f"{self._base}/status", "offline"),
            will=LastWill(f"{self._base}/status", "offline"),
        )
        master.inventory.on_event(lambda _: self._look.set())
        master.on_stop(lambda _: self._look.set())

    async def run(self) -> None:
        """Show the robot until cancelled.

        Raises:
            LinkDown: the broker cannot be reached.
        """
        self._broker.subscribe([f"{self._base}/#", f"{self._prefix}/status"])
        try:
            async with asyncio.TaskGroup() as tasks:
                tasks.create_task(self._broker.run())
                tasks.create_task(self._follow())
        finally:
            self._let_all_go()
            for heard in self._heard.values():
                if heard.reader is not None:
                    heard.reader.close()

    async def _follow(self) -> None:
        while True:
            self._look.clear()
            self._listen()
            self._declare()
            self._tell_states()
            await self._do_commands()
            try:
                async with asyncio.timeout(LOOK_S):
                    await self._look.wait()
            except TimeoutError:
                pass

    # What is told

    def _listen(self) -> None:
        """Hear the topics of the blueprint in force."""
        wanted = {one.topic: one.type_name for one in self._master.blueprint.bindings if "->" not in one.type_name}
        for topic in [one for one, heard in self._heard.items() if wanted.get(one) != heard.type_name]:
            if (reader := self._heard.pop(topic).reader) is not None:
                reader.close()
        for topic, type_name in wanted.items():
            if topic not in self._heard:
                heard = self._heard[topic] = _Heard(type_name)
                qos = Qos(reliable=False, depth=1)
                heard.reader = self._master.space.reader(Topic(topic, type_name), qos, heard.deliver)

    def _declare(self) -> None:
        """Tell what is in each slot, when it is another part than before or has other wires."""
        library = self._operations.library
        names = [slot.name for slot in self._master.blueprint.slots]
        for slot in [one for one in self._slots if one not in names]:
            self._undeclare(self._slots.pop(slot), frozenset())
        for slot in names:
            holder = self._master.inventory.holder(slot, self._clock())
            part_type = None if holder is None or library is None else library.find(holder.part_number)
            if part_type is None:
                continue
            heard = frozenset(one.source.port for one in self._master.blueprint.bindings if one.source.slot == slot)
            known = self._slots.get(slot)
            if known is not None and (known.number, known.heard) == (part_type.number, heard):
                continue
            shown = shown_fields(self._robot, slot, part_type, heard)
            if known is not None:
                self._undeclare(known, frozenset(config_topic(self._prefix, one) for one in shown))
            self._slots[slot] = _Slot(part_type.number, heard, shown)
            self._tell_declared(shown)

    def _tell_declared(self, shown: list[Shown]) -> None:
        for one in shown:
            self._tell(config_topic(self._prefix, one), json.dumps(one.config, ensure_ascii=False))

    def _undeclare(self, known: _Slot, kept: frozenset[str]) -> None:
        for one in known.shown:
            if (topic := config_topic(self._prefix, one)) not in kept:
                self._tell(topic, "")

    def _tell_states(self) -> None:
        self._tell(f"{self._base}/stopped", "ON" if self._master.stop.stopped else "OFF")
        by_hand = self._operations.by_hand.sent_values()
        for slot, known in self._slots.items():
            place = self._master.blueprint.slot(slot)
            holder = self._master.inventory.holder(slot, self._clock())
            is_there = holder is not None and holder.state.is_registered
            self._tell(f"{self._base}/{topic_word(slot)}/status", "online" if is_there else "offline")
            for one in known.shown:
                safe = one.safe if place is None else place.safe.get(one.port, {}).get(one.field, one.safe)
                if self._master.stop.stopped and one.is_driven and safe is not None:
                    values: Mapping[str, Any] = {one.field: safe}
                else:
                    values = by_hand.get((slot, one.port)) or self._on_wire(slot, one.port)
                text = state_text(values[one.field]) if one.field in values else None
                if text is not None and one.component != "button":
                    self._tell(one.topic, text)

    def _on_wire(self, slot: str, port: str) -> Mapping[str, Any]:
        """What the topic of a port carries, by field."""
        for binding in self._master.blueprint.bindings:
            if any((end.slot, end.port) == (slot, port) for end in binding.ends):
                heard = self._heard.get(binding.topic)
                message_class = None if heard is None else self._class_of(heard.type_name)
                if heard is None or message_class is None or not heard.payload:
                    return {}
                try:
                    return leaves_of(message_class.decode(heard.payload))
                except RemoteProtocolError:
                    return {}  # a stranger's octets; the page shows them
        return {}

    def _tell(self, topic: str, text: str) -> None:
        if self._told.get(topic) != text:
            self._told[topic] = text
            self._broker.publish(topic, text, is_kept=True)

    # The broker

    def _connected(self) -> None:
        """Tell everything anew: the broker may have lost what it had kept."""
        self._told.clear()
        self._tell(f"{self._base}/status", "online")
        self._tell_declared(self._own)
        for known in self._slots.values():
            self._tell_declared(known.shown)
        self._look.set()

    def _lost(self, why: str) -> None:
        _log.warning("%s: %s", NAME, why)
        self._let_all_go()

    def _message(self, topic: str, payload: bytes, is_old: bool) -> None:
        text = payload.decode(errors="replace")
        if topic == f"{self._prefix}/status":
            if text == "offline" and not is_old:
                _log.warning("%s is gone: what it drives is let go", NAME)
                self._let_all_go()
            return
        # What the broker has kept was said to somebody else, at another time.
        if is_old or not topic.endswith("/set") or len(text) > LONGEST_COMMAND:
            return
        if topic == f"{self._base}/stop/set":
            self._commands = {topic: text}  # nothing that was said before STOP is done after it
        elif topic in self._commands or len(self._commands) < MOST_COMMANDS:
            self._commands[topic] = text
        self._look.set()

    # What is done

    def _let_all_go(self) -> None:
        self._commands.clear()
        self._operations.by_hand.end_those_of([NAME])

    async def _do_commands(self) -> None:
        while self._commands:
            topic = next(iter(self._commands))
            text = self._commands.pop(topic)
            try:
                await self._do(topic, text)
            except MsbotError as error:
                _log.warning("%s: %s", NAME, error)
            # Its screen shows what it has asked for; what holds is told, also where that is what it was before.
            self._told.pop(topic.removesuffix("/set"), None)
            self._look.set()

    async def _do(self, topic: str, text: str) -> None:
        if topic == f"{self._base}/stop/set":
            await self._operations.do("stop", who=self._who, reason=f"said at {NAME}")
            return
        for known in self._slots.values():
            for one in known.shown:
                if one.is_driven and topic == f"{one.topic}/set":
                    port, values = f"{one.slot}.{one.port}", [command_value(one, text)]
                    await self._operations.do("publish", who=self._who, port=port, values=values, seconds=HOLD_S)
                    return
