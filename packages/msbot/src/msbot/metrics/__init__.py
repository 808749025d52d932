"""Metrics of a running robot or agent, for Prometheus."""

from msbot.metrics.figures import AgentFigures, Buckets, DatabaseFigures, MomentFigures, PageFigures, RobotFigures
from msbot.metrics.metrics_collector import MetricsCollector, MetricsSampler
from msbot.metrics.metrics_server import MetricsServer

__all__ = [
    "AgentFigures",
    "Buckets",
    "DatabaseFigures",
    "MetricsCollector",
    "MetricsSampler",
    "MetricsServer",
    "MomentFigures",
    "PageFigures",
    "RobotFigures",
]
