"""A part of any library type, simulated: it joins its robot over a link as real ones do; a person plays with it.

Nothing about the robot is simulated: the part goes through both steps, beats, gets its settings and obeys STOP. Only
the world behind it (the air, the light, the motor) is, in `msbot.sim.simulated_world`.
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from random import Random

from msbot.config import Control, Direction, Library, Operand, PartType, Port, Scalar, Simulator, load_library
from msbot.errors import ConfigError
from msbot.part import ExpectedRobot, JoinState, Message, Part
from msbot.part.messages.message import fields_of
from msbot.sim.message_classes import message_class
from msbot.sim.simulated_world import World

ANY_ROBOT = "*"
SHORTEST_TICK_S = 0.02
LONGEST_TICK_S = 0.1
"""A simulated part looks whether it has something to say that often, by how often it speaks."""
CHANGE_TICK_S = 0.05
"""Longest time until a change is said."""


def make_simulator(
    number: str | PartType,
    *,
    uid: bytes | None = None,
    local_name: str | None = None,
    random: Random | None = None,
    library: Library | None = None,
    robot: str | ExpectedRobot = ANY_ROBOT,
) -> SimulatedPart:
    """A simulated part, ready to run.

    Args:
        number: a part number of the library, or the part type itself.
        uid: 8 octets; drawn when it runs if absent.
        local_name: what this one is called; the part number if absent.
        random: noise, and what the part draws; a seeded one makes it repeatable.
        library: where the number is looked up; that of MsBOT if absent.
        robot: the robot it is made for; any if absent.

    Raises:
        ConfigError: the library has no such number, or a name is too long.
    """
    if isinstance(number, PartType):
        part_type = number
    else:
        part_type = (load_library() if library is None else library).require(number)
    shown = number if isinstance(number, str) else part_type.number
    return SimulatedPart(part_type, shown, uid=uid, local_name=local_name, random=random or Random(), robot=robot)


class SimulatedPart:
    """A part with its little world; made by `make_simulator`. Use it in the thread of its loop."""

    def __init__(
        self,
        part_type: PartType,
        number: str,
        *,
        uid: bytes | None,
        local_name: str | None,
        random: Random,
        robot: str | ExpectedRobot,
    ) -> None:
        self.part_type = part_type
        self.part = Part(number, local_name=local_name, robot=robot, uid=uid, random=random)
        """The part itself: run it with `await part.run_async(link)`, end it with `part.end()`."""
        self._simulator = part_type.simulator or Simulator()
        self._controls = {control.name: control for control in self._simulator.controls}
        self._world = World(part_type, random)
        self._settings: dict[str, str] = {}
        self._now: float | None = None
        self._classes = {port.name: message_class(port.message) for port in part_type.ports if port.message is not None}
        self._wire()

    @property
    def controls(self) -> tuple[Control, ...]:
        """What a person can do to the thing."""
        return self._simulator.controls

    def set(self, name: str, value: Scalar) -> None:
        """Do something to the thing: press, turn, warm.

        Raises:
            ConfigError: there is no such control, or it cannot have that value.
        """
        control = self.control(name)
        if fault := control.fault(value):
            raise ConfigError(f"control {name} {fault}")
        self._world.set(name, value, self._time())
        self._world.look()

    def control(self, name: str) -> Control:
        """The control of that name.

        Raises:
            ConfigError: there is none.
        """
        if name not in self._controls:
            known = ", ".join(self._controls) or "it has none"
            raise ConfigError(f"part {self.part_type.number} has no control {name!r}; controls: {known}")
        return self._controls[name]

    def value(self, name: str) -> Scalar:
        """How a control stands now.

        Raises:
            ConfigError: there is no such control.
        """
        return self._world.value(self.control(name).name)

    def readings(self) -> Mapping[str, Scalar]:
        """What one would see or measure at the thing now; units are in `part_type.simulator.readings`."""
        self._take_settings()
        self._world.advance(self._time())
        return self._world.readings()

    def _wire(self) -> None:
        part = self.part
        for port in self.part_type.ports:
            if port.direction is Direction.SUBSCRIBE and port.name in self._classes:
                self._listen(port)
        part.on_join(self._begin)
        part.safe_state(self._be_safe)
        if self._simulator.outputs:
            part.every(self._tick_s())(self._tick)

    def _listen(self, port: Port) -> None:
        message_type = self._classes[port.name]
        names = [field.name for field in fields_of(message_type)]

        def take(message: Message) -> None:
            self._take_settings()
            fields: dict[str, Scalar] = {name: getattr(message, name) for name in names}
            self._world.receive(port.name, fields, self._time())
            self._world.look()

        self.part.on(port.name, message_type, optional=True)(take)

    def _begin(self) -> None:
        self._take_settings()
        self._world.join(self._time())

    def _be_safe(self) -> None:
        """Nobody is in command: the library's safe values hold, whatever the robot's configuration said.

        When only a port's partner is lost the part stays active, and has given that port its safe value itself.
        """
        if self.part.state is JoinState.ACTIVE and not self.part.stopped:
            return
        for port in self.part_type.ports:
            if port.safe is not None:
                self._world.receive(port.name, port.safe, self._time(), counts=False)

    def _tick(self) -> None:
        now = self._time()
        self._take_settings()
        self._world.advance(now)
        for port, fields in self._world.say(now):
            if self.part.bound(port):
                self.part.publish(port, self._classes[port](**fields))

    def _take_settings(self) -> None:
        """Let the slot's settings hold; what makes no sense here is the robot's mistake and changes nothing."""
        if self.part.settings == self._settings:
            return
        self._settings = dict(self.part.settings)
        for parameter in self.part_type.parameters:
            text = self._settings.get(parameter.name)
            value = None if text is None else parameter.kind.parse(text)
            if value is None or parameter.fault(value) is not None:
                value = parameter.default
            self._world.set(parameter.name, value, self._time())
        self._world.look()

    def _tick_s(self) -> float:
        shortest = LONGEST_TICK_S
        for output in self._simulator.outputs:
            if output.on_change:
                shortest = min(shortest, CHANGE_TICK_S)
            if period_s := self._least(output.every):
                shortest = min(shortest, period_s)
        return max(SHORTEST_TICK_S, shortest)

    def _least(self, operand: Operand) -> float:
        """The least number an operand can be, as far as the part type says so."""
        if not isinstance(operand, str):
            return operand
        parameter = self.part_type.parameter(operand)
        if parameter is None or parameter.least is None:
            return 0.0
        return parameter.least

    def _time(self) -> float:
        """The loop's time; before there is a loop, no time passes."""
        try:
            now = asyncio.get_running_loop().time()
        except RuntimeError:
            return self._now or 0.0
        if self._now is None:
            self._world.start_at(now)
        self._now = now
        return now
