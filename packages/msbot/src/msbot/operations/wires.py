"""Connects ports by topics, and disconnects them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from msbot.operations.changeable_robot import ChangeableRobot, endpoint_of
from msbot.operations.outcome import Outcome, outcome_of
from msbot.registry.edits import wires


class Wires:
    """Connects ports, written `SLOT.port`; parts of a running robot follow at once."""

    def __init__(self, robot: ChangeableRobot) -> None:
        self._robot = robot

    async def bind(
        self, topic: str, type_name: str, source: str | None, targets: Sequence[str], *, reliable: bool, move: bool,
        who: str,
    ) -> Outcome:  # fmt: skip
        """Connect ports by a topic, in addition to those that it already connects."""
        start = None if source is None else endpoint_of(self._robot, source)
        ends = [endpoint_of(self._robot, target) for target in targets]
        making = partial(wires.bind, topic=topic, type_name=type_name, source=start, targets=ends, reliable=reliable,
                         move=move)  # fmt: skip
        return outcome_of(await self._robot.change(who, making))

    async def unbind(self, topic: str, port: str | None, who: str) -> Outcome:
        """Disconnect a port, or all ports, from a topic."""
        end = None if port is None else endpoint_of(self._robot, port)
        return outcome_of(await self._robot.change(who, partial(wires.unbind, topic=topic, endpoint=end)))
