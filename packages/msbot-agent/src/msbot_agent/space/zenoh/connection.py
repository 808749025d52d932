"""The connection to a router, and the one thread that waits for it.

Opening a session waits for the network, and so may making an endpoint; both happen in a thread of their own, in the
order in which they were asked for. Once it is open the library connects again by itself, and repeats to the router
what was made.
"""

from __future__ import annotations

import asyncio
import logging
import queue
import threading
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, TypeAlias

from msbot_agent.space.space_address import TlsFiles
from msbot_agent.space.zenoh.hand_over import tell
from msbot_agent.space.zenoh.library import load, session_config
from msbot_agent.space.zenoh.reachability import why_not

if TYPE_CHECKING:
    import zenoh

FIRST_PAUSE_S = 0.5
LONGEST_PAUSE_S = 5.0
"""Between two attempts to reach a router for the first time."""
GOODBYE_S = 2.0
"""The longest time that leaving may take."""

Job: TypeAlias = "Callable[[zenoh.Session], None]"
"""Something to do with the session, in the thread."""

logger = logging.getLogger(__name__)


class RouterConnection:
    """A session with one of several routers. Must be made on the loop, and closed."""

    def __init__(self, routers: Sequence[str], tls: TlsFiles | None, on_change: Callable[[], None]) -> None:
        """Begin to connect.

        Args:
            routers: endpoints, of which the first that answers is used.
            tls: certificates.
            on_change: called on the loop when a router is there or lost, see `is_up`.
        """
        self.words = ", ".join(routers)
        self.is_up = False
        """Whether there is a router now."""
        self._routers = tuple(routers)
        self._tls = tls
        self._library = load()
        self._config = session_config("client", connect=routers, tls=tls)
        self._on_change = on_change
        self._loop = asyncio.get_running_loop()
        self._jobs: queue.SimpleQueue[Job | None] = queue.SimpleQueue()
        self._stopping = threading.Event()
        self._was_up = False
        self._thread = threading.Thread(target=self._run, name="msbot-zenoh", daemon=True)
        self._thread.start()

    def do(self, job: Job) -> None:
        """Have something done with the session as soon as there is one, after what was asked for before."""
        self._jobs.put(job)

    def close(self) -> None:
        """Leave; what was asked for and is not done is forgotten."""
        self._stopping.set()
        self._jobs.put(None)
        self._thread.join(GOODBYE_S)

    def _run(self) -> None:
        session = self._open()
        if session is None:
            return
        listener = session.info.declare_transport_events_listener(
            self._library.handlers.Callback(self._transport_changed, indirect=False), history=True
        )
        try:
            while (job := self._jobs.get()) is not None and not self._stopping.is_set():
                try:
                    job(session)
                except self._library.ZError as error:
                    tell(self._loop, logger.warning, "Zenoh refuses an endpoint: %s", str(error))
        finally:
            listener.undeclare()
            session.close()

    def _open(self) -> zenoh.Session | None:
        pause, said = FIRST_PAUSE_S, ""
        while not self._stopping.is_set():
            try:
                opened: zenoh.Session = self._library.open(self._config)
            except self._library.ZError:
                reasons = [f"{router} ({why_not(router, self._tls)})" for router in self._routers]
                sentence = f"no Zenoh router at {', '.join(reasons)}; it is tried again until it answers"
            else:
                return opened
            if sentence != said:
                tell(self._loop, logger.warning, "%s", sentence)
                said = sentence
            self._stopping.wait(pause)
            pause = min(2 * pause, LONGEST_PAUSE_S)
        return None

    def _transport_changed(self, event: zenoh.TransportEvent) -> None:
        tell(self._loop, self._changed, event.kind == self._library.SampleKind.PUT)

    def _changed(self, is_up: bool) -> None:
        if is_up == self.is_up or self._stopping.is_set():
            return
        self.is_up = is_up
        if not is_up:
            logger.warning("the Zenoh router at %s is lost; it is tried again until it answers", self.words)
        elif self._was_up:
            logger.warning("the Zenoh router at %s is heard again", self.words)
        self._was_up = True
        self._on_change()
