"""The figures as Prometheus reads them (text format, by `prometheus-client`)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, cast

from msbot.metrics.figures import AgentFigures, DatabaseFigures, Histogram, MomentFigures, PageFigures, RobotFigures
from msbot_xrce.errors import ConfigError

if TYPE_CHECKING:
    from prometheus_client import CollectorRegistry
    from prometheus_client.core import Metric

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
    octets = CounterMetricFamily("msbot_link_octets", "Octets on a link.", labels=["link", "direction"])
    lost = CounterMetricFamily("msbot_link_lost", "Packets that a link did not deliver or did not send.",
                               labels=["link", "reason"])  # fmt: skip
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
