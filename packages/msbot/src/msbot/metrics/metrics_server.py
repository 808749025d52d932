"""Serves the figures at a port of this computer: `--metrics PORT`.

The server of `prometheus-client` has a thread of its own; for each question it has the figures read in the robot's
loop, which takes some 0.1 ms, and writes the text in its thread. A robot that does not answer is not waited for.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Iterator
from concurrent.futures import TimeoutError as NoAnswer
from typing import TYPE_CHECKING, Any, Final, cast

from msbot.metrics.figures import AgentFigures, DatabaseFigures, Histogram, MomentFigures, PageFigures, RobotFigures
from msbot.metrics.metrics_collector import MetricsSampler
from msbot_xrce.errors import ConfigError

if TYPE_CHECKING:
    from prometheus_client import CollectorRegistry
    from prometheus_client.core import Metric


# The figures as Prometheus reads them (text format, by `prometheus-client`).


REMEDY = "pip install 'msbot[metrics]'"


def registry_of(read: Callable[[], MomentFigures]) -> CollectorRegistry:
    """A registry with these figures and those of the process; `read` is called for each question.

    Raises:
        ConfigError: the package is missing.
    """
    try:
        from prometheus_client import CollectorRegistry, ProcessCollector
    except ImportError:
        raise ConfigError(f"metrics need the package prometheus-client: {REMEDY}") from None

    class Robot:
        """What the registry asks."""

        def collect(self) -> Iterator[Metric]:
            return families(read())

        def describe(self) -> list[Metric]:
            return []  # else the registry would ask for figures at once

    registry = CollectorRegistry()
    registry.register(cast("Any", Robot()))  # it asks for nothing but these two methods
    ProcessCollector(registry=registry)
    return registry


def exposition(read: Callable[[], MomentFigures]) -> tuple[bytes, str]:
    """The text for one question, and its content type.

    Raises:
        ConfigError: the package is missing.
    """
    registry = registry_of(read)
    from prometheus_client import CONTENT_TYPE_LATEST, generate_latest

    return generate_latest(registry), CONTENT_TYPE_LATEST


def families(figures: MomentFigures) -> Iterator[Metric]:
    """All figures, grouped as Prometheus wants them."""
    yield from _agent(figures.agent)
    yield _gauge("msbot_loop_tasks", "Tasks of the event loop.", figures.tasks)
    if figures.robot is not None:
        yield from _robot(figures.robot)
        yield _counter("msbot_beats", "Beats of parts, since they are noted.", figures.beats)
    if figures.beat_intervals is not None:
        yield _histogram("msbot_beat_interval_seconds", "Time between two beats of a part.", figures.beat_intervals)
    if figures.loop_delays is not None:
        yield _histogram("msbot_loop_delay_seconds", "How late the event loop was.", figures.loop_delays)
    if figures.latencies is not None:
        words = "From a sample's arrival at the agent to its leaving for a reader; at most ten samples a second."
        yield _histogram("msbot_sample_latency_seconds", words, figures.latencies)
    if figures.acknowledgements is not None:
        words = "From a message's leaving for a client to its acknowledgement; at most one a second of each client."
        yield _histogram("msbot_acknowledgement_seconds", words, figures.acknowledgements)
    if figures.database is not None:
        yield from _database(figures.database)
    if figures.page is not None:
        yield from _page(figures.page)
    if figures.bus is not None:
        yield from _bus(figures.bus.name, figures.bus.load, figures.bus.bitrate)


def _agent(agent: AgentFigures) -> Iterator[Metric]:
    from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily

    sessions = GaugeMetricFamily("msbot_sessions", "DDS-XRCE sessions that are open.", labels=["link"])
    packets = CounterMetricFamily("msbot_link_packets", "Packets on a link.", labels=["link", "direction"])
    octets = CounterMetricFamily("msbot_link_octets", "Bytes on a link.", labels=["link", "direction"])
    lost = CounterMetricFamily(
        "msbot_link_lost", "Packets that a link did not deliver or did not send.", labels=["link", "reason"]
    )
    for link in agent.links:
        sessions.add_metric([link.name], link.sessions)
        packets.add_metric([link.name, "in"], link.packets_in)
        packets.add_metric([link.name, "out"], link.packets_out)
        octets.add_metric([link.name, "in"], link.octets_in)
        octets.add_metric([link.name, "out"], link.octets_out)
        for reason, count in link.lost.items():
            lost.add_metric([link.name, reason], count)
    foreign = CounterMetricFamily("msbot_agent_lost", "Packets that belonged to no session.", labels=["reason"])
    for reason, count in agent.lost.items():
        foreign.add_metric([reason], count)
    published = CounterMetricFamily("msbot_topic_published", "Samples that parts wrote.", labels=["topic"])
    delivered = CounterMetricFamily("msbot_topic_delivered", "Samples that were handed to parts.", labels=["topic"])
    for name, written, handed in agent.topics:
        published.add_metric([name], written)
        delivered.add_metric([name], handed)
    yield from (sessions, packets, octets, lost, foreign, published, delivered)


def _robot(robot: RobotFigures) -> Iterator[Metric]:
    from prometheus_client.core import GaugeMetricFamily, InfoMetricFamily

    parts = GaugeMetricFamily("msbot_parts", "Parts by state.", labels=["state"])
    for state, count in robot.parts.items():
        parts.add_metric([state], count)
    yield parts
    yield _gauge("msbot_slots", "Slots of the robot.", robot.slots)
    yield _gauge("msbot_stopped", "1 while STOP holds.", int(robot.stopped))
    yield InfoMetricFamily("msbot_robot", "The robot.", value={"robot": robot.name})


def _database(database: DatabaseFigures) -> Iterator[Metric]:
    yield _gauge("msbot_database_waiting", "Changes that wait to be stored.", database.waiting)
    yield _counter("msbot_database_lost", "Changes that could not be stored.", database.lost)
    yield _gauge("msbot_database_well", "1 when everything is stored or about to be.", int(database.is_well))


def _page(page: PageFigures) -> Iterator[Metric]:
    yield _gauge("msbot_page_sessions", "People and programs that are signed in.", page.sessions)
    yield _gauge("msbot_page_connections", "Connections to the page.", page.connections)
    if page.bus:
        yield from _bus(page.bus, page.bus_load, page.bus_bitrate)


def _bus(name: str, share: float, bits_per_second: int) -> Iterator[Metric]:
    from prometheus_client.core import GaugeMetricFamily

    words = "Share of the last second in which frames of the master and for it kept the bus busy, stuff bits included."
    load = GaugeMetricFamily("msbot_bus_load_ratio", words, labels=["bus"])
    load.add_metric([name], share)
    bitrate = GaugeMetricFamily("msbot_bus_bitrate", "Bits per second.", labels=["bus"])
    bitrate.add_metric([name], bits_per_second)
    yield from (load, bitrate)


def _gauge(name: str, words: str, value: float) -> Metric:
    from prometheus_client.core import GaugeMetricFamily

    return GaugeMetricFamily(name, words, value=value)


def _counter(name: str, words: str, value: float) -> Metric:
    from prometheus_client.core import CounterMetricFamily

    return CounterMetricFamily(name, words, value=value)


def _histogram(name: str, words: str, found: Histogram) -> Metric:
    from prometheus_client.core import HistogramMetricFamily

    return HistogramMetricFamily(name, words, buckets=list(found.rising), sum_value=found.total)


HOST: Final = "127.0.0.1"
ANSWER_S: Final = 5.0
"""How long a question waits for the robot's loop."""


