"""A simulated Cyphal servo: it follows its angle while it is ENGAGED, and reports position and feedback."""

from __future__ import annotations

import math
from typing import Any, Final

import reg.udral.service.actuator.common
import reg.udral.service.common
import uavcan.si.sample.angle
import uavcan.si.unit.angle

from msbot_bridges.cyphal.aspect import ENGAGED, STANDBY
from msbot_bridges.cyphal.simulated.library_node import PERIOD_S, LibraryNode

SPEED: Final = "profile.velocity"
"""A register: how quickly it turns, in turns a minute."""
TIMEOUT_PERIODS: Final = 10
"""It goes to STANDBY when it has not been told for so long that it is to be ready."""


class SimulatedCyphalServo(LibraryNode):
    """The servo."""

    product = "simcyphalservo"

    def set_up(self, node: Any) -> None:  # noqa: ANN401
        """See `LibraryNode`."""
        self.setting(SPEED, "natural16", 30, 1, 300)
        self.position = self._target = 0.0
        """In radians."""
        self.readiness, self._silent = STANDBY, 0
        self.is_stuck = False
        """It obeys nobody."""
        readiness = reg.udral.service.common.Readiness_0_1
        self._feedback = self.port(node.make_publisher, reg.udral.service.actuator.common.Feedback_0_1, "feedback")
        self._position = self.port(node.make_publisher, uavcan.si.sample.angle.Scalar_1_0, "position")
        if (angle := self.port(node.make_subscriber, uavcan.si.unit.angle.Scalar_1_0, "angle")) is not None:
            angle.receive_in_background(self._told)
        if (ready := self.port(node.make_subscriber, readiness, "readiness")) is not None:
            ready.receive_in_background(self._made_ready)

    def live(self) -> None:
        """See `LibraryNode`."""
        self._silent += 1
        if self._silent > TIMEOUT_PERIODS:
            self.readiness = STANDBY
        most = self.speed / 60 * 2 * math.pi * PERIOD_S
        if self.readiness == ENGAGED:
            self.position += max(-most, min(most, self._target - self.position))
        if self._position is not None:
            self._position.publish_soon(uavcan.si.sample.angle.Scalar_1_0(radian=self.position))
        if self._feedback is not None:
            told = reg.udral.service.actuator.common.Feedback_0_1()
            told.heartbeat.readiness.value = self.readiness
            self._feedback.publish_soon(told)

    @property
    def speed(self) -> int:
        """The value of its register."""
        return int(self.node.registry[SPEED])

    def _told(self, told: Any, _: object) -> None:  # noqa: ANN401
        if not self.is_stuck and math.isfinite(told.radian):
            self._target = float(told.radian)

    def _made_ready(self, told: Any, _: object) -> None:  # noqa: ANN401
        self._silent = 0
        if not self.is_stuck:
            self.readiness = int(told.value)
