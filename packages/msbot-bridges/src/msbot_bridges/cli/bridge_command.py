"""`msbot bridge`: devices of another world as parts of a robot."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import threading
from collections.abc import Callable, Coroutine, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import click

from msbot_agent.cli.options import WholeRange, json_option
from msbot_xrce.errors import ConfigError

if TYPE_CHECKING:
    from msbot.cli.run.host import Endable
    from msbot_bridges.bridge import Bridge, BridgeLink, SimulatedDevice, WorldKind


@click.command("bridge")
@click.argument("world", required=False, default="")
@click.option("--link", "address", metavar="ADDRESS", default="", help="Where the devices are.")
@click.option(
    "--robot-link",
    metavar="ADDRESS",
    default="udp:127.0.0.1:8888",
    show_default=True,
    envvar="MSBOT_LINK",
    help="How to reach the master; $MSBOT_LINK sets it, too.",
)
@click.option("--option", "options", metavar="NAME=VALUE", multiple=True, help="An option of that world; repeatable.")
@click.option(
    "--simulate",
    metavar="DEVICE",
    default="",
    help="Simulate a device there instead of bridging; takes --option, too.",
)
@click.option(
    "--set-bitrate",
    "bit_rate",
    type=WholeRange(min=1),
    metavar="BIT/S",
    help="Give all devices there this bit rate instead of bridging, where they can be told (CANopen).",
)
@click.option("--yes", is_flag=True, help="With --set-bitrate: do not ask.")
@click.option("-q", "--quiet", is_flag=True, help="Print only problems.")
@click.option("--end-with-stdin", is_flag=True, hidden=True)
@json_option
def command(
    world: str,
    *,
    address: str,
    robot_link: str,
    options: tuple[str, ...],
    simulate: str,
    bit_rate: int | None,
    yes: bool,
    quiet: bool,
    end_with_stdin: bool,
    as_json: bool,
) -> None:
    """Bring the devices of WORLD into a robot, until Ctrl-C; without WORLD, list what can be bridged.

    Each device that is found becomes a part, described by what it declares. In a robot that does not know it, a
    person adopts it: `msbot adopt`, or on the page.
    """
    from msbot_bridges.bridge import worlds

    known = worlds()
    if not world:
        _list(known, as_json=as_json)
        return
    kind = known.get(world)
    if kind is None:
        raise ConfigError(f'there is no bridge for "{world}"; there are {", ".join(sorted(known)) or "none"}')
    if not address:
        raise ConfigError(f"say where the devices are: msbot bridge {world} --link {kind.example}")
    link = _link(address, options)
    if simulate:
        _simulate(world, kind, simulate, link, quiet=quiet, end_with_stdin=end_with_stdin)
        return
    kind.check(world, link)
    if bit_rate is not None:
        _set_bit_rate(world, kind, link, bit_rate, agreed=yes)
        return
    _check_bus(world, kind, address, robot_link)
    _bridge(kind, link, robot_link, quiet=quiet)


def _list(known: Mapping[str, WorldKind], *, as_json: bool) -> None:
    if as_json:
        import json

        listed = [
            {"name": name, "words": kind.words, "example": kind.example, "simulated": sorted(kind.simulated)}
            for name, kind in sorted(known.items())
        ]
        click.echo(json.dumps(listed, ensure_ascii=False))
        return
    for name, kind in sorted(known.items()):
        click.echo(f"{name}: {kind.words}")
        click.echo(f"    msbot bridge {name} --link {kind.example}")
        for option, words in kind.options.items():
            click.echo(f"    --option {option}=...: {words}")
        if kind.simulated:
            click.echo(f"    --simulate {', '.join(sorted(kind.simulated))}")


def _link(address: str, options: tuple[str, ...]) -> BridgeLink:
    from msbot_bridges.bridge import BridgeLink

    given = dict[str, str]()
    for option in options:
        name, sign, value = option.partition("=")
        if not sign or not name:
            raise ConfigError(f"--option {option}: write NAME=VALUE")
        given[name] = value
    return BridgeLink(address, given)


def _set_bit_rate(world: str, kind: WorldKind, link: BridgeLink, bit_rate: int, *, agreed: bool) -> None:
    if kind.change_bit_rate is None:
        raise ConfigError(f"--set-bitrate: devices of {world} cannot be told their bit rate by a bridge")
    change = kind.change_bit_rate(link, bit_rate)
    question = change.prepare()
    try:
        is_agreed = agreed or click.confirm(f"{question}. Change it?")
    except click.Abort:
        change.undo()
        raise
    if not is_agreed:
        change.undo()
        click.echo("Nothing has changed.")
        return
    change.carry_out(click.echo)


def _check_bus(world: str, kind: WorldKind, address: str, robot_link: str) -> None:
    """Refuse the bus of the robot's own parts where the devices of this world cannot be on it."""
    from msbot_bridges.canbus import OnBus, check_one_bus, robot_on_bus

    robot = robot_on_bus(robot_link)
    if kind.can is not None and robot is not None:
        check_one_bus([OnBus(world, address, kind.can), robot])


