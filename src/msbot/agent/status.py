"""Lets `msbot clients` look into a running agent: a small server on this computer, for its user alone.

Who shows the token from the process' file (`status_files`) is sent lines of JSON: what the process is, then one line
for each client, then `{"end": number of clients}`. The agent serves its clients in between.
"""

from __future__ import annotations

import asyncio
import dataclasses
import hmac
import json
import logging
import socket
from collections.abc import Iterator
from pathlib import Path

from msbot.agent.server import Agent
from msbot.agent.status_files import leave_word, status_folder
from msbot.errors import ConfigError

logger = logging.getLogger(__name__)

FORMAT = 1
"""Version of the lines."""

TOKEN_S = 2.0
"""Time to show the token."""

_MAX_READERS = 4
_CLIENTS_PER_TURN = 32


class StatusServer:
    """Shows one agent's clients to its user."""

    def __init__(self, agent: Agent, *, what: str, name: str, folder: Path | None = None) -> None:
        """Prepare; it serves once `run` is awaited.

        Args:
            agent: whose clients are shown.
            what: the kind of process, `agent` or `master`.
            name: what tells it from others: the robot, or the links.
            folder: where its file goes; the user's folder for such files if absent.
        """
        self._agent = agent
        self._what = what
        self._name = name
        self._folder = folder or status_folder()
        self._readers = 0
        self._since = 0.0
        self._token = b""
        self.path: Path | None = None
        """The file, while it serves."""

    async def run(self) -> None:
        """Serve until cancelled. Where that is not possible a warning says so: an agent can do without."""
        try:
            with socket.create_server(("127.0.0.1", 0)) as listening:
                await self._serve(listening)
        except (OSError, ConfigError) as error:
            logger.warning("`msbot clients` will not show this process: %s", error)

    async def _serve(self, listening: socket.socket) -> None:
        loop = asyncio.get_running_loop()
        server = await asyncio.start_server(self._answer, sock=listening, limit=256)
        try:
            file = leave_word(self._folder, listening.getsockname()[1])
            self._token, self._since, self.path = file.token.encode(), loop.time(), file.path
            try:
                await loop.create_future()
            finally:
                self.path = None
                file.path.unlink(missing_ok=True)
        finally:
            server.close()

    async def _answer(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._readers += 1
        try:
            async with asyncio.timeout(TOKEN_S):
                shown = await reader.readline()
            if hmac.compare_digest(shown.strip(), self._token) and self._readers <= _MAX_READERS:
                for number, line in enumerate(self._lines()):
                    writer.write(line)
                    if number % _CLIENTS_PER_TURN == 0:
                        await writer.drain()
                        await asyncio.sleep(0)
                await writer.drain()
        except (OSError, ValueError) as error:
            logger.debug("a reader of the status has gone: %s", error)
        finally:
            self._readers -= 1
            writer.close()

    def _lines(self) -> Iterator[bytes]:
        yield _line(self._head())
        count = 0
        for view in self._agent.iter_clients():
            yield _line(dataclasses.asdict(view))
            count += 1
        yield _line({"end": count})

    def _head(self) -> dict[str, object]:
        return {
            "format": FORMAT,
            "what": self._what,
            "name": self._name,
            "up_s": asyncio.get_running_loop().time() - self._since,
            "links": [{"name": link.info.name, **dataclasses.asdict(link.counters)} for link in self._agent.links],
            "topics": self._agent.topics(),
            "dropped": self._agent.dropped(),
        }


def _line(content: dict[str, object]) -> bytes:
    return json.dumps(content, separators=(",", ":")).encode() + b"\n"
