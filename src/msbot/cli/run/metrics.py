"""The figures beside a running robot or agent, as `--metrics PORT` asks for them."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from typing import TYPE_CHECKING

from msbot.agent import Agent

if TYPE_CHECKING:
    from msbot.master import Master
    from msbot.registry import Registry
    from msbot.web.assembly import WebRoom


def metrics_beside(
    port: int | None, agent: Agent, say: Callable[[str], None], *, master: Master | None = None,
    registry: Registry | None = None, room: Callable[[], WebRoom | None] = lambda: None,
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
    meter = meter_of(links, asyncio.get_running_loop().time) if room() is None else None
    collecting = Collecting(
        agent,
        master=master,
        database=None if registry is None else database,
        page=lambda: None if (page := room()) is None else page.figures(),
        noting=noting,
        bus=meter,
    )
    server = MetricsServer(collecting, noting, port)
    say(f"Figures for Prometheus are at {server.address}")
    return [server.run()]
