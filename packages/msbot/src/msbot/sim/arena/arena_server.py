"""Lets robots of other programs into a world: over TCP, a line of JSON for each message (`wire`)."""

from __future__ import annotations

import asyncio
import contextlib
import hmac
from collections import Counter
from collections.abc import Callable, Mapping

from msbot.sim.arena.running_arena import RunningArena, Sensed
from msbot.sim.arena.world_messages import (
    LONGEST_LINE,
    MOST_SLOTS,
    VERSION,
    from_line,
    is_name,
    known_quantities,
    to_line,
    values_of,
)
from msbot_xrce.errors import ConfigError, LinkDown

MOST_GUESTS = 40
MOST_STRANGERS = 40
"""Connections whose other end has not said the password yet; a further one takes the place of the oldest."""
HELLO_S = 5.0
WRONG_S = 1.0
"""Who says a wrong password waits so long for the answer: nobody guesses quickly."""
MOST_UNSENT = 64 * 1024
"""A guest that does not read what it is shown gets the next one later."""


class ArenaServer:
    """The door for others.

    Args:
        living: the world.
        host, port: where it listens; port 0 is any free one.
        password: what a guest has to say.
        say: told who comes and goes, a sentence at a time.
    """

    def __init__(
        self, living: RunningArena, host: str, port: int, *, password: str, say: Callable[[str], None]
    ) -> None:
        self._living = living
        self.password = password
        self.host = host
        self.port = port
        self._say = say
        self._guests = 0
        self._strangers: dict[asyncio.StreamWriter, None] = {}
        """Who has not said the password yet, the oldest first."""
        self.refused: Counter[str] = Counter()
        """Messages that made no sense, and guests that were turned away, by reason."""
        self.ready = asyncio.Event()

    async def run(self) -> None:
        """Serve until cancelled.

        Raises:
            LinkDown: the address cannot be had.
        """
        try:
            server = await asyncio.start_server(self._serve, self.host, self.port, limit=LONGEST_LINE)
        except OSError as error:
            raise LinkDown(
                f"the world cannot be shared at {self.host}:{self.port}: {error.strerror or error}; "
                "name another port, for example --share-world 7601"
            ) from None
        self.port = server.sockets[0].getsockname()[1]
        async with server:
            self.ready.set()
            await server.serve_forever()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if len(self._strangers) >= MOST_STRANGERS:
            oldest = next(iter(self._strangers))
            del self._strangers[oldest]
            oldest.transport.abort()
            self.refused["too many strangers"] += 1
        self._strangers[writer] = None
        try:
            await self._welcome(reader, writer)
        except (OSError, ValueError):  # gone, or a line that is too long
            self.refused["broken off"] += 1
        finally:
            self._strangers.pop(writer, None)
            writer.close()
            with contextlib.suppress(OSError):
                await writer.wait_closed()

    async def _welcome(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            line = await asyncio.wait_for(reader.readline(), HELLO_S)
        except TimeoutError:
            self.refused["silent"] += 1
            return
        hello = from_line(line)
        if hello is None or hello.get("arena") != VERSION:
            self.refused["no greeting"] += 1
            writer.write(to_line({"error": f"this is a world of MsBOT, and speaks version {VERSION}"}))
            return
        if not hmac.compare_digest(str(hello.get("password", "")).encode(), self.password.encode()):
            self.refused["wrong password"] += 1
            await asyncio.sleep(WRONG_S)
            writer.write(
                to_line({"error": "it asks for its password: --world tcp:PASSWORD@HOST:PORT, or $MSBOT_WORLD_PASSWORD"})
            )
            return
        self._strangers.pop(writer, None)
        if self._guests >= MOST_GUESTS:
            self.refused["too many guests"] += 1
            return
        self._guests += 1
        try:
            await self._let_in(reader, writer, hello)
        finally:
            self._guests -= 1

    async def _let_in(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, hello: Mapping[str, object]
    ) -> None:
        wanted = hello.get("robot")
        try:
            robot = str(wanted) if is_name(wanted) else self._living.free_robot()
            plan = self._living.arena.robot(robot).plan
        except ConfigError as error:
            self.refused["no place"] += 1
            writer.write(to_line({"error": str(error)}))
            return
        named = [part.slot for part in plan.mounts]
        writer.write(to_line({"robot": robot, "world": self._living.arena.plan.name, "named": named}))
        guest = _RemoteRobot(self._living, robot, writer, self.refused)
        end = self._living.on_tick(guest.show)
        self._say(f"a robot has come into the world, as {robot}")
        try:
            while line := await reader.readline():
                guest.take(line)
        finally:
            end()
            guest.leave()
            self._say(f"{robot} has no robot any more")


class _RemoteRobot:
    """One connection: parts of one robot."""

    def __init__(self, living: RunningArena, robot: str, writer: asyncio.StreamWriter, refused: Counter[str]) -> None:
        self._living = living
        self._robot = robot
        self._writer = writer
        self._refused = refused
        self._parts: dict[str, _RemotePart] = {}

    def take(self, line: bytes) -> None:
        message = from_line(line)
        if message is None:
            self._refused["no JSON"] += 1
        elif "do" in message:
            for slot, does in values_of(message["do"]).items():
                if slot in self._parts:
                    self._parts[slot].does = {name: float(value) for name, value in does.items()}
        elif is_name(message.get("seat")):
            self._seat(str(message["seat"]), known_quantities(message.get("can")))
        elif is_name(message.get("unseat")):
            self._unseat(str(message["unseat"]))
        else:
            self._refused["no such message"] += 1

    def show(self) -> None:
        """Send what the parts see."""
        see = {slot: part.seen for slot, part in self._parts.items() if part.seen}
        transport = self._writer.transport
        if see and not transport.is_closing() and transport.get_write_buffer_size() < MOST_UNSENT:
            self._writer.write(to_line({"see": see}))

    def leave(self) -> None:
        for slot in [*self._parts]:
            self._unseat(slot)

    def _seat(self, slot: str, quantities: tuple[str, ...]) -> None:
        if slot in self._parts or not quantities or len(self._parts) >= MOST_SLOTS:
            self._refused["seat"] += 1
            return
        part = _RemotePart()
        try:
            self._living.seat(self._robot, slot, quantities, part)
        except ConfigError as error:
            self._refused["seat"] += 1
            self._writer.write(to_line({"error": str(error)}))
            return
        self._parts[slot] = part

    def _unseat(self, slot: str) -> None:
        if self._parts.pop(slot, None) is not None:
            self._living.unseat(self._robot, slot)


class _RemotePart:
    """A part that is in another program."""

    def __init__(self) -> None:
        self.does: dict[str, float] = {}
        self.seen: dict[str, Sensed] = {}

    def drive_values(self) -> Mapping[str, float]:
        return self.does

    def sense(self, values: Mapping[str, Sensed]) -> None:
        self.seen = dict(values)
