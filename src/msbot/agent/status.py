"""Lets `msbot clients` look into a running agent, and others tell a master what to do: a small server for its user.

It listens on this computer only. Who shows the token from the process' file (`status_files`) is sent lines of JSON:
what the process is, then one line for each client, then `{"end": number of clients}`. The agent serves its clients in
between. Who puts a request behind the token, a JSON object with `do`, is sent the answer as one line; `describe` asks
for what the process is, everything else goes to the process' `control`.
"""

from __future__ import annotations

import asyncio
import dataclasses
import hmac
import json
import logging
import socket
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from msbot.agent.server import Agent
from msbot.agent.status_files import leave_word, status_folder
from msbot.errors import ConfigError

logger = logging.getLogger(__name__)

FORMAT = 1
"""Version of the lines."""

TOKEN_S = 2.0
"""Time to show the token."""

MAX_REQUEST = 65_536
"""Octets of a request with its token at most."""

DESCRIBE = "describe"
"""The request that every process answers."""

Control = Callable[[Mapping[str, object]], Mapping[str, object]]
"""Does what a request asks for and gives the answer; a mistake is `{"error": words}`."""

_MAX_READERS = 4
_CLIENTS_PER_TURN = 32


class StatusServer:
    """Shows one agent's clients to its user."""

    def __init__(
        self,
        agent: Agent,
        *,
        what: str,
        name: str,
        folder: Path | None = None,
        details: Callable[[], Mapping[str, str]] = dict,
        control: Control | None = None,
    ) -> None:
        """Prepare; it serves once `run` is awaited.

        Args:
            agent: whose clients are shown.
            what: the kind of process, `agent` or `master`.
            name: what tells it from others: the robot, or the links.
            folder: where its file goes; the user's folder for such files if absent.
            details: what else there is to say about the process; asked each time.
            control: answers requests; None: there are none.
        """
        self._agent = agent
        self._what = what
        self._name = name
        self._folder = folder or status_folder()
        self._details = details
        self._control = control
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
            logger.warning("no other msbot command will see this process: %s", error)

    async def _serve(self, listening: socket.socket) -> None:
        loop = asyncio.get_running_loop()
        server = await asyncio.start_server(self._answer, sock=listening, limit=MAX_REQUEST)
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
            token, _, request = shown.strip().partition(b" ")
            is_known = bool(self._token) and hmac.compare_digest(token, self._token)
            if not is_known or self._readers > _MAX_READERS:
                return
            if request:
                writer.write(_line(self._answer_to(request)))
                await writer.drain()
            else:
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

    def _answer_to(self, request: bytes) -> Mapping[str, object]:
        try:
            wanted = json.loads(request)
        except ValueError:
            wanted = None
        if not isinstance(wanted, dict):
            return {"error": "the request is no JSON object"}
        if wanted.get("do") == DESCRIBE:
            return self._head()
        if self._control is None:
            return {"error": f"this process ({self._what} {self._name}) takes no requests"}
        return self._control(wanted)

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
            "details": dict(self._details()),
            "up_s": asyncio.get_running_loop().time() - self._since,
            "links": [{"name": link.info.name, **dataclasses.asdict(link.counters)} for link in self._agent.links],
            "topics": self._agent.topics(),
            "dropped": self._agent.dropped(),
        }


def _line(content: Mapping[str, object]) -> bytes:
    return json.dumps(content, separators=(",", ":")).encode() + b"\n"
