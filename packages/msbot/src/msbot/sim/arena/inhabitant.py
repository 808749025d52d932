"""What an arena and a simulated part have to do with each other: what the part does, and what it is shown."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Protocol

from msbot.config import Control, PartType
from msbot.sim.simulated_reading import as_number

Sensed = float | bool


class Inhabitant(Protocol):
    """A part in a world: in this process, or in another one."""

    def doing(self) -> Mapping[str, float]:
        """What it does now, by the words of `DRIVES`."""

    def sense(self, values: Mapping[str, Sensed]) -> None:
        """Show it what it senses now, by the words of `SENSES`."""


class Simulates(Protocol):
    """The face of a `SimulatedPart` that is needed here."""

    @property
    def part_type(self) -> PartType:
        """Its type."""

    def source(self, name: str) -> object:
        """The value of one of its readings now."""

    def set_all(self, values: Mapping[str, bool | int | float | str]) -> None:
        """Set several controls at once."""


def quantities_of(part_type: PartType) -> tuple[str, ...]:
    """What parts of that type sense and do in a world; nothing: they have no place in one."""
    simulator = part_type.simulator
    if simulator is None:
        return ()
    senses = [control.senses for control in simulator.controls if control.senses]
    return (*senses, *(reading.drives for reading in simulator.readings if reading.drives))


class SimulatedInhabitant:
    """A simulated part of this process in a world.

    What the world shows it sets its controls, within their limits; what its readings say is what it does.
    """

    def __init__(self, simulated: Simulates) -> None:
        simulator = simulated.part_type.simulator
        self._simulated = simulated
        controls = () if simulator is None else simulator.controls
        readings = () if simulator is None else simulator.readings
        self._controls = {control.senses: control for control in controls if control.senses}
        self._drives = {reading.drives: reading.name for reading in readings if reading.drives}

    def doing(self) -> Mapping[str, float]:
        """See `Inhabitant.doing`."""
        found = {}
        for quantity, reading in self._drives.items():
            value = self._simulated.source(reading)
            found[quantity] = as_number(value) if isinstance(value, bool | int | float | str) else 0.0
        return found

    def sense(self, values: Mapping[str, Sensed]) -> None:
        """See `Inhabitant.sense`."""
        wanted: dict[str, bool | int | float | str] = {}
        for quantity, value in values.items():
            control = self._controls.get(quantity)
            if control is None:
                continue
            wanted[control.name] = value if isinstance(value, bool) else _within(control, value)
        self._simulated.set_all(wanted)


def _within(control: Control, value: float) -> float:
    """The nearest value that a control can have."""
    least = -math.inf if control.least is None else control.least
    most = math.inf if control.most is None else control.most
    return min(most, max(least, value))
