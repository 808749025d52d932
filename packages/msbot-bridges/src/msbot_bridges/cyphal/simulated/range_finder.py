"""A simulated Cyphal range finder: it publishes the distance to something that comes and goes."""

from __future__ import annotations

import math
from typing import Any, Final

import uavcan.si.sample.length
import uavcan.time

from msbot_bridges.cyphal.simulated.library_node import PERIOD_S, LibraryNode

REACH: Final = "ranging.reach"
"""A register: what is farther away is not seen, in metres."""
SWING_S: Final = 8.0


class SimulatedRange(LibraryNode):
    """The range finder."""

    product = "simrange"

    def set_up(self, node: Any) -> None:  # noqa: ANN401
        """See `LibraryNode`."""
        self.setting(REACH, "real32", 4.0, 0.1, 8.0)
        self._publisher = self.port(node.make_publisher, uavcan.si.sample.length.Scalar_1_0, "distance")
        self._time = 0.0

    def live(self) -> None:
        """See `LibraryNode`."""
        self._time += PERIOD_S
        metres = 1.0 + 0.5 * math.sin(2 * math.pi * self._time / SWING_S)
        if self._publisher is not None:
            seen = metres if metres <= self.reach else math.nan
            self._publisher.publish_soon(uavcan.si.sample.length.Scalar_1_0(meter=seen))

    @property
    def reach(self) -> float:
        """The value of its register."""
        return float(self.node.registry[REACH])
