"""Figures of a running robot or agent, for Prometheus: collected when somebody asks, in the robot's own loop."""

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
