"""What pages look at twice a second: less than cards, which are made only for whom something has changed.

A `Robot` with all its `SlotCard`s says everything, for the API. A glance says only what cards show, and costs a fifth.
Both can be drawn.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

from msbot_web.models.robot_models import PortLine, StopState
from msbot_xrce.lazy import dataclass


class ShownPart(Protocol):
    """A part, as far as a card shows it; the fields of a `PartLine`."""

    @property
    def part(self) -> str: ...
    @property
    def state(self) -> str: ...
    @property
    def nature(self) -> str: ...
    @property
    def life(self) -> int: ...
    @property
    def beats(self) -> int: ...
    @property
    def beat_age_s(self) -> float | None: ...


class ShownSlot(Protocol):
    """A slot, as far as a card shows it; the fields of a `SlotCard`."""

    @property
    def name(self) -> str: ...
    @property
    def shown_number(self) -> str: ...
    @property
    def type_name(self) -> str: ...
    @property
    def state(self) -> str: ...
    @property
    def reason(self) -> str: ...
    @property
    def part(self) -> ShownPart | None: ...
    @property
    def main_port(self) -> PortLine | None: ...
    @property
    def next_beat_s(self) -> float | None: ...
    @property
    def spares(self) -> Sequence[str]: ...
    @property
    def simulated(self) -> bool: ...
    @property
    def plugged(self) -> bool | None: ...
    @property
    def faults(self) -> Sequence[str]: ...
    @property
    def type_differences(self) -> Sequence[str]: ...


class ShownRobot(Protocol):
    """A robot, as far as pages show it all the time; the fields of a `Robot`."""

    @property
    def version(self) -> str: ...
    @property
    def serial_number(self) -> str: ...
    @property
    def manufacturer(self) -> str: ...
    @property
    def links(self) -> Sequence[str]: ...
    @property
    def beat_s(self) -> float: ...
    @property
    def stop(self) -> StopState: ...
    @property
    def trouble(self) -> str: ...
    @property
    def faults(self) -> Sequence[str]: ...
    @property
    def arrivals(self) -> int: ...
    @property
    def slots(self) -> Sequence[ShownSlot]: ...


@dataclass(slots=True)
class PartGlance:
    """See `ShownPart`."""

    part: str
    state: str
    nature: str
    life: int
    beats: int
    beat_age_s: float | None


class SlotGlance:
    """See `ShownSlot`.

    Args:
        port: finds the main port when it is asked for.
    """

    __slots__ = (
        "_main_port",
        "_port",
        "faults",
        "name",
        "next_beat_s",
        "part",
        "plugged",
        "reason",
        "shown_number",
        "simulated",
        "spares",
        "state",
        "type_differences",
        "type_name",
    )

    def __init__(
        self,
        *,
        name: str,
        shown_number: str,
        type_name: str,
        state: str,
        reason: str,
        part: PartGlance | None,
        next_beat_s: float | None,
        spares: list[str],
        plugged: bool | None,
        faults: list[str],
        type_differences: list[str],
        port: Callable[[], PortLine | None],
    ) -> None:
        self.name, self.shown_number, self.type_name = name, shown_number, type_name
        self.state, self.reason, self.part, self.next_beat_s = state, reason, part, next_beat_s
        self.spares, self.faults, self.type_differences = spares, faults, type_differences
        self.plugged, self.simulated = plugged, plugged is not None
        self._port: Callable[[], PortLine | None] | None = port
        self._main_port: PortLine | None = None

    @property
    def main_port(self) -> PortLine | None:
        """Worked out once."""
        if self._port is not None:
            self._main_port, self._port = self._port(), None
        return self._main_port


@dataclass(frozen=True, slots=True)
class RobotGlance:
    """See `ShownRobot`."""

    version: str
    serial_number: str
    manufacturer: str
    links: Sequence[str]
    beat_s: float
    stop: StopState
    trouble: str
    faults: Sequence[str]
    arrivals: int
    slots: Sequence[SlotGlance]
