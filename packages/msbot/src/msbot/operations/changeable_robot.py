"""What the operations that work on any robot need from it, whether its master is running or not."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol, TypeVar

from msbot.config import Library, SlotPort
from msbot.operations.part_names import one_slot
from msbot.registry import EditRecord, Registry, RobotRecord
from msbot.registry.edits.editing import Making
from msbot_agent.text.sentence import said
from msbot_xrce.errors import ConfigError

_T = TypeVar("_T")


class ChangeableRobot(Protocol):
    """A running robot, or the database of one that is not running."""

    @property
    def library(self) -> Library | None:
        """The part types of a running robot."""

    def slot_names(self) -> Sequence[str]:
        """Its slots, in the order of the blueprint."""

    async def read(self, read: Callable[[Registry, RobotRecord], _T]) -> _T:
        """Read something from the database.

        Raises:
            ConfigError: there is no database.
            RegistryError: it cannot be read.
        """

    async def change(self, who: str, making: Making) -> EditRecord:
        """Make a change in the database; parts whose configuration changes get the new one.

        Raises:
            ConfigError: there is no database, or the change makes no sense.
            RegistryError: it cannot be stored; nothing has changed.
        """


def slot_of(robot: ChangeableRobot, name: str) -> str:
    """The slot of that name; case does not matter if the name is unambiguous.

    Raises:
        NotThere: there is none.
    """
    return one_slot(name, robot.slot_names())


def endpoint_of(robot: ChangeableRobot, text: str) -> SlotPort:
    """The port written as `SLOT.port`.

    Raises:
        ConfigError: it is not a port, or there is no such slot.
    """
    slot, _, port = text.rpartition(".")
    if not slot or not port:
        raise ConfigError(said("{text!r} is not a port: write SLOT.port, for example AA.out", text=text))
    return SlotPort(slot_of(robot, slot), port)
