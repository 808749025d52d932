"""A part that behaves like the model in its type's file: ports, settings and safe values are connected to the model.

The model is the type's simulator. A simulated part just runs it; a part with real hardware (`msbot.hardware`) feeds
measured values into it and drives what it computes: one place says what `invert`, `ramp` or `offset` mean.
"""

from __future__ import annotations

import asyncio
import types
from collections.abc import Mapping
from enum import IntEnum
from functools import cache
from random import Random
from typing import Annotated, Any, Protocol

from msbot.config import (
    BoundedText,
    Direction,
    EnumType,
    FieldKind,
    FieldType,
    ListType,
    MessageType,
    Operand,
    PartType,
    Port,
    Scalar,
    Simulator,
)
from msbot.part import ExpectedRobot, JoinState, Message, Part
from msbot.part.messages.leaves import leaves_of, with_leaves
from msbot.part.messages.standard import STANDARD_MESSAGES
from msbot.part.messages.wire_types import (
    AtMost,
    Exactly,
    float32,
    float64,
    int8,
    int16,
    int32,
    int64,
    uint8,
    uint16,
    uint32,
    uint64,
)
from msbot.part.program import Every
from msbot.sim.part_model import PartModel
from msbot_agent.process.timer_grid import first_time

# Message classes for the types that a library declares: the standard ones, or generated.


ANNOTATIONS: dict[FieldKind, object] = {
    FieldKind.BOOL: bool,
    FieldKind.UINT8: uint8,
    FieldKind.UINT16: uint16,
    FieldKind.UINT32: uint32,
    FieldKind.UINT64: uint64,
    FieldKind.INT8: int8,
    FieldKind.INT16: int16,
    FieldKind.INT32: int32,
    FieldKind.INT64: int64,
    FieldKind.FLOAT32: float32,
    FieldKind.FLOAT64: float64,
    FieldKind.TEXT: str,
}
"""The Python type of each kind of field."""

_made: dict[tuple[str, tuple[tuple[str, tuple[tuple[str, str], ...]], ...]], type[Message]] = {}


def message_class(message: MessageType) -> type[Message]:
    """The class of a message type; the same class for the same name and fields."""
    standard = STANDARD_MESSAGES.get(message.name)
    if standard is not None:
        return standard
    key = (message.name, tuple(message.described().items()))
    if key not in _made:
        _made[key] = _make(message)
    return _made[key]


def message_of(message: MessageType, leaves: Mapping[str, Scalar]) -> Message:
    """A message of a type with these leaves; the others are zero.

    Raises:
        LocalProtocolError: one cannot have this value.
    """
    return with_leaves(message_class(message), leaves)


@cache
def _enum(name: str, names: tuple[str, ...]) -> type[IntEnum]:
    """The class of an enum; one for all types that have it in a field."""
    make: Any = IntEnum  # a type checker wants its name and its members written here
    made: type[IntEnum] = make(name, {one.upper(): number for number, one in enumerate(names)})
    return made


def _annotation(kind: FieldType) -> object:
    """What Python writes for a kind of field."""
    match kind:
        case BoundedText():
            return Annotated[str, AtMost(kind.most)]
        case EnumType():
            return _enum(kind.name, tuple(kind.names))
        case ListType():
            inside: Any = _annotation(kind.element)
            return Annotated[list[inside], Exactly(kind.most) if kind.is_fixed else AtMost(kind.most)]
        case MessageType():
            return message_class(kind)
        case _:
            return ANNOTATIONS[kind]


def _make(message: MessageType) -> type[Message]:
    body = {
        "__annotations__": {name: _annotation(kind) for name, kind in message.fields.items()},
        "__doc__": message.description or f"Messages of type {message.name}.",
        "type_name": message.name,
    }
    made = types.new_class(message.name, (Message,), exec_body=lambda namespace: namespace.update(body))
    assert issubclass(made, Message)
    return made


SHORTEST_TICK_S = 0.02
LONGEST_TICK_S = 0.1
"""Longest period of checks for something to say or move; a part that speaks often checks more often."""
CHANGE_TICK_S = 0.05
"""Longest time until a change is published."""
LATE_S = 0.03
"""A simulated part that is called so late on average runs in a process with more work than time. It speaks less often
then, so that STOP and the parts that are real do not wait for it."""
GIVE_WAY = 10.0
"""It rests for so many times as long as it is late."""
LONGEST_REST_S = 0.5


class Distortion(Protocol):
    """What a part says in place of what its sensor shows: for faults on purpose."""

    def __call__(self, port: str, fields: Mapping[str, Scalar], now: float) -> Mapping[str, Scalar]:
        """The fields of a message that the port publishes now."""


