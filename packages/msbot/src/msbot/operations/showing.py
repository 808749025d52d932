"""What helps people to find parts: a part shows itself, says why its state is what it is, or is hidden."""

from __future__ import annotations

import contextlib
import logging

from msbot.operations.outcome import Outcome
from msbot.operations.part_names import describe
from msbot.operations.running_robot import RunningRobot
from msbot.pnp import PartInfo
from msbot_agent.text.sentence import said
from msbot_xrce.errors import ConfigError, RegistryError

STORED_S = 2.0
"""Longest time that a caller waits until everything noted so far is stored."""

_log = logging.getLogger(__name__)


class Showing:
    """Changes nothing that is stored."""

    def __init__(self, running: RunningRobot) -> None:
        self._running = running
        self._ignored: set[bytes] = set()

    def identify(self, part: str, who: str) -> Outcome:
        """Have a part show itself: blink, beep, whatever it can."""
        info = self._running.part(part, prefer=lambda one: one.state.is_registered)
        if not self._running.master.inventory_service.identify(info.client_key):
            raise ConfigError(
                said("{part} cannot be told to show itself: its program speaks the thesis' layout only", part=info.part)
            )
        _log.info("%s has %s show itself", who, describe(info))
        return Outcome(said("{part} is told to show itself", part=info.part))

    async def stored(self) -> Outcome:
        """Wait a moment until everything the robot has noted is stored, for callers that then read the database."""
        registry = self._running.registry
        if registry is None:
            return Outcome(answer={"trouble": "", "waiting": 0})
        storage = registry.storage
        with contextlib.suppress(RegistryError):  # what is wrong is in the answer
            await storage.in_time(storage.flush, STORED_S)
        health = storage.health
        return Outcome(answer={"trouble": health.trouble or "", "waiting": health.waiting})

    def why(self, part: str) -> Outcome:
        """The state of a part and the rules that led to it, in sentences; none when no part is known by that word."""
        is_known = self._running.inventory.find(part, self._running.now())
        master = self._running.master
        return Outcome(answer={"lines": master.why(part) if is_known else [], "troubles": master.troubles(part)})

    def ignore(self, part: str, who: str) -> Outcome:
        """Hide a part that is not let in from the list of arrivals, until the master ends."""
        info = self._running.part(part, prefer=lambda one: not one.state.is_registered)
        self._ignored.add(_identity(info))
        _log.info("%s ignores %s", who, describe(info))
        return Outcome(said("{part} is no longer shown among the arrivals", part=info.part))

    def is_ignored(self, info: PartInfo) -> bool:
        """Whether somebody asked not to be shown this part among the arrivals."""
        return _identity(info) in self._ignored


def _identity(info: PartInfo) -> bytes:
    return info.uid or info.client_key.to_bytes(4, "big")
