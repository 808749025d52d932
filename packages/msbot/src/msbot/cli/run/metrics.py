"""The figures beside a running robot or agent, as `--metrics PORT` asks for them; a service of `msbot agent`."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Iterable, Mapping
from typing import TYPE_CHECKING, Any

from msbot.cli.robot_options import metrics_option
from msbot_agent.agent import Agent
from msbot_agent.cli.agent.agent_service import AgentContext
from msbot_agent.cli.services import Beside, CommandService

if TYPE_CHECKING:
    from msbot.master import Master
    from msbot.metrics import PageFigures
    from msbot.registry import Registry


def metrics_beside(
    port: int | None, agent: Agent, say: Callable[[str], None], *, master: Master | None = None,
    registry: Registry | None = None, page: Callable[[], PageFigures] | None = None,
) -> list[Coroutine[object, object, None]]:  # fmt: skip
    """What runs beside the robot to serve its figures; nothing when nobody has asked for them.

    Raises:
        ConfigError: the port cannot be had, or a package is missing.
    """
    if port is None:
        return []
    from msbot.metrics import Collecting, DatabaseFigures, MetricsServer, Noting
    from msbot.metrics.bus_meter import meter_of

    def database() -> DatabaseFigures:
        assert registry is not None
        health = registry.storage.health
        return DatabaseFigures(health.waiting, health.lost, health.is_well)

    noting = Noting(agent, master)
    links = agent.links if master is None else master.links
    # The page measures the bus already, if there is one.
    meter = meter_of(links, asyncio.get_running_loop().time) if page is None else None
    collecting = Collecting(
        agent,
        master=master,
        database=None if registry is None else database,
        page=page,
        noting=noting,
        bus=meter,
    )
    server = MetricsServer(collecting, noting, port)
    say(f"Figures for Prometheus are at {server.address}")
    return [server.run()]


class AgentMetrics(CommandService[int, AgentContext]):
    """`msbot agent ... --metrics PORT`."""

    options = (metrics_option,)

    def check(self, given: Mapping[str, Any]) -> int | None:
        """The port; None: no figures are wanted."""
        port: int | None = given["metrics_port"]
        return port

    def beside(self, wanted: int, context: AgentContext) -> Iterable[Beside]:
        """What serves the figures."""
        return metrics_beside(wanted, context.agent, context.say)


AGENT_METRICS = AgentMetrics()