def _bridge(kind: WorldKind, link: BridgeLink, robot_link: str, *, quiet: bool) -> None:
    from msbot.cli.run.host import run_until_told
    from msbot.part.join.part_keys import given_key
    from msbot.part.run import CAN
    from msbot_agent.link import Link, open_link
    from msbot_bridges.bridge import Bridge

    if TYPE_CHECKING:
        from msbot.part import Part

    def connect(part: Part) -> Link:
        return open_link(robot_link, can=replace(CAN, uid=part.uid))

    def prepare(part: Part) -> None:
        assert part.uid is not None
        part.key = given_key(None, part.part_number, part.uid.hex())  # one for each device

    def make() -> tuple[Endable, Coroutine[object, object, None]]:
        bridge = _OnNetwork(kind, link, lambda reached: Bridge(kind.open(reached), connect, prepare))
        return bridge, bridge.run()

    run_until_told(make, quiet=quiet)


class _OnNetwork:
    """A bridge, and before it its network, where the address asks for one of MsBOT's own.

    Args:
        kind: the world.
        link: the address.
        make: makes the bridge, once it is known where its network is.
    """

    def __init__(self, kind: WorldKind, link: BridgeLink, make: Callable[[BridgeLink], Bridge]) -> None:
        self._kind, self._link, self._make = kind, link, make
        self._bridge: Bridge | None = None
        self._is_ended = False

    def end(self) -> None:
        self._is_ended = True
        if self._bridge is not None:
            self._bridge.end()

    async def run(self) -> None:
        async with self._kind.reached(self._link) as reached:
            if reached.address != self._link.address:
                logging.getLogger("msbot.part").info("%s is at %s", self._link.address, reached.address)
            self._bridge = self._make(reached)
            if self._is_ended:
                self._bridge.end()
            await self._bridge.run()


class _Simulation:
    """A simulated device that runs until it is told to end.

    Args:
        device: the device.
        end_with_stdin: it ends with the process that holds the other end of its standard input, however that ends.
    """

    def __init__(self, device: SimulatedDevice, *, end_with_stdin: bool) -> None:
        self._device = device
        self._ended = asyncio.Event()
        self._end_with_stdin = end_with_stdin

    def end(self) -> None:
        self._ended.set()

    async def run(self) -> None:
        if self._end_with_stdin:
            # A thread, because not every system's event loop can wait for any standard input.
            threading.Thread(target=self._wait_for_stdin, args=(asyncio.get_running_loop(),), daemon=True).start()
        running = asyncio.create_task(self._device.run())
        ending = asyncio.create_task(self._ended.wait())
        await asyncio.wait([running, ending], return_when=asyncio.FIRST_COMPLETED)
        ending.cancel()
        running.cancel()
        await asyncio.wait([running, ending])
        if not running.cancelled() and (error := running.exception()) is not None:
            raise error

    def _wait_for_stdin(self, loop: asyncio.AbstractEventLoop) -> None:
        while os.read(0, 1024):
            pass
        with contextlib.suppress(RuntimeError):  # the loop has ended
            loop.call_soon_threadsafe(self.end)


def _simulate(world: str, kind: WorldKind, name: str, link: BridgeLink, *, quiet: bool, end_with_stdin: bool) -> None:
    from msbot.cli.run.host import run_until_told

    make_device = kind.simulated.get(name)
    if make_device is None:
        known = ", ".join(sorted(kind.simulated)) or "nothing"
        raise ConfigError(f"--simulate {name}: of {world} there can be simulated: {known}")

    def make() -> tuple[Endable, Coroutine[object, object, None]]:
        simulation = _Simulation(make_device(link, link.options), end_with_stdin=end_with_stdin)
        logging.getLogger("msbot.part").info("%s %s on %s; Ctrl-C ends it", world, name, link.address)
        return simulation, simulation.run()

    run_until_told(make, quiet=quiet)
