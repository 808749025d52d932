"""The one thread that waits for DDS; everything else happens on the event loop.

It waits in the library for any attached entity, hands the tokens of those with news to the loop, and looks again only
when the loop has dealt with them. So nothing queues up between the two: samples from a flooding peer stay in the
bounded histories of the library until the loop takes them.
"""

from __future__ import annotations

import asyncio
import logging
import threading
from collections.abc import Callable
from ctypes import c_ssize_t

from msbot_agent.space.dds.libddsc import ALL_DOMAINS, FOR_EVER, DdsLibrary
from msbot_xrce.errors import ConfigError

SLOTS = 256
"""Events handed over at a time; further ones come in the next turn."""

Handler = Callable[[], None]

logger = logging.getLogger(__name__)


class Waiter:
    """Calls handlers on the event loop when their entities have news. Must be made on the loop."""

    def __init__(self, library: DdsLibrary) -> None:
        """Begin to wait; the library must have a participant.

        Raises:
            ConfigError: the library has no room for it.
        """
        self._calls = library.calls
        self._loop = asyncio.get_running_loop()
        self._handlers: dict[int, Handler] = {}
        self._next_token = 1
        self._resume = threading.Semaphore(0)
        self._stopping = False
        self._waitset: int = self._calls.dds_create_waitset(ALL_DOMAINS)
        self._bell: int = self._calls.dds_create_guardcondition(ALL_DOMAINS)
        if self._waitset < 0 or self._bell < 0:
            raise ConfigError(f"DDS cannot wait for samples: {library.describe(min(self._waitset, self._bell))}")
        self._calls.dds_waitset_attach(self._waitset, self._bell, 0)
        self._thread = threading.Thread(target=self._wait, name="msbot-dds", daemon=True)
        self._thread.start()

    def attach(self, entity: int, handler: Handler) -> int:
        """Call the handler whenever the entity (a reader's condition, or one with a status mask) has news."""
        token = self._next_token
        self._next_token += 1
        self._handlers[token] = handler
        self._calls.dds_waitset_attach(self._waitset, entity, token)
        return token

    def pause(self, entity: int) -> None:
        """Do not call for that entity until `resume`."""
        self._calls.dds_waitset_detach(self._waitset, entity)

    def resume(self, entity: int, token: int) -> None:
        """Call again for a paused entity."""
        self._calls.dds_waitset_attach(self._waitset, entity, token)

    def detach(self, entity: int, token: int) -> None:
        """Never call for that entity again; it must still exist."""
        self._handlers.pop(token, None)
        self._calls.dds_waitset_detach(self._waitset, entity)

    def close(self) -> None:
        """Stop waiting."""
        self._stopping = True
        self._handlers.clear()
        self._calls.dds_set_guardcondition(self._bell, True)
        self._resume.release()
        self._thread.join()
        self._calls.dds_delete(self._waitset)
        self._calls.dds_delete(self._bell)

    def _wait(self) -> None:
        tokens = (c_ssize_t * SLOTS)()
        wait, resume, loop = self._calls.dds_waitset_wait, self._resume, self._loop
        while not self._stopping:
            count = wait(self._waitset, tokens, SLOTS, FOR_EVER)
            if self._stopping or count < 0:
                return
            try:
                loop.call_soon_threadsafe(self._handle, tokens[: min(count, SLOTS)])
            except RuntimeError:
                return  # the loop has been closed: nobody is left to tell
            resume.acquire()

    def _handle(self, tokens: list[int]) -> None:
        try:
            for token in tokens:
                handler = self._handlers.get(token)
                if handler is not None:
                    handler()
        finally:
            self._resume.release()
