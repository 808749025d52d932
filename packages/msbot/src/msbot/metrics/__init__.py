"""Figures of a running robot or agent, for Prometheus: collected when somebody asks, in the robot's own loop."""

from msbot.metrics.collecting import Collecting, MetricsSampler
from msbot.metrics.figures import AgentFigures, Buckets, DatabaseFigures, MomentFigures, PageFigures, RobotFigures
from msbot.metrics.serving import MetricsServer

__all__ = [
    "AgentFigures",
    "Buckets",
    "Collecting",
    "DatabaseFigures",
    "MetricsSampler",
    "MetricsServer",
    "MomentFigures",
    "PageFigures",
    "RobotFigures",
]
