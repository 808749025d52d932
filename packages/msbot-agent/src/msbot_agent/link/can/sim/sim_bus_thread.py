"""A simulated bus served in a thread, for programs that have no event loop of their own (python-can).

The first user of a bus in this process starts it if no other process serves it; it ends with the last user here.
"""

from __future__ import annotations

import asyncio
import atexit
import contextlib
import threading
from pathlib import Path
from typing import Final

from msbot_agent.link.can.sim.bus_names import find_bus
from msbot_agent.link.can.sim.sim_bus_client import SimBusRequest
from msbot_agent.link.can.sim.sim_bus_driver import SimBusDriver
from msbot_agent.link.can.sim.sim_bus_server import SimBusServer
from msbot_agent.process.end_signals import run_to_end
from msbot_xrce.errors import LinkDown

START_S: Final = 20.0
"""Time for the thread to begin and to end; a busy computer needs some of it."""

_lock = threading.Lock()
_served: dict[str, tuple[BusThread, int]] = {}


def hold(wish: SimBusRequest) -> bool:
    """Make sure that some process serves a bus; True if this one does: then call `release` once.

    Raises:
        MsbotError: it cannot be served.
    """
    with _lock:
        if wish.name in _served:
            thread, users = _served[wish.name]
            _served[wish.name] = (thread, users + 1)
            return True
        if find_bus(wish.name) is not None:
            return False
        thread = BusThread(wish)
        if not thread.begin():
            return False
        _served[wish.name] = (thread, 1)
        return True


def release(name: str) -> None:
    """One user fewer in this process; with the last one, the bus ends for all programs."""
    with _lock:
        thread, users = _served.pop(name)
        if users > 1:
            _served[name] = (thread, users - 1)
            return
    thread.end()


class BusThread(threading.Thread):
    """The thread that serves one bus."""

    def __init__(self, wish: SimBusRequest, folder: Path | None = None) -> None:
        """Prepare; `begin` starts it."""
        super().__init__(name=f"simulated bus {wish.name}", daemon=True)
        self._wish = wish
        self._folder = folder
        self._begun = threading.Event()
        self._error: BaseException | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._serving: asyncio.Task[None] | None = None

    def begin(self) -> bool:
        """Return once others can join; False if another process serves the bus by then.

        Raises:
            MsbotError: it cannot be served.
        """
        self.start()
        if not self._begun.wait(START_S):
            raise LinkDown(f"the simulated bus {self._wish.name!r} did not begin within {START_S:g} s")
        if self._error is None:
            return True
        if isinstance(self._error, LinkDown) and find_bus(self._wish.name, self._folder) is not None:
            return False
        raise self._error

    def end(self) -> None:
        """End the bus for all programs."""
        if self._loop is not None and self._serving is not None:
            with contextlib.suppress(RuntimeError):  # it has already ended
                self._loop.call_soon_threadsafe(self._serving.cancel)
        self.join(START_S)

    def run(self) -> None:
        """Serve; see `threading.Thread`."""
        run_to_end(self._serve())

    async def _serve(self) -> None:
        loop = self._loop = asyncio.get_running_loop()
        server = SimBusServer(SimBusDriver(self._wish.make()), self._wish.name, folder=self._folder)
        serving = self._serving = loop.create_task(server.run())
        ready = loop.create_task(server.ready.wait())
        await asyncio.wait((serving, ready), return_when=asyncio.FIRST_COMPLETED)
        ready.cancel()
        if serving.done():
            self._error = serving.exception()
        self._begun.set()
        await asyncio.wait((serving,))


@atexit.register
def _end_all() -> None:
    """End all buses at exit, so that one that was not shut down leaves no name behind."""
    with _lock:
        threads = [thread for thread, _ in _served.values()]
        _served.clear()
    for thread in threads:
        thread.end()
