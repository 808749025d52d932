"""Serves the figures at a port of this computer: `--metrics PORT`.

The server of `prometheus-client` has a thread of its own; for each question it has the figures read in the robot's
loop, which takes some 0.1 ms, and writes the text in its thread. A robot that does not answer is not waited for.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from concurrent.futures import TimeoutError as NoAnswer
from typing import Final

from msbot.metrics.collecting import Noting
from msbot.metrics.exposition import registry_of
from msbot.metrics.figures import MomentFigures
from msbot_xrce.errors import ConfigError

HOST: Final = "127.0.0.1"
ANSWER_S: Final = 5.0
"""How long a question waits for the robot's loop."""


class MetricsServer:
    """Serves the figures of one process.

    Args:
        read: reads the figures, in the loop.
        noting: what is noted as long as it serves.
        port: of 127.0.0.1; 0: any free one.

    Raises:
        ConfigError: the port cannot be had, or a package is missing.
    """

    def __init__(self, read: Callable[[], MomentFigures], noting: Noting, port: int) -> None:
        self._read = read
        self._noting = noting
        self._loop = asyncio.get_running_loop()
        registry = registry_of(self._ask)
        from prometheus_client import start_http_server

        try:
            self._server, self._thread = start_http_server(port, addr=HOST, registry=registry)
        except OSError as error:
            raise ConfigError(
                f"metrics cannot be served on {HOST} port {port} ({error.strerror}): choose another one with --metrics"
            ) from None

    @property
    def address(self) -> str:
        """Where they are."""
        return f"http://{HOST}:{self._server.server_port}/metrics"

    async def run(self) -> None:
        """Serve until cancelled."""
        try:
            await self._noting.run()
        finally:
            # Its thread may be waiting for this loop: another one tells it to end.
            with contextlib.suppress(asyncio.CancelledError):
                await asyncio.to_thread(self._end)

    def _end(self) -> None:
        self._server.shutdown()
        self._server.server_close()

    def _ask(self) -> MomentFigures:
        """Have the figures read by the robot; called in the server's thread."""
        asked = asyncio.run_coroutine_threadsafe(self._answer(), self._loop)
        try:
            return asked.result(ANSWER_S)
        except NoAnswer:
            asked.cancel()
            raise

    async def _answer(self) -> MomentFigures:
        return self._read()
