"""What services of `msbot agent` can do besides running beside it: stand before its data space, or make the agent."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from msbot_agent.agent import Agent, AgentSettings, AgentSignalHandler
from msbot_agent.cli.command_services import Beside, CommandService, ServedCommand, W
from msbot_agent.link import Link
from msbot_agent.space import Space
from msbot_xrce import References
from msbot_xrce.lazy import dataclass


@dataclass(frozen=True, slots=True)
class AgentPlan:
    """What an agent is made of."""

    space: Space
    link: Link
    open_for: Callable[[int], Link]
    """Makes the link anew for the robot whose profile has that hash."""
    settings: AgentSettings
    references: References | None
    on_signal: AgentSignalHandler
    say: Callable[[str], None]
    """For the person at the terminal, who may have asked for silence (`-v 0`)."""


@dataclass(frozen=True, slots=True)
class AgentContext:
    """What a service gets to know of the agent that it runs beside."""

    agent: Agent
    links: tuple[Link, ...]
    space: Space
    ready: asyncio.Event
    """Set when the link is up."""
    say: Callable[[str], None]
    """Says a line to the person at the terminal."""


class AgentService(CommandService[W, AgentContext]):
    """A service that changes how an agent is made."""

    def space(self, wanted: W, space: Space) -> Space:  # noqa: ARG002 - for those that need it
        """The data space for the agent, made from the one that it would have."""
        return space

    def agent(self, wanted: W, plan: AgentPlan) -> tuple[Agent, Beside] | None:  # noqa: ARG002 - as above
        """An agent of another kind, and what runs it; None: the usual one will do."""
        return None


class AgentCommand(ServedCommand):
    """A command that runs an agent."""

    group = "agent_services"
