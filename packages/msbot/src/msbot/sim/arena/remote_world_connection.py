"""The connection to a world of another program, on this computer or in the local network."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable

from msbot.sim.arena.running_arena import TICK_S, SimulatedWorldPart, quantities_of
from msbot.sim.arena.world_connection import fits
from msbot.sim.arena.world_messages import LONGEST_LINE, VERSION, from_line, to_line, values_of
from msbot.sim.simulated_part import SimulatedPart
from msbot_xrce.errors import ConfigError

AGAIN_S = 1.0
"""A world that is gone is looked for this often."""


class RemoteWorldConnection:
    """See the module's docstring.

    Args:
        host, port: where the world is.
        password: what it asks for.
        robot: the robot in it; None: one that is free.
        say: told what happens, a sentence at a time.
    """

    def __init__(
        self, host: str, port: int, robot: str | None = None, *, password: str, say: Callable[[str], None]
    ) -> None:
        self._address = f"{host}:{port}"
        self._host = host
        self._port = port
        self._robot = robot
        self._password = password
        self._say = say
        self._parts: dict[str, tuple[tuple[str, ...], SimulatedWorldPart]] = {}
        self._named: list[str] = []
        self._writer: asyncio.StreamWriter | None = None
        self._told = ""

    def enter(self, slot: str, simulated: SimulatedPart) -> None:
        """See `WorldConnection.enter`."""
        quantities = quantities_of(simulated.part_type)
        if quantities:
            self._parts[slot] = (quantities, SimulatedWorldPart(simulated))
            self._seat(slot)

    def leave(self, slot: str) -> None:
        """See `WorldConnection.leave`."""
        if self._parts.pop(slot, None) is not None and self._writer is not None:
            self._writer.write(to_line({"unseat": slot}))

    async def run(self) -> None:
        """Stay in the world, and come back when it does.

        Raises:
            ConfigError: the world has no place for this robot, or another password.
        """
        while True:
            try:
                reader, self._writer = await asyncio.open_connection(self._host, self._port, limit=LONGEST_LINE)
            except OSError as error:
                self._tell(f"no world answers at {self._address} ({error.strerror or error}); looking on")
            else:
                await self._stay(reader, self._writer)
            await asyncio.sleep(AGAIN_S)

    async def _stay(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        acting: asyncio.Task[None] | None = None
        try:
            writer.write(to_line({"arena": VERSION, "password": self._password, "robot": self._robot}))
            welcome = from_line(await reader.readline())
            if welcome is None or "robot" not in welcome:
                why = "is no world of MsBOT" if welcome is None else welcome.get("error", "is no world of MsBOT")
                raise ConfigError(f"the world at {self._address}: {why}")
            self._robot = str(welcome["robot"])
            named = welcome.get("named")
            self._named = [str(slot) for slot in named] if isinstance(named, list) else []
            self._tell(f'in the world "{welcome.get("world")}" at {self._address}, as {self._robot}')
            for slot in self._parts:
                self._seat(slot)
            acting = asyncio.create_task(self._act(writer))
            while line := await reader.readline():
                self._take(line)
            self._tell(f"the world at {self._address} has ended; looking for it")
        except ConfigError:
            raise
        except (OSError, ValueError) as error:
            self._tell(f"the world at {self._address} is gone ({error}); looking for it")
        finally:
            self._writer = None
            if acting is not None:
                acting.cancel()
            writer.close()
            with contextlib.suppress(OSError):
                await writer.wait_closed()

    async def _act(self, writer: asyncio.StreamWriter) -> None:
        """Say what the parts do, when it has changed."""
        said: dict[str, object] = {}
        while not writer.is_closing():
            does: dict[str, object] = {slot: dict(part.drive_values()) for slot, (_, part) in self._parts.items()}
            changed = {slot: does[slot] for slot in does if does[slot] and said.get(slot) != does[slot]}
            if changed:
                writer.write(to_line({"do": changed}))
            said = does
            await asyncio.sleep(TICK_S)

    def _take(self, line: bytes) -> None:
        message = from_line(line) or {}
        if "error" in message:
            self._tell(f"the world at {self._address}: {message['error']}")
        for slot, seen in values_of(message.get("see")).items():
            if slot in self._parts:
                self._parts[slot][1].sense(seen)

    def _seat(self, slot: str) -> None:
        quantities, _ = self._parts[slot]
        if self._writer is not None and fits(quantities, slot, self._named):
            self._writer.write(to_line({"seat": slot, "can": quantities}))

    def _tell(self, words: str) -> None:
        """Say it once."""
        if words != self._told:
            self._told = words
            self._say(words)
