"""What a page looks at: the robot as it is, or as it was at a moment that a person has chosen.

Pages ask their sight and need not know which of the two it is; what changes the robot is refused while it is the past.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Generic, Protocol, TypeVar

from msbot_agent.text.sentence import said
from msbot_web.glances import ShownRobot
from msbot_web.models.bus_models import BusFigures, FrameLine
from msbot_web.models.robot_models import Robot, SlotCard, TopicLine, WirePort
from msbot_web.recorded_snapshot import RecordedSnapshot
from msbot_xrce.errors import NotThere

if TYPE_CHECKING:
    from msbot_web.service import Service


_T = TypeVar("_T")


class OfRobot(Generic[_T]):
    """Something that many pages need of the same snapshot of the robot: worked out once.

    Args:
        work: works it out; nobody changes what it returns.
    """

    def __init__(self, work: Callable[[ShownRobot], _T]) -> None:
        self._work = work
        self._known: tuple[ShownRobot, _T] | None = None

    def __call__(self, robot: ShownRobot) -> _T:
        """What the robot has of it."""
        known = self._known
        if known is None or known[0] is not robot:
            known = self._known = (robot, self._work(robot))
        return known[1]


class RobotView(Protocol):
    """The robot at one time."""

    def robot(self) -> Robot:
        """The robot with all its slots."""

    def glance(self) -> ShownRobot:
        """What pages look at all the time."""

    def slot(self, name: str) -> SlotCard:
        """One slot.

        Raises:
            NotThere: there is no such slot.
        """

    def topics(self) -> list[TopicLine]:
        """All bound topics."""

    def ports(self) -> list[WirePort]:
        """All ports of all slots, with the topics they are wired to."""

    def sparkline(self, topic: str) -> list[float]:
        """The first number on a topic over the minute before, oldest first."""

    def bus(self) -> BusFigures:
        """How busy the bus is."""

    def frame_lines(self, after: int, limit: int) -> list[FrameLine]:
        """The newest frames with a number above `after`, oldest first."""

    def frame_line(self, number: int) -> FrameLine | None:
        """One frame by its number, or None when it is no longer kept."""

    def frames_as_csv(self) -> str:
        """The frames as a table."""

    def frames_as_candump(self) -> str:
        """The frames as `candump -l` writes them."""


class LiveRobotView:
    """The robot as it is now."""

    def __init__(self, service: Service) -> None:
        self._service = service
        views = service.views
        self.slot = views.slot
        self.topics = views.topics
        self.ports = views.ports
        self.sparkline = views.sparkline
        self.bus = views.bus
        self.frame_lines = views.frame_lines
        self.frame_line = views.frame_line
        self.frames_as_csv = views.frames_as_csv
        self.frames_as_candump = views.frames_as_candump

    def robot(self) -> Robot:
        """See `RobotView.robot`."""
        return self._service.robot()

    def glance(self) -> ShownRobot:
        """See `RobotView.glance`."""
        return self._service.glance()


class PastRobotView:
    """The robot at a moment of the past."""

    def __init__(self, moment: RecordedSnapshot) -> None:
        self._moment = moment

    def robot(self) -> Robot:
        """See `RobotView.robot`."""
        return self._moment.robot

    def glance(self) -> ShownRobot:
        """See `RobotView.glance`."""
        return self._moment.robot

    def slot(self, name: str) -> SlotCard:
        """See `RobotView.slot`."""
        found = next((card for card in self._moment.robot.slots if card.name == name), None)
        if found is None:
            raise NotThere(said("there was no slot {name!r} at that time", name=name))
        return found

    def topics(self) -> list[TopicLine]:
        """See `RobotView.topics`."""
        return self._moment.topics

    def ports(self) -> list[WirePort]:
        """See `RobotView.ports`."""
        return self._moment.ports

    def sparkline(self, topic: str) -> list[float]:
        """See `RobotView.sparkline`."""
        return self._moment.sparks.get(topic, [])

    def bus(self) -> BusFigures:
        """See `RobotView.bus`."""
        return self._moment.bus

    def frame_lines(self, after: int, limit: int) -> list[FrameLine]:
        """See `RobotView.frame_lines`."""
        return [line for line in self._moment.frames if line.number > after][-limit:]

    def frame_line(self, number: int) -> FrameLine | None:
        """See `RobotView.frame_line`."""
        return next((line for line in self._moment.frames if line.number == number), None)

    def frames_as_csv(self) -> str:
        """See `RobotView.frames_as_csv`."""
        return self._moment.csv

    def frames_as_candump(self) -> str:
        """See `RobotView.frames_as_candump`."""
        return self._moment.candump
