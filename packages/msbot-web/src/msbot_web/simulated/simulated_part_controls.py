"""Simulated parts of this process as the page's `SimulatedControls`: the demo's, and stand-ins of a real robot."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from msbot.config import ControlKind
from msbot.sim import SimulatedPart
from msbot_agent.text.sentence import said
from msbot_web.models.robot_models import Scalar, SimulatedPartControl
from msbot_xrce.errors import ConfigError


class SimulatedPartTable(Protocol):
    """Simulated parts by the name of their slot: those of the demo, and stand-ins of a real robot."""

    @property
    def names(self) -> tuple[str, ...]:
        """Their slots."""

    def is_plugged(self, slot: str) -> bool:
        """Whether that part is on the wire."""

    def uid(self, slot: str) -> bytes:
        """Its UID, plugged in or not."""

    def plug(self, slot: str) -> object:
        """Plug it in."""

    def unplug(self, slot: str) -> object:
        """Pull it out."""

    def simulated(self, slot: str) -> SimulatedPart | None:
        """The part; None: it is pulled out, or has nothing to be played with."""


class SimulatedPartControls:
    """Simulated parts as the page's `SimulatedControls`."""

    def __init__(self, robot: SimulatedPartTable) -> None:
        self._robot = robot

    def slots(self) -> tuple[str, ...]:
        """See `SimulatedControls.slots`."""
        return self._robot.names

    def is_plugged(self, slot: str) -> bool:
        """See `SimulatedControls.is_plugged`."""
        return self._robot.is_plugged(slot)

    def uid(self, slot: str) -> bytes:
        """See `SimulatedControls.uid`."""
        return self._robot.uid(slot)

    def plug(self, slot: str) -> None:
        """See `SimulatedControls.plug`."""
        self._robot.plug(slot)

    def unplug(self, slot: str) -> None:
        """See `SimulatedControls.unplug`."""
        self._robot.unplug(slot)

    def controls(self, slot: str) -> tuple[SimulatedPartControl, ...]:
        """See `SimulatedControls.controls`; the thesis' three have none."""
        simulated = self._robot.simulated(slot)
        if simulated is None:
            return ()
        return tuple(
            SimulatedPartControl(
                name=control.name,
                kind=control.kind.value,
                least=control.least,
                most=control.most,
                unit=control.unit,
                choices=list(control.choices),
                words=control.words,
                value=simulated.value(control.name),
                momentary=control.momentary,
            )
            for control in simulated.controls
        )

    def operate(self, slot: str, control: str, value: Scalar) -> None:
        """See `SimulatedControls.operate`."""
        simulated = self._robot.simulated(slot)
        if simulated is None:
            raise ConfigError(said("part {slot} has nothing that could be operated, or is not plugged in", slot=slot))
        wanted = simulated.control(control)
        is_number = wanted.kind is ControlKind.NUMBER and isinstance(value, int) and not isinstance(value, bool)
        simulated.set(control, float(value) if is_number else value)

    def rest_value(self, slot: str, control: str) -> Scalar | None:
        """See `SimulatedControls.rest_value`."""
        simulated = self._robot.simulated(slot)
        controls = () if simulated is None else simulated.controls
        return next((one.start for one in controls if one.name == control and one.momentary), None)

    def readings(self, slot: str) -> Mapping[str, Scalar]:
        """See `SimulatedControls.readings`."""
        simulated = self._robot.simulated(slot)
        return {} if simulated is None else simulated.readings()

    def reading_words(self, slot: str) -> Mapping[str, tuple[str, str]]:
        """See `SimulatedControls.reading_words`."""
        simulated = self._robot.simulated(slot)
        simulator = None if simulated is None else simulated.part_type.simulator
        return {} if simulator is None else {one.name: (one.words, one.unit) for one in simulator.readings if one.words}