class MetricsServer:
    """Serves the figures of one process.

    Args:
        read: reads the figures, in the loop.
        noting: what is noted as long as it serves.
        port: of 127.0.0.1; 0: any free one.

    Raises:
        ConfigError: the port cannot be had, or a package is missing.
    """

    def __init__(self, read: Callable[[], MomentFigures], noting: MetricsSampler, port: int) -> None:
        self._read = read
        self._noting = noting
        self._loop = asyncio.get_running_loop()
        registry = registry_of(self._ask)
        from prometheus_client import start_http_server

        try:
            self._server, self._thread = start_http_server(port, addr=HOST, registry=registry)
        except OSError as error:
            raise ConfigError(
                f"metrics cannot be served on {HOST} port {port} ({error.strerror}): choose another one with --metrics"
            ) from None

    @property
    def address(self) -> str:
        """Where they are."""
        return f"http://{HOST}:{self._server.server_port}/metrics"

    async def run(self) -> None:
        """Serve until cancelled."""
        try:
            await self._noting.run()
        finally:
            # Its thread may be waiting for this loop: another one tells it to end.
            with contextlib.suppress(asyncio.CancelledError):
                await asyncio.to_thread(self._end)

    def _end(self) -> None:
        self._server.shutdown()
        self._server.server_close()

    def _ask(self) -> MomentFigures:
        """Have the figures read by the robot; called in the server's thread."""
        asked = asyncio.run_coroutine_threadsafe(self._answer(), self._loop)
        try:
            return asked.result(ANSWER_S)
        except NoAnswer:
            asked.cancel()
            raise

    async def _answer(self) -> MomentFigures:
        return self._read()
