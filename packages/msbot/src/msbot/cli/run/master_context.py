"""What a service gets to know of the master that it runs beside."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import field
from typing import TYPE_CHECKING

from msbot.config import Library
from msbot.master import Master
from msbot.operations.dispatch import RunningOperations
from msbot.registry import Registry, RobotRecord
from msbot_agent.agent import Agent
from msbot_agent.cli.services import ServedCommand
from msbot_agent.link import Link
from msbot_agent.space import SpaceAddress
from msbot_xrce.common.lazy_dataclass import dataclass

if TYPE_CHECKING:
    from msbot.metrics import PageFigures


def _no_page() -> str:
    return ""


@dataclass(slots=True)
class MasterContext:
    """The running robot."""

    master: Master
    operations: RunningOperations
    library: Library
    registry: Registry
    robot: RobotRecord
    """The robot in the database."""
    db: str
    """The database as it was named."""
    links: Sequence[Link]
    space: SpaceAddress
    say: Callable[[str], None]
    """Says a line to the person at the terminal."""
    offers: dict[str, object] = field(default_factory=dict)
    """What services have for those that come after them, by the name of the service."""
    page_address: Callable[[], str] = _no_page
    """Where the robot's page is, for other programs; empty: it has none."""
    page_figures: Callable[[], PageFigures] | None = None
    """How the page is; None: there is none."""

    @property
    def agent(self) -> Agent:
        """The master's agent."""
        return self.master.agent

    @property
    def ready(self) -> asyncio.Event:
        """Set when the robot is up."""
        return self.master.ready


class MasterCommand(ServedCommand):
    """A command that runs a master."""

    group = "services"
