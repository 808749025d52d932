"""The service `fed` of `msbot agent`: its clients are parts of a robot whose master runs elsewhere, `--master`."""

from __future__ import annotations

import math
import platform
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import click

from msbot_agent.agent import Agent, AgentSettings
from msbot_agent.cli.agent.agent_service import AgentPlan, AgentService
from msbot_agent.cli.services import Beside
from msbot_agent.link import open_link
from msbot_agent.space import MEMORY, SpaceAddress
from msbot_xrce.common.lazy_dataclass import dataclass
from msbot_xrce.errors import ConfigError


@dataclass(frozen=True, slots=True)
class MasterElsewhere:
    """A master that feeds this agent's gate."""

    address: str
    name: str
    """What it calls this agent."""


def wished_master(address: str | None, name: str | None, space: SpaceAddress) -> MasterElsewhere | None:
    """What `--master` and `--name` say.

    Raises:
        ConfigError: they make no sense, or not with `--space`.
    """
    if address is None:
        if name is not None:
            raise ConfigError("--name is what a master calls this agent: say with --master ADDRESS where that is")
        return None
    if space.kind != MEMORY:
        raise ConfigError(
            "with --master the topics go to the robot's master: leave --space out here, and give it to `msbot master`"
        )
    open_link(address)  # report mistakes before anything runs
    return MasterElsewhere(address, name or platform.node() or "agent")


def fed_settings(settings: AgentSettings) -> AgentSettings:
    """The same for an agent of a robot: a client that is silent is removed, as at a master."""
    if settings.dead_after_s < math.inf:
        return settings
    return replace(settings, dead_after_s=AgentSettings().dead_after_s)


class Fed(AgentService[MasterElsewhere]):
    """`msbot agent ... --master ADDRESS`."""

    options = (
        click.option("--master", metavar="ADDRESS", help="Bring the clients as parts to the robot's master at ADDRESS, "
                     "for example udp:192.168.1.20:8888, which decides who is let in."),
        click.option("--name", metavar="NAME", help="With --master: what it calls this agent when it says where a part "
                     "is; the computer's name by default."),
    )  # fmt: skip

    def check(self, given: Mapping[str, Any]) -> MasterElsewhere | None:
        """The master that feeds it."""
        return wished_master(given["master"], given["name"], given["space"])

    def agent(self, wanted: MasterElsewhere, plan: AgentPlan) -> tuple[Agent, Beside]:
        """An agent whose gate that master feeds."""
        from msbot.master.fed_agent import FedAgent  # here, because an agent starts without all that a master needs

        fed = FedAgent(
            plan.open_for, open_link(wanted.address), name=wanted.name, say=plan.say, space=plan.space,
            settings=fed_settings(plan.settings), references=plan.references, on_signal=plan.on_signal,
        )  # fmt: skip
        plan.say(f"agent {wanted.name} looks for the robot's master on {wanted.address}; Ctrl-C ends it")
        return fed.agent, fed.run()


FED = Fed()
