"""The world that simulated parts are in, as options of a command say it: one of its own, or another program's."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from msbot.sim.arena.world_messages import is_name
from msbot_agent.cli.group import complain
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

if TYPE_CHECKING:
    from msbot.sim import SimulatedPart
    from msbot.sim.arena.world_connection import WorldConnection

OTHER = "tcp:"
"""How the address of another program's world begins."""
PASSWORD_VARIABLE = "MSBOT_WORLD_PASSWORD"
"""Has the password where the command line has none, which `ps` shows every user of the computer."""
SHORTEST = 8
"""Characters of a world's password."""


@dataclass(frozen=True, slots=True)
class WorldOptions:
    """What was said of a world on the command line."""

    world: str | None = None
    place: str | None = None
    share: str | None = None
    password: str | None = None
    """What guests have to say, as the command line says it."""

    @property
    def guests_password(self) -> str | None:
        """What guests have to say: of the command line or of $MSBOT_WORLD_PASSWORD; None: one is made up."""
        return self.password or os.environ.get(PASSWORD_VARIABLE) or None

    def check(self) -> None:
        """Raises ConfigError for what contradicts itself."""
        if self.world is None and (self.place is not None or self.share is not None):
            raise ConfigError("--place and --share-world belong to a world: say which with --world, for example line")
        if self.world is not None and self.world.startswith(OTHER) and self.share is not None:
            raise ConfigError("a world of another program is shared by that one: leave --share-world out")
        if self.password is not None and self.share is None:
            raise ConfigError("--world-password is for a world that is shared: say where with --share-world 7600")
        if self.share is not None:
            password = self.guests_password
            if password is not None and (len(password) < SHORTEST or not is_name(password)):
                place = f"${PASSWORD_VARIABLE}" if self.password is None else "--world-password"
                raise ConfigError(f"{place} has at least {SHORTEST} characters, all printable")
            address(self.share, "--share-world 7600")


def remote_world(world: str, place: str | None, say: Callable[[str], None]) -> WorldConnection:
    """The door into a world of another program, `tcp:PASSWORD@HOST:PORT`; or `tcp:HOST:PORT`, and the password is in
    $MSBOT_WORLD_PASSWORD.

    Raises:
        ConfigError: the address makes no sense.
    """
    from msbot.sim.arena.remote_world_connection import RemoteWorldConnection

    if not world.startswith(OTHER):
        raise ConfigError(
            f'--world "{world}": a part of its own joins the world of a demo; start one with '
            f"`msbot demo --world {Path(world).name} --share-world 7600`, and write what it prints, "
            "--world tcp:PASSWORD@127.0.0.1:7600"
        )
    password, _, at = world.removeprefix(OTHER).rpartition("@")
    password = password or os.environ.get(PASSWORD_VARIABLE, "")
    return RemoteWorldConnection(*address(at, "--world tcp:PASSWORD@127.0.0.1:7600"), place, password=password, say=say)


def put_into_world(simulated: SimulatedPart, slot: str, door: WorldConnection) -> None:
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
    "--world",
    metavar="WORLD",
    help="The world to drive in: a name from `msbot arena list`, a file, or tcp:PASSWORD@HOST:PORT for that of "
    f"another program; without PASSWORD@ it is taken from ${PASSWORD_VARIABLE}, which other users cannot see.",
)
place_option = click.option("--place", metavar="NAME", help="Its place in the world; default: the first free one.")
_share_option = click.option(
    "--share-world",
    "share",
    metavar="[HOST:]PORT",
    help="Let other programs' robots into the world; without HOST only those of this computer.",
)
_password_option = click.option(
    "--world-password",
    metavar="WORD",
    help=f"The password for other programs' robots, visible to other users (`ps`); default: ${PASSWORD_VARIABLE}, else "
    "a random one, which is printed.",
)


def world_options(command: Callable[..., None]) -> Callable[..., None]:
    """All options about a world, for a command that may have one."""
    return world_option(place_option(_share_option(_password_option(command))))
