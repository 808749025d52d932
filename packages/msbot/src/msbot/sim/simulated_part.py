"""A simulated part of any library type: it joins its robot over a link like a real one, and a person can play with it.

Nothing about the robot is simulated: the part goes through both steps, sends beats, gets its settings and obeys STOP.
Only the world behind it (the air, the light, the motor) is simulated, in `msbot.sim.part_model`.
"""

from __future__ import annotations

from collections.abc import Mapping
from random import Random

from msbot.config import Control, Library, PartType, Scalar, load_library
from msbot.part import ExpectedRobot
from msbot.part.join.pnp_messages import Nature
from msbot.sim.model_part import ModelPart
from msbot_xrce.errors import ConfigError

ANY_ROBOT = "*"


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
        uid: 8 octets; drawn when the part runs if absent.
        local_name: what this part is called; the part number if absent.
        random: the source of noise and of whatever the part draws; a seeded one makes a run repeatable.
        library: where the number is looked up; MsBOT's own if absent.
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


class SimulatedPart(ModelPart):
    """A part with its little world; made by `make_simulator`."""

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
        super().__init__(part_type, number, uid=uid, local_name=local_name, random=random, robot=robot)
        self.part.nature = Nature.SIMULATED
        self._controls = {control.name: control for control in self._simulator.controls}
        if self._simulator.outputs:
            self.part.every(self._tick_s())(self._say)
            self._ticks = self.part.program.timed[-1]

    @property
    def controls(self) -> tuple[Control, ...]:
        """What a person can do to the device."""
        return self._simulator.controls

    def set(self, name: str, value: Scalar) -> None:
        """Do something to the device: press, turn, warm.

        Raises:
            ConfigError: there is no such control, or it cannot have that value.
        """
        control = self.control(name)
        if fault := control.fault(value):
            raise ConfigError(f"control {name} {fault}")
        self._world.set(name, value, self._time())
        self._world.note_changes()
        self._resume()

    def set_all(self, values: Mapping[str, Scalar]) -> None:
        """Set several controls at once, to values that they can have: what a world does to the device."""
        changed = {name: value for name, value in values.items() if self._world.value(name) != value}
        if changed:
            self._world.feed(changed, self._time())
            self._world.note_changes()
            self._resume()

    def source(self, name: str) -> Scalar:
        """The value of a reading, shown or hidden, now."""
        self._take_settings()
        self._world.advance(self._time())
        return self._world.value(name)

    def control(self, name: str) -> Control:
        """The control of that name.

        Raises:
            ConfigError: there is no such control.
        """
        if name not in self._controls:
            known = ", ".join(self._controls) or "it has none"
            raise ConfigError(f"part {self.part_type.number} has no control {name!r}; controls: {known}")
        return self._controls[name]

    def value(self, name: str) -> Scalar:
        """The present value of a control.

        Raises:
            ConfigError: there is no such control.
        """
        return self._world.value(self.control(name).name)
