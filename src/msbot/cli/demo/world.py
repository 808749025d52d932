"""The world of a demo or of a simulated part: one of its own, or one of another program."""

from __future__ import annotations

import asyncio
import secrets
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import TYPE_CHECKING

import click

from msbot.cli.group import complain
from msbot.errors import ConfigError
from msbot.runtime.lazy_dataclass import dataclass
from msbot.sim.arena.wire import is_name

if TYPE_CHECKING:
    from msbot.operations.dispatch import RunningOperations
    from msbot.sim import SimulatedPart
    from msbot.sim.arena.door import Door
    from msbot.sim.arena.living_arena import LivingArena
    from msbot.sim.arena.server import ArenaServer

OTHER = "tcp:"
"""How the address of another program's world begins."""
SHORTEST = 8
"""Characters of a world's password."""
PILOT = "PILOT"
"""The part that a person's program takes the place of: it is not plugged in at the beginning."""


@dataclass(frozen=True, slots=True)
class WorldWishes:
    """What was said of a world on the command line."""

    world: str | None = None
    place: str | None = None
    share: str | None = None
    password: str | None = None
    """What guests have to say; None: one is made up."""

    def check(self) -> None:
        """Raises ConfigError for what contradicts itself."""
        if self.world is None and (self.place is not None or self.share is not None):
            raise ConfigError("--place and --share-world belong to a world: say which with --world, for example line")
        if self.world is not None and self.world.startswith(OTHER) and self.share is not None:
            raise ConfigError("a world of another program is shared by that one: leave --share-world out")
        if self.password is not None and self.share is None:
            raise ConfigError("--world-password is for a world that is shared: say where with --share-world 7600")
        if self.password is not None and (len(self.password) < SHORTEST or not is_name(self.password)):
            raise ConfigError(f"--world-password has at least {SHORTEST} characters, all printable")
        if self.share is not None:
            address(self.share, "--share-world 7600")


class DemoWorld:
    """The world of a demo, made from wishes.

    Raises:
        ConfigError: there is no such world, or it has no such place.
    """

    def __init__(self, wishes: WorldWishes, seed: int | None, say: Callable[[str], None]) -> None:
        self.living: LivingArena | None = None
        self.door: Door | None = None
        self.robot = ""
        """The place of the demo's robot in a world of its own."""
        self._server: ArenaServer | None = None
        self._say = say
        if wishes.world is None:
            return
        if wishes.world.startswith(OTHER):
            self.door = guest_door(wishes.world, wishes.place, say)
            return
        from msbot.sim.arena.arena import Arena, place_for
        from msbot.sim.arena.door import OwnDoor
        from msbot.sim.arena.living_arena import LivingArena
        from msbot.sim.arena.server import ArenaServer
        from msbot.sim.arena.world_reader import open_world

        plan = open_world(wishes.world)
        self.robot = place_for(plan, wishes.place).name
        self.living = LivingArena(Arena(plan, seed))
        self.door = OwnDoor(self.living, self.robot)
        if wishes.share is not None:
            password = wishes.password or secrets.token_urlsafe(9)
            at = address(wishes.share, "--share-world 7600")
            self._server = ArenaServer(self.living, *at, password=password, say=say)

    def beside(self, operations: RunningOperations) -> list[Coroutine[object, object, None]]:
        """What must run beside the robot, whose operations get to know the world."""
        if self.living is not None:
            operations.worlds.use(self.living)
        return [] if self._server is None else [self._server.run(), self._greet(self._server)]

    async def _greet(self, server: ArenaServer) -> None:
        await server.ready.wait()
        # A line of its own: it is copied.
        self._say(f"The world is shared: msbot demo --world tcp:{server.password}@{server.host}:{server.port}")


def guest_door(world: str, place: str | None, say: Callable[[str], None]) -> Door:
    """The door into a world of another program, `tcp:PASSWORD@HOST:PORT`.

    Raises:
        ConfigError: the address makes no sense.
    """
    from msbot.sim.arena.guest import GuestDoor

    if not world.startswith(OTHER):
        raise ConfigError(
            f'--world "{world}": a part of its own joins the world of a demo; start one with '
            f"`msbot demo --world {Path(world).name} --share-world 7600`, and write what it prints, "
            "--world tcp:PASSWORD@127.0.0.1:7600"
        )
    password, _, at = world.removeprefix(OTHER).rpartition("@")
    return GuestDoor(*address(at, "--world tcp:PASSWORD@127.0.0.1:7600"), place, password=password, say=say)


def bring_into_world(simulated: SimulatedPart, slot: str, door: Door) -> None:
    """Bring a part into a world as soon as it is in its robot, and keep it there."""
    staying: list[asyncio.Task[None]] = []

    def ended(task: asyncio.Task[None]) -> None:
        if not task.cancelled() and (error := task.exception()) is not None:
            complain(f"{error}; the part runs on without a world")

    def begin() -> None:
        if not staying:
            door.enter(slot, simulated)
            staying.append(asyncio.get_running_loop().create_task(door.run()))
            staying[0].add_done_callback(ended)

    simulated.part.on_join(begin)


def address(text: str, example: str) -> tuple[str, int]:
    """Host and port of a text; without a host this computer only.

    Raises:
        ConfigError: it is none.
    """
    host, _, port = text.rpartition(":")
    if not port.isdecimal() or int(port) > 65535:
        raise ConfigError(f'"{text}" is no address; write for example {example}')
    return host or "127.0.0.1", int(port)


world_option = click.option(
    "--world", metavar="WORLD",
    help="A world that its parts are in: a name of `msbot arena list`, a file, or tcp:PASSWORD@HOST:PORT of another "
         "program's.",
)  # fmt: skip
place_option = click.option("--place", metavar="NAME", help="Which robot of the world it is; the first that is free.")
_share_option = click.option(
    "--share-world", "share", metavar="[HOST:]PORT",
    help="Let robots of other programs into the world; without HOST those of this computer.",
)  # fmt: skip
_password_option = click.option(
    "--world-password", metavar="WORD",
    help="What robots of other programs have to say to come in; one is made up and printed unless given.",
)  # fmt: skip


def world_options(command: Callable[..., None]) -> Callable[..., None]:
    """All options about a world, for a command that may have one."""
    return world_option(place_option(_share_option(_password_option(command))))