class ModelPart:
    """A part connected to its model. Use it in the thread of its loop."""

    def __init__(
        self,
        part_type: PartType,
        number: str,
        *,
        uid: bytes | None,
        local_name: str | None,
        random: Random,
        robot: str | ExpectedRobot,
        ideal: bool = False,
    ) -> None:
        """Make the part.

        Args:
            part_type: its type.
            number: the part number that it shows, perhaps with a version.
            uid: 8 octets, or None.
            local_name: what this part is called.
            random: the source of noise and of whatever the part draws.
            robot: the robot it is made for.
            ideal: the model adds no noise and no lag, see `PartModel`.
        """
        self.part_type = part_type
        self.part = Part(number, local_name=local_name, robot=robot, uid=uid, random=random)
        """The part itself: run it with `await part.run_async(link)`, end it with `part.end()`."""
        self._simulator = part_type.simulator or Simulator()
        self._world = PartModel(part_type, random, ideal=ideal)
        self._settings: dict[str, str] = {}
        self._now: float | None = None
        self._unsaid: tuple[str, ...] = ()
        """Ports that stay silent because nothing is known about them."""
        self.distort: Distortion | None = None
        """Changes what is published; None: nothing does."""
        self._classes = {port.name: message_class(port.message) for port in part_type.ports if port.message is not None}
        self._stops = {port.name: port.stop for port in part_type.ports if port.stop}
        """Ports of STOP buttons, and the field that says whether one is pressed."""
        for port in part_type.ports:
            if port.direction is Direction.SUBSCRIBE and port.name in self._classes:
                self._listen(port)
        self._ticks: Every | None = None
        """Calls `_say`; None: this part has its own clock, or nothing to say."""
        self.part.on_join(self._begin)
        self.part.program.add_action("configured", self._resume)
        self.part.safe_state(self._be_safe)

    def readings(self) -> Mapping[str, Scalar]:
        """What one would see or measure at the device now; units are in `part_type.simulator.readings`."""
        self._take_settings()
        self._world.advance(self._time())
        return self._world.readings()

    def _moved(self) -> None:
        """A message, a setting or a safe value has come; for subclasses that drive something."""

    def _listen(self, port: Port) -> None:
        message_type = self._classes[port.name]

        def take(message: Message) -> None:
            self._take_settings()
            if self._world.receive(port.name, leaves_of(message), self._time()):
                self._world.note_changes()
                if self._ticks is not None and self._ticks.is_resting:
                    self._ticks.resume(self._world.quiet_until(self._time(), self._is_heard))
            self._moved()

        self.part.on(port.name, message_type, optional=True)(take)

    def _begin(self) -> None:
        self._take_settings()
        # With the part's clock, so that the parts of one process speak in the same turns of its loop.
        self._world.join(self._time(), first_time(asyncio.get_running_loop()))

    def _be_safe(self) -> None:
        """Nobody is in command: apply the safe values of the robot's configuration, otherwise the library's.

        When only a port's partner is lost, the part stays active and has already given that port its safe value itself.
        """
        if self._is_commanded:
            return
        for port in self.part_type.ports:
            given = self.part.safe_value(port.name)
            safe = port.safe if given is None else leaves_of(given)
            if safe is not None:
                self._world.receive(port.name, safe, self._time(), counts=False)
        self._resume()

    @property
    def _is_commanded(self) -> bool:
        return self.part.state is JoinState.ACTIVE and not self.part.stopped

    def _say(self) -> None:
        """Publish what is due."""
        now = self._time()
        self._take_settings()
        self._world.advance(now)
        for port, fields in self._world.due_messages(now):
            if port in self._stops:
                self.part.hold_stop(bool(fields[self._stops[port]]))
            if self.part.bound(port) and port not in self._unsaid:
                told = fields if self.distort is None else self.distort(port, fields, now)
                self.part.publish(port, with_leaves(self._classes[port], told))
        ticks = self._ticks
        if ticks is not None:
            rest_until = self._world.quiet_until(now, self._is_heard)
            if ticks.late_s > LATE_S:
                rest_until = max(rest_until, now + min(ticks.late_s * GIVE_WAY, LONGEST_REST_S))
            ticks.rest_until(rest_until)

    def _is_heard(self, port: str) -> bool:
        """Whether the robot connects the port, or the part itself acts on what it says."""
        return port in self._stops or self.part.bound(port)

    def _resume(self) -> None:
        """Something has changed: it may have to be published before the clock says so."""
        if self._ticks is not None:
            self._ticks.resume()

    def _take_settings(self) -> None:
        """Apply the slot's settings; one that makes no sense here is the robot's mistake and changes nothing."""
        if self.part.settings == self._settings:
            return
        self._settings = dict(self.part.settings)
        for parameter in self.part_type.parameters:
            text = self._settings.get(parameter.name)
            value = None if text is None else parameter.kind.parse(text)
            if value is None or parameter.fault(value) is not None:
                value = parameter.default
            self._world.set(parameter.name, value, self._time())
        self._world.note_changes()

    def _tick_s(self) -> float:
        shortest = LONGEST_TICK_S
        for output in self._simulator.outputs:
            if output.on_change:
                shortest = min(shortest, CHANGE_TICK_S)
            if period_s := self._least(output.every):
                shortest = min(shortest, period_s)
        return max(SHORTEST_TICK_S, shortest)

    def _least(self, operand: Operand) -> float:
        """The lowest value that an operand can have, as far as the part type limits it."""
        if not isinstance(operand, str):
            return operand
        parameter = self.part_type.parameter(operand)
        if parameter is None or parameter.least is None:
            return 0.0
        return parameter.least

    def _time(self) -> float:
        """The loop's time; before there is a loop, time stands still."""
        try:
            now = asyncio.get_running_loop().time()
        except RuntimeError:
            return self._now or 0.0
        if self._now is None:
            self._world.start_at(now)
        self._now = now
        return now
