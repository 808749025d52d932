"""STOP with every kind of part: what may happen while it holds, and who may say it. In virtual time.

One robot: a partner in Python that speaks and listens without a pause, and at the other ends of its wires a part of the
kind that is tried, which does the same.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping

from msbot import Level
from msbot.part import JoinState, Part
from msbot_agent.link.can.protocol.frames import Frame
from tests.firmware.c_part import CPart, Described
from tests.firmware.c_part import PartState as CState
from tests.firmware.pipe import Firmware
from tests.homes.runners import as_micropython
from tests.homes.world import UID, Home, Robot, World, run_virtual
from tests.stop.oracle import POWER, SPEED, Oracle, Verdict, until_all_confirm

EVERY_S = 0.1
SOME_S = 2.0
PROGRAM = f"""
from msbot import Level, Part

part = Part("TEST-1")

@part.every({EVERY_S})
def speak():
    part.publish("speed", Level(percent={SPEED}))

@part.on("power", Level)
def turn(message):
    print("heard", message.percent)

part.run()
"""
HEARD = f"heard {POWER}"
ROBOT = Robot(bindings=(("power", "in", "Level"), ("speed", "out", "Level")), settings=(("power.safe.percent", "0"),))


class CHome:
    """A part of the firmware, which speaks without a pause, too."""

    def __init__(self, firmware: Firmware) -> None:
        ports = ((False, "power", "Level"), (True, "speed", "Level"))
        self._part = CPart(firmware, Described(uid=UID, part_number="TEST-1", local_name="board", ports=ports))
        self._world: World | None = None
        self._speaking: asyncio.Task[None] | None = None

    def start(self, world: World, program: str, name: str) -> None:
        """See `Home`."""
        self._world = world
        self._part.heard = _ToLog(world.log)
        self._part.plug(world.driver.attach("mine"))
        self._speaking = world.spawn(self._speak())

    async def _speak(self) -> None:
        while True:
            self._part.publish(1, Level(percent=SPEED).encode())
            await asyncio.sleep(EVERY_S)

    def state(self) -> str:
        """See `Home`."""
        return "active" if self._part.state is CState.ACTIVE else self._part.state.name.lower()

    def pull(self) -> None:
        """See `Home`."""
        assert self._world is not None
        self._part.pull()
        self._world.driver.detach("mine")

    def close(self) -> None:
        """See `Home`."""
        self._part.pull()
        if self._speaking is not None:
            self._speaking.cancel()


class _ToLog(list[tuple[int, bytes]]):
    """What a part of the firmware hears, as the other kinds print it."""

    def __init__(self, log: list[str]) -> None:
        super().__init__()
        self._log = log

    def append(self, heard: tuple[int, bytes]) -> None:
        """See `list`."""
        super().append(heard)
        self._log.append(HEARD if heard[1] == Level(percent=POWER).encode() else "heard another one")


async def nothing(_world: World, _plug_partner: Callable[[], object]) -> None:
    """Nothing else happens."""


async def its_settings_change(world: World, _plug_partner: Callable[[], object]) -> None:
    """Somebody changes the part's settings."""
    world.configure((("power.safe.percent", "5"),))


async def stopped_again(world: World, _plug_partner: Callable[[], object]) -> None:
    """Somebody else says STOP as well."""
    world.master.say_stop("ben")


async def the_partner_is_exchanged(world: World, plug_partner: Callable[[], object]) -> None:
    """The partner is pulled out, and another one comes."""
    await world.pull_partner()
    await asyncio.sleep(5.0)
    plug_partner()


async def somebody_asks_which_it_is(world: World, _plug_partner: Callable[[], object]) -> None:
    """Somebody asks which part it is."""
    world.identify()


async def the_bus_is_disturbed(world: World, _plug_partner: Callable[[], object]) -> None:
    """Somebody else's frames fill the bus."""
    stranger = world.driver.attach("stranger")

    for number in range(200):
        if stranger.has_room():
            stranger.send(Frame(0x1ABC0000 + number, bytes(8), extended=True))
        await asyncio.sleep(0.002)
    world.driver.detach("stranger")


Happening = Callable[[World, Callable[[], object]], Awaitable[None]]
HAPPENINGS: tuple[Happening, ...] = (
    nothing, its_settings_change, stopped_again, the_partner_is_exchanged, somebody_asks_which_it_is,
    the_bus_is_disturbed,
)  # fmt: skip
"""What may happen while STOP holds."""


def stories(home: Home) -> Mapping[str, Verdict]:
    """One robot, and for each happening: STOP, it happens, all confirm, a while, GO; what came of each."""
    oracle = Oracle()
    verdicts: dict[str, Verdict] = {}

    async def play() -> None:
        world = World(ROBOT, home, PROGRAM, "program.py")
        world.start_master()
        await world.master.ready.wait()
        oracle.watch(world.master.agent)
        oracle.expect("the part", "the partner")
        world.log = Heard(oracle)

        def listens(part: Part) -> None:
            part.on("speed", Level)(lambda _: oracle.heard("the partner"))

        def plug_partner() -> None:
            world.plug_partner(listens)

        async def speak() -> None:
            while True:
                if world.partner is not None and world.partner.state is JoinState.ACTIVE:
                    world.partner.publish("power", Level(percent=POWER))
                await asyncio.sleep(EVERY_S)

        try:
            plug_partner()
            speaking = world.spawn(speak())
            await asyncio.sleep(1.0)
            world.plug()
            await world.until_state("active")
            await asyncio.sleep(SOME_S)
            at: dict[str, int] = {}
            for happening in HAPPENINGS:
                verdict = verdicts[words_of(happening)] = Verdict(before=oracle.since(at))
                world.master.say_stop("ann")
                verdict.confirmed_ms = await until_all_confirm(world.master, 2)
                at, sent = dict(oracle.counts), oracle.on_the_way
                await happening(world, plug_partner)
                await until_all_confirm(world.master, 2)
                await asyncio.sleep(SOME_S)
                verdict.after, verdict.on_the_way = oracle.since(at), oracle.on_the_way - sent
                at = dict(oracle.counts)
                world.master.say_go("ann")
                await asyncio.sleep(SOME_S / 2)
                verdict.again = oracle.since(at)
            speaking.cancel()
        finally:
            await world.close()

    with as_micropython():
        run_virtual(play())
    return verdicts


def words_of(happening: Happening) -> str:
    """What happens, as people are told."""
    return (happening.__doc__ or "").rstrip(".")


class Heard(list[str]):
    """The world's log, which tells the oracle what the part's program has heard."""

    def __init__(self, oracle: Oracle) -> None:
        super().__init__()
        self._oracle = oracle

    def append(self, text: str) -> None:
        """See `list`."""
        super().append(text)
        if text == HEARD:  # and not a safe value, which comes from the part itself
            self._oracle.heard("the part")
