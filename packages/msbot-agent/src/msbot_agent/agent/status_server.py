"""Lets `msbot clients` inspect a running agent, and other programs control a master: a small server for its user.

It listens on this computer only. A program that presents the token from the process' file (`status_files`) gets lines
of JSON: what the process is, then one line for each client of the agent, then `{"end": number of clients}`. The agent
serves its clients in between. A program that sends a request after the token, a JSON object with `do`, gets the answer
as one line; `describe` asks what the process is, everything else goes to the process' `control`.
"""

from __future__ import annotations

import asyncio
import dataclasses
import hmac
import json
import logging
import socket
from collections.abc import Awaitable, Callable, Iterator, Mapping
from pathlib import Path

from msbot_agent.agent.server import Agent
from msbot_agent.agent.status_files import DESCRIBE, FORMAT, restore_status_file, status_folder, write_status_file
from msbot_agent.link import bound_name
from msbot_agent.pace import Acceptor
from msbot_agent.text.untrusted_input import read_json
from msbot_xrce.counting import Tally
from msbot_xrce.errors import ConfigError

logger = logging.getLogger(__name__)


TOKEN_S = 2.0
"""Time to present the token."""

MAX_REQUEST = 65_536
"""Largest request with its token, in octets."""


Control = Callable[[Mapping[str, object]], Awaitable[Mapping[str, object]]]
"""Does what a request asks for and returns the answer; an error is `{"error": words}`."""

READ_S = 5.0
"""A reader that takes nothing for this long counts as gone."""

LOOK_AFTER_S = 5.0
"""How often a server looks whether its file is still there."""
_MAX_STRANGERS = 32
_MAX_READERS = 4
_CLIENTS_PER_TURN = 32


class StatusServer:
    """Shows one agent's clients to its user."""

    def __init__(
        self,
        agent: Agent,
        *,
        what: str,
        name: str | Callable[[], str],
        folder: Path | None = None,
        details: Callable[[], Mapping[str, str]] = dict,
        control: Control | None = None,
    ) -> None:
        """Prepare; it serves once `run` is awaited.

        Args:
            agent: whose clients are shown.
            what: the kind of process, `agent` or `master`.
            name: what distinguishes it from others: the robot, or the links; as a function it is called each time.
            folder: where its file goes; the user's folder for such files if absent.
            details: returns further details of the process; called each time.
            control: answers requests; None: no requests are taken.
        """
        self._agent = agent
        self._what = what
        self._name = name if callable(name) else lambda: name
        self._folder = folder or status_folder()
        self._details = details
        self._control = control
        self._strangers: dict[asyncio.Task[None], socket.socket | None] = {}
        """Who has not presented the token yet, oldest first, with their connection while nothing else will close it."""
        self._visits: set[asyncio.Task[None]] = set()
        self._reading = asyncio.Semaphore(_MAX_READERS)
        self._dropped = Tally()
        self._since = 0.0
        self._token = b""
        self.path: Path | None = None
        """The file, while it serves."""

    async def run(self) -> None:
        """Serve until cancelled. If that is not possible, there is only a warning: an agent can do without."""
        try:
            with socket.create_server(("127.0.0.1", 0)) as listening:
                await self._serve(listening)
        except (OSError, ConfigError) as error:
            logger.warning("no other msbot command will see this process: %s", error)

    async def _serve(self, listening: socket.socket) -> None:
        loop = asyncio.get_running_loop()
        acceptor = Acceptor(listening, self._take, self._dropped)
        try:
            file = write_status_file(self._folder, listening.getsockname()[1])
            self._token, self._since, self.path = file.token.encode(), loop.time(), file.path
            looking: asyncio.Future[None] | None = None
            try:
                while True:
                    await asyncio.sleep(LOOK_AFTER_S)
                    looking = asyncio.ensure_future(asyncio.to_thread(restore_status_file, file))
                    await asyncio.shield(looking)
            finally:
                self.path = None
                if looking is not None:
                    await asyncio.wait([looking])  # it must not put the file back behind our back
                file.path.unlink(missing_ok=True)
        finally:
            acceptor.stop()
            visits = (*self._strangers, *self._visits)
            for visit in visits:
                visit.cancel()
            await asyncio.gather(*visits, return_exceptions=True)

    def _take(self, connection: socket.socket) -> None:
        visit = asyncio.get_running_loop().create_task(self._receive(connection))
        self._strangers[visit] = connection
        visit.add_done_callback(self._visit_ended)
        if len(self._strangers) > _MAX_STRANGERS:
            # A connection that has not presented the token makes room for a new one.
            next(iter(self._strangers)).cancel()

    def _visit_ended(self, visit: asyncio.Task[None]) -> None:
        unopened = self._strangers.pop(visit, None)
        if unopened is not None:  # it was cancelled before its first step
            unopened.close()
        self._visits.discard(visit)

    async def _receive(self, connection: socket.socket) -> None:
        visit = asyncio.current_task()
        assert visit is not None
        self._strangers[visit] = None
        try:
            reader, writer = await asyncio.open_connection(sock=connection, limit=MAX_REQUEST)
        except BaseException:
            connection.close()
            raise
        try:
            await self._answer(visit, reader, writer)
            writer.close()
            async with asyncio.timeout(READ_S):
                await writer.wait_closed()
        except (OSError, ValueError) as error:
            logger.debug("a reader of the status has gone: %s", error)
        finally:
            writer.transport.abort()  # what nobody reads must not outlive this process' loop

    async def _answer(
        self, visit: asyncio.Task[None], reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        async with asyncio.timeout(TOKEN_S):
            shown = await reader.readline()
        token, _, request = shown.strip().partition(b" ")
        if not (self._token and hmac.compare_digest(token, self._token)):
            return
        self._strangers.pop(visit, None)
        self._visits.add(visit)
        if request:
            writer.write(_line(await self._answer_to(request)))
            await writer.drain()
            return
        async with self._reading:
            for number, line in enumerate(self._lines()):
                writer.write(line)
                if number % _CLIENTS_PER_TURN == 0:
                    async with asyncio.timeout(READ_S):
                        await writer.drain()
                    await asyncio.sleep(0)
            async with asyncio.timeout(READ_S):
                await writer.drain()

    async def _answer_to(self, request: bytes) -> Mapping[str, object]:
        try:
            wanted = read_json(request)
        except ValueError:
            wanted = None
        if not isinstance(wanted, dict):
            return {"error": "the request is no JSON object"}
        if wanted.get("do") == DESCRIBE:
            return self._head()
        if self._control is None:
            return {"error": f"this process ({self._what} {self._name()}) takes no requests"}
        return await self._control(wanted)

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
            "name": self._name(),
            "details": dict(self._details()),
            "up_s": asyncio.get_running_loop().time() - self._since,
            "links": [{"name": bound_name(link), **dataclasses.asdict(link.counters)} for link in self._agent.links],
            "topics": self._agent.topics(),
            "dropped": self._agent.dropped(),
        }


def _line(content: Mapping[str, object]) -> bytes:
    return json.dumps(content, separators=(",", ":")).encode() + b"\n"
