"""Lines for /rosout, where all nodes of ROS 2 log."""

from __future__ import annotations

import secrets
from collections.abc import Callable
from typing import Final

from msbot.ros.diagnostics import stamp
from msbot.ros2 import Log
from msbot_agent.pace import TokenBucket
from msbot_agent.ros.graph import EVERYBODY
from msbot_agent.ros.node_names import NodeName
from msbot_agent.space import Owner, Qos, Space, Topic

INFO, WARN, ERROR = 20, 30, 40
"""Levels of `rcl_interfaces/msg/Log`."""

PER_S: Final = 20.0
BURST: Final = 100.0
_QOS: Final = Qos(transient_local=True, depth=100, late_depth=100, lifespan_s=10.0, partitions=EVERYBODY)
"""As the nodes of ROS 2 have it, with fewer lines kept."""


class RosLog:
    """Writes the lines of a robot's nodes.

    Args:
        space: where the topic is.
        robot: the robot's node, to which the writer belongs.
        clock: seconds, for the rate.
        epoch_ns: wall clock for the lines.
    """

    def __init__(self, space: Space, robot: NodeName, clock: Callable[[], float], epoch_ns: Callable[[], int]) -> None:
        owner = Owner(participant=str(robot))
        self._writer = space.writer(Topic("rt/rosout", Log.type_name), _QOS, secrets.token_bytes(16), owner)
        self._clock = clock
        self._epoch_ns = epoch_ns
        self._rate = TokenBucket(PER_S, BURST, clock())
        self.dropped = 0
        """Lines that came too fast."""

    def write(self, node: NodeName, level: int, words: str) -> None:
        """A node logs a line; one that comes too fast is counted instead."""
        if not self._rate.take(self._clock()):
            self.dropped += 1
            return
        name = str(node).strip("/").replace("/", ".")
        line = Log(stamp=stamp(self._epoch_ns()), level=level, name=name, msg=words, file="", function="", line=0)
        self._writer.write(line.encode())

    def close(self) -> None:
        """Leave the topic."""
        self._writer.close()
