"""How the parts of one robot come into a world: one that lives in this process, or one of another program."""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import Callable, Collection, Mapping
from typing import Protocol

from msbot.config import DRIVES, SENSES
from msbot.sim.arena.floor import is_placed_by_itself
from msbot.sim.arena.running_arena import TICK_S, RunningArena, SimulatedInhabitant, quantities_of
from msbot.sim.simulated_part import SimulatedPart
from msbot_agent.text.given_file import read_told_elsewhere
from msbot_xrce.errors import ConfigError


class WorldConnection(Protocol):
    """The way into a world for the parts of one robot."""

    def enter(self, slot: str, simulated: SimulatedPart) -> None:
        """Bring a part in, if its type has a place in a world."""

    def leave(self, slot: str) -> None:
        """Take it out; nothing happens if it is not in."""

    async def run(self) -> None:
        """Keep the door open until cancelled."""


def fits(quantities: Collection[str], slot: str, named: Collection[str]) -> bool:
    """Whether a part belongs into a world: by its type, or because the world file names its slot."""
    return bool(quantities) and (slot in named or is_placed_by_itself(quantities))


class LocalWorldConnection:
    """The door of the program that has the world.

    Args:
        living: the world.
        robot: the robot in it whose parts come in.
    """

    def __init__(self, living: RunningArena, robot: str) -> None:
        self.living = living
        self.robot = robot

    def enter(self, slot: str, simulated: SimulatedPart) -> None:
        """See `WorldConnection.enter`."""
        quantities = quantities_of(simulated.part_type)
        named = [part.slot for part in self.living.arena.robot(self.robot).plan.mounts]
        if fits(quantities, slot, named):
            self.living.seat(self.robot, slot, quantities, SimulatedInhabitant(simulated))

    def leave(self, slot: str) -> None:
        """See `WorldConnection.leave`."""
        self.living.unseat(self.robot, slot)

    async def run(self) -> None:
        """The world lives."""
        await self.living.run()


# What two programs say to each other about a world: one JSON object on a line, checked before it is believed.
#
# To the world: `{"arena": 1, "password": "...", "robot": "second"}` first (no name: a robot that is free), then
# `{"seat": "eyes", "can": ["distance"]}`, `{"unseat": "eyes"}` and, up to 50 times a second,
# `{"do": {"wheels": {"motor.left": 50}}}`.
# From the world: `{"robot": "second", "world": "Warehouse", "named": ["bumper"]}` or `{"error": "..."}` first, then
# `{"see": {"eyes": {"distance": 0.4}}}`.


VERSION = 1
LONGEST_LINE = 32 * 1024
MOST_SLOTS = 64
LONGEST_NAME = 254

Values = dict[str, dict[str, float | bool]]
"""Slot -> quantity -> value."""


def to_line(message: Mapping[str, object]) -> bytes:
    """A message as it travels."""
    return json.dumps(message, separators=(",", ":")).encode() + b"\n"


def from_line(line: bytes) -> dict[str, object] | None:
    """The message of a line; None: it is not one."""
    try:
        found = read_told_elsewhere(line)
    except ValueError:
        return None
    return found if isinstance(found, dict) else None


def is_name(value: object) -> bool:
    """Whether a value can be the name of a slot or a robot."""
    return isinstance(value, str) and 0 < len(value) <= LONGEST_NAME and value.isprintable()


def known_quantities(value: object) -> tuple[str, ...]:
    """Those words of a list that mean something."""
    if not isinstance(value, list):
        return ()
    return tuple(dict.fromkeys(word for word in value if isinstance(word, str) and (word in SENSES or word in DRIVES)))


def values_of(value: object) -> Values:
    """What parts do or see, as far as it makes sense."""
    if not isinstance(value, dict) or len(value) > MOST_SLOTS:
        return {}
    return {
        slot: {
            name: number
            for name, number in said.items()
            if (name in SENSES or name in DRIVES)
            and isinstance(number, bool | int | float)
            and abs(number) <= 1e9  # neither NaN nor infinite, nor a whole number that is too large for a float
        }
        for slot, said in value.items()
        if is_name(slot) and isinstance(said, dict)
    }


# The door into a world of another program, on this computer or in the local network.


AGAIN_S = 1.0
"""A world that is gone is looked for this often."""


class RemoteWorldConnection:
    """See the comment above.

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
        self._parts: dict[str, tuple[tuple[str, ...], SimulatedInhabitant]] = {}
        self._named: list[str] = []
        self._writer: asyncio.StreamWriter | None = None
        self._told = ""

    def enter(self, slot: str, simulated: SimulatedPart) -> None:
        """See `WorldConnection.enter`."""
        quantities = quantities_of(simulated.part_type)
        if quantities:
            self._parts[slot] = (quantities, SimulatedInhabitant(simulated))
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
            does: dict[str, object] = {slot: dict(part.doing()) for slot, (_, part) in self._parts.items()}
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
