"""A device that nobody will command any more is made safe: it is told so until it has reported that it is.

One order may get lost: a bus has errors, a controller has no room, a broker is slow. So a part that leaves its robot,
or has lost its master, does not only give the last order: it repeats it until the device itself has reported that it
has obeyed, for a bounded time. What was not reported by then is said.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from typing import Final

from msbot_bridges.bridge.contract import ForeignDevice

AGAIN_S: Final = 0.2
"""Time after which a device that has not reported that it has stopped is told so again."""
LEAVE_S: Final = 3.0
"""So long a part that ends waits for the report."""
MASTERLESS_S: Final = 60.0
"""So long a part that has lost its master has its device told again: the bridge runs on, and there is no hurry."""

_log = logging.getLogger("msbot.part")


class Leaving:
    """Tells one device to be safe until it has reported that it is, or until the time is over.

    Args:
        device: the device.
        first: gives it the safe values of its ports.
        tell: tells it to have them; called again and again.
        ended: called once, with what the device has not reported as a sentence; empty: it has reported everything.
    """

    def __init__(
        self,
        device: ForeignDevice,
        first: Callable[[], None],
        tell: Callable[[], None],
        ended: Callable[[str], None],
    ) -> None:
        self.is_over = False
        self._device, self._first, self._tell_once, self._ended = device, first, tell, ended
        self._loop = asyncio.get_running_loop()
        self._until = self._loop.time()
        self._timer: asyncio.TimerHandle | None = None
        self._over = asyncio.Event()

    def begin(self, patience_s: float) -> None:
        """Tell it for the first time, and again for so long."""
        self._until += patience_s
        self._tell(self._first)

    def end_within(self, seconds: float) -> None:
        """The part ends: it waits no longer than that."""
        self._until = min(self._until, self._loop.time() + seconds)
        if not self.is_over:
            self._wait()

    def look(self) -> None:
        """The device has reported something."""
        if self.is_over:
            return
        why = self._device.not_stopped if self._device.inputs else ""
        if not why or self._loop.time() >= self._until:
            self._end(why)

    def cancel(self) -> None:
        """The robot commands the device again, or it is gone: what it has not reported no longer matters."""
        self.is_over = True
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        self._over.set()

    async def over(self) -> None:
        """Wait until it is over, in whatever way."""
        await self._over.wait()

    def _tell(self, first: Callable[[], None] = lambda: None) -> None:
        self._timer = None
        try:
            first()
            self._tell_once()
        except Exception as error:  # of a world that an extension has brought: the part ends all the same
            _log.exception("%s", self._device.identity.where)
            self._end(f"{type(error).__name__}: {error}")
        self.look()
        if not self.is_over:
            self._wait()

    def _wait(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._timer = self._loop.call_at(min(self._loop.time() + AGAIN_S, self._until), self._tell)

    def _end(self, why: str) -> None:
        self.cancel()
        self._ended(why)
