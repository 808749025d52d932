"""The bridges of a blueprint (`[[bridge]]`), in the process of its master; their simulated devices in processes."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Coroutine, Mapping, Sequence
from contextlib import AbstractAsyncContextManager, nullcontext
from typing import Final

from msbot.cli.run.bridges_beside import BridgeBus, PluggableDevice
from msbot.config import BridgeTable
from msbot.part import Message, Part
from msbot.part.join.part_keys import given_key
from msbot.part.join.pnp_messages import Nature
from msbot_agent.link import Link
from msbot_agent.process.end_signals import ungrouped
from msbot_bridges.bridge import Bridge, BridgeLink, World, WorldKind, worlds
from msbot_bridges.canbus import OnBus, check_one_bus, held_bus, robot_on_bus
from msbot_bridges.cli.device_process import DeviceProcess
from msbot_xrce.errors import ConfigError, LinkDown, MsbotError

_log = logging.getLogger("msbot.bridges")
AGAIN_S: Final = 5.0
"""Time after which a network that has ended is tried again."""
Work = Coroutine[object, object, None]


class BlueprintBridges:
    """See `msbot.cli.run.bridges_beside.BridgeRunner`."""

    def check(self, bridges: Sequence[BridgeTable], links: Sequence[str] = ()) -> None:
        """See `BridgeRunner`."""
        seen = set[tuple[str, str]]()
        for table in bridges:
            if (table.world, table.link) in seen:
                raise ConfigError(f"[[bridge]]: {table.link} has two bridges for {table.world}; one finds all devices")
            seen.add((table.world, table.link))
            kind = _kind(table)
            kind.open(_link(table))
            for device in table.simulate:
                name, options = _device(kind, table, device)
                kind.simulated[name](BridgeLink(table.link, options), options)
        robots = [one for link in links if (one := robot_on_bus(link)) is not None]
        try:
            check_one_bus(_on_buses(bridges))
            for robot in robots:
                check_one_bus([*_on_buses(bridges), robot])
        except ConfigError as error:
            raise ConfigError(f"[[bridge]]: {error}") from error

    def buses(self, bridges: Sequence[BridgeTable], links: Sequence[str] = ()) -> list[BridgeBus]:
        """See `BridgeRunner`."""
        robots = {one.bus: one for link in links if (one := robot_on_bus(link)) is not None}
        devices = {(table.world, table.link): len(table.simulate) for table in bridges}
        by_bus: dict[tuple[str, str], list[OnBus]] = {}
        for one in _on_buses(bridges):
            by_bus.setdefault(one.bus, []).append(one)
        return [
            BridgeBus(
                together[0].address,
                tuple(one.who for one in together),
                sum(_devices(one, devices) for one in together),
                sum(one.claim.frames_per_s(_devices(one, devices)) for one in together),
                sum(one.claim.bits_per_s(_devices(one, devices)) for one in together),
                next((one.bitrate for one in (*together, *filter(None, [robots.get(bus)])) if one.bitrate), None),
                bus in robots,
            )
            for bus, together in by_bus.items()
        ]

    def devices(self, bridges: Sequence[BridgeTable]) -> list[DeviceProcess]:
        """See `BridgeRunner`."""
        made = []
        for table in bridges:
            kind = _kind(table)
            for device in table.simulate:
                name, options = _device(kind, table, device)
                made.append(DeviceProcess(table, name, options, kind.numbers.get(name, "")))
        return made

    def coroutines(
        self,
        bridges: Sequence[BridgeTable],
        connect: Callable[[Part], Link],
        say: Callable[[str], None],
        devices: Sequence[PluggableDevice] | None = None,
    ) -> list[Work]:
        """See `BridgeRunner`."""
        made = self.devices(bridges) if devices is None else [one for one in devices if isinstance(one, DeviceProcess)]
        return [_run_table(table, connect, say, [one for one in made if one.table == table]) for table in bridges]


RUNNER = BlueprintBridges()


def _on_buses(bridges: Sequence[BridgeTable]) -> list[OnBus]:
    """The bridges of devices on CAN."""
    return [OnBus(table.world, table.link, claim) for table in bridges if (claim := _kind(table).can) is not None]


def _devices(one: OnBus, simulated: Mapping[tuple[str, str], int]) -> int:
    """So many are expected: those that are simulated, or else one."""
    return simulated[one.who, one.address] or 1


def _kind(table: BridgeTable) -> WorldKind:
    known = worlds()
    kind = known.get(table.world)
    if kind is None:
        raise ConfigError(f'[[bridge]]: there is no bridge for "{table.world}"; there are {", ".join(sorted(known))}')
    kind.check(table.world, _link(table))
    return kind


def _link(table: BridgeTable) -> BridgeLink:
    return BridgeLink(table.link, table.options)


def _device(kind: WorldKind, table: BridgeTable, device: str) -> tuple[str, dict[str, str]]:
    """`drive node=7` as name and options."""
    name, *pairs = device.split()
    if name not in kind.simulated:
        known = ", ".join(sorted(kind.simulated)) or "nothing"
        raise ConfigError(f'[[bridge]]: of {table.world} "{name}" cannot be simulated; there can be: {known}')
    options = dict[str, str]()
    for pair in pairs:
        option, sign, value = pair.partition("=")
        if not sign:
            raise ConfigError(f'[[bridge]]: simulate = ["{device}"]: behind the name write NAME=VALUE')
        options[option] = value
    return name, options


async def _run_table(
    table: BridgeTable, connect: Callable[[Part], Link], say: Callable[[str], None], devices: Sequence[DeviceProcess]
) -> None:
    """One network with its bridge and simulated devices; a robot does not end because it cannot be brought up."""
    while True:
        try:
            async with _kind(table).reached(_link(table)) as reached, _held(table, reached):
                with ungrouped(MsbotError):
                    async with asyncio.TaskGroup() as tasks:
                        for device in devices:
                            tasks.create_task(device.run(reached.address))
                        # Not a task of its own: the devices are there until it has left them.
                        await _run_bridge(table, reached, connect, say)
        except LinkDown as error:
            say(f"bridge for {table.world}: {error}; tried again in {AGAIN_S:g} s")
        await asyncio.sleep(AGAIN_S)


def _held(table: BridgeTable, reached: BridgeLink) -> AbstractAsyncContextManager[None]:
    """The bus of simulated devices outlasts each of them."""
    return held_bus(reached.address) if table.simulate and _kind(table).can is not None else nullcontext()


async def _run_bridge(
    table: BridgeTable, link: BridgeLink, connect: Callable[[Part], Link], say: Callable[[str], None]
) -> None:
    """One bridge; a robot does not end because a network of its devices has."""

    def prepare(part: Part) -> None:
        assert part.uid is not None
        part.key = given_key(None, part.part_number, part.uid.hex())

    nature = Nature.SIMULATED if table.simulate else Nature.REAL
    unsafe = dict[bytes, Mapping[str, Message]]()
    while True:
        world: World = _kind(table).open(link)
        bridge = Bridge(world, connect, prepare, nature, unsafe)
        try:
            await bridge.run()
        except LinkDown as error:
            say(f"bridge for {table.world}: {error}; tried again in {AGAIN_S:g} s")
        except ConfigError:
            raise
        except Exception as error:  # a mistake in a world or in its library; the robot has other parts
            _log.exception("bridge for %s", table.world)
            say(f"bridge for {table.world}: {type(error).__name__}: {error}; tried again in {AGAIN_S:g} s")
        await asyncio.sleep(AGAIN_S)
