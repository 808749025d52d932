"""STOP where no master heard or stored it: what a part of each kind tells the next master. In virtual time.

The partner is pulled out before, and another one comes afterwards, so that nobody but the part knows of STOP.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import replace

from msbot import Level
from msbot.part import JoinState, Part
from msbot_agent.link.can.protocol.frames import Frame
from tests.homes.runners import as_micropython
from tests.homes.world import Home, World, run_virtual
from tests.stop.kinds import EVERY_S, PROGRAM, ROBOT, SOME_S, Heard
from tests.stop.oracle import POWER, Oracle, Verdict, until_all_confirm

NAMES = ("board", "TEST-1")
"""Of the part that is tried, as its robot knows it."""
STOP_IDENTIFIER = 0x008
AT_ONCE_S, LATER_S = 0.1, 30.0
"""From the end of a master to STOP: before and after its parts have noticed."""


class Stage:
    """One robot with a part that is tried, and a partner."""

    def __init__(self, home: Home) -> None:
        self.oracle = Oracle()
        self.world = World(ROBOT, home, PROGRAM, "program.py")
        self.world.log = Heard(self.oracle)
        self.at: dict[str, int] = {}
        """What had been heard when STOP was said."""
        self.on_the_way = 0

    async def start(self) -> None:
        """The robot works."""
        await self._begin_master(self.world.start_master)
        self.oracle.expect("the part", "the partner")
        self._speaking = self.world.spawn(self._speak())
        self._plug_partner()
        self.world.plug()
        await self.world.until_state("active")
        await asyncio.sleep(SOME_S)

    async def end(self) -> None:
        """It is over."""
        self._speaking.cancel()
        await self.world.close()

    async def end_master(self) -> None:
        """The partner goes, and the master is killed."""
        await self.world.pull_partner()
        await self.world.kill_master()

    async def next_master(self) -> None:
        """Another master comes, and then a partner that knows of nothing."""
        await self._begin_master(self.world.new_master)
        self._plug_partner()
        async with asyncio.timeout(60.0):
            while not self.world.part_states().endswith("active"):  # noqa: ASYNC110 - virtual time
                await asyncio.sleep(0.01)
        await asyncio.sleep(EVERY_S)

    async def bus_stop(self) -> None:
        """Somebody says STOP on the bus."""
        self.world.driver.attach("stranger").send(Frame(STOP_IDENTIFIER, b"\x01"))
        await asyncio.sleep(EVERY_S)
        self.world.driver.detach("stranger")
        self.mark()

    def mark(self) -> None:
        """From now on nothing may be heard."""
        self.at, self.on_the_way = dict(self.oracle.counts), self.oracle.on_the_way

    async def hold(self) -> Verdict:
        """STOP holds with all that belongs to it until GO; what came of it."""
        verdict = Verdict(before=dict(self.oracle.counts))
        verdict.confirmed_ms = await until_all_confirm(self.world.master, 2)
        assert self.world.master.stop.stopped
        await asyncio.sleep(SOME_S)
        verdict.after, verdict.on_the_way = self.oracle.since(self.at), self.oracle.on_the_way - self.on_the_way
        verdict.again = await self._go()
        return verdict

    async def works(self) -> dict[str, int]:
        """What is heard in a while."""
        at = dict(self.oracle.counts)
        await asyncio.sleep(2 * SOME_S)
        return self.oracle.since(at)

    async def _go(self) -> dict[str, int]:
        self.world.master.say_go("ann")
        return await self.works()

    async def _begin_master(self, begin: Callable[[], None]) -> None:
        begin()
        self.oracle.watch(self.world.master.agent)
        await self.world.master.ready.wait()

    def _plug_partner(self) -> None:
        def listens(part: Part) -> None:
            part.on("speed", Level)(lambda _: self.oracle.heard("the partner"))

        self.world.plug_partner(listens)

    async def _speak(self) -> None:
        while True:
            partner = self.world.partner
            if partner is not None and partner.state is JoinState.ACTIVE:
                partner.publish("power", Level(percent=POWER))
            await asyncio.sleep(EVERY_S)


async def said_at_once(stage: Stage) -> Verdict:
    """the master is killed, STOP on the bus, another master comes"""
    await stage.end_master()
    await asyncio.sleep(AT_ONCE_S)
    await stage.bus_stop()
    await stage.next_master()
    assert stage.world.master.stop.by in NAMES
    return await stage.hold()


async def said_later(stage: Stage) -> Verdict:
    """the master is gone for long, STOP on the bus, another master comes"""
    await stage.end_master()
    await asyncio.sleep(LATER_S)
    await stage.bus_stop()
    await stage.next_master()
    assert stage.world.master.stop.by in NAMES
    return await stage.hold()


async def said_by_the_part(stage: Stage) -> Verdict:
    """STOP is said on the bus, while the master serves"""
    await stage.bus_stop()
    assert stage.world.master.stop.by == "somebody at the robot"
    return await stage.hold()


async def taken_over(stage: Stage) -> Verdict:
    """STOP, the master is killed, another one takes over"""
    stage.world.master.say_stop("ann")
    await until_all_confirm(stage.world.master, 2)
    number = stage.world.master.stop.number
    stage.mark()
    await stage.end_master()
    await asyncio.sleep(1.0)
    await stage.next_master()
    assert stage.world.master.stop.number > number
    return await stage.hold()


async def not_stored(stage: Stage) -> Verdict:
    """STOP, the master is killed before it is stored, another master comes"""
    stage.world.master.say_stop("ann")
    await until_all_confirm(stage.world.master, 2)
    number = stage.world.master.stop.number
    stage.mark()
    await stage.end_master()
    stage.world.store.stop = None
    await stage.next_master()
    status = stage.world.master.stop
    assert status.by in NAMES, status
    assert str(number) in status.reason, status
    return await stage.hold()


async def over_meanwhile(stage: Stage) -> Verdict:
    """STOP, the part loses its master, which hears GO, the part comes back: it works"""
    before = dict(stage.oracle.counts)
    stage.world.master.say_stop("ann")
    await until_all_confirm(stage.world.master, 2)
    stage.mark()
    await stage.end_master()
    await asyncio.sleep(1.0)
    after, on_the_way = stage.oracle.since(stage.at), stage.oracle.on_the_way
    begun = stage.world.spawn(stage.next_master())
    while not stage.world.master.ready.is_set() or not stage.world.master.stop.stopped:  # noqa: ASYNC110 - virtual time
        await asyncio.sleep(0.0001)
    stage.world.master.say_go("ann")
    await begun
    await asyncio.sleep(SOME_S)
    again = await stage.works()
    assert not stage.world.master.stop.stopped
    return Verdict(0.0, before, after, again, stage.oracle.on_the_way - on_the_way)


async def another_robot(stage: Stage) -> Verdict:
    """STOP, the part comes into another robot, where none holds: it works"""
    before = dict(stage.oracle.counts)
    stage.world.master.say_stop("ann")
    await until_all_confirm(stage.world.master, 2)
    stage.mark()
    await stage.end_master()
    await asyncio.sleep(1.0)
    after, on_the_way = stage.oracle.since(stage.at), stage.oracle.on_the_way
    stage.world.store.stop = None
    stage.world.robot = replace(stage.world.robot, name="ANOTHER")
    await stage.next_master()
    await asyncio.sleep(SOME_S)
    again = await stage.works()
    assert stage.world.master.stop.number == 0
    return Verdict(0.0, before, after, again, stage.oracle.on_the_way - on_the_way)


Deed = Callable[[Stage], Awaitable[Verdict]]
ON_A_BUS: tuple[Deed, ...] = (said_by_the_part, said_at_once, said_later)
EVERYWHERE: tuple[Deed, ...] = (taken_over, not_stored, over_meanwhile, another_robot)


def gap_stories(home: Home, *, has_bus: bool) -> Mapping[str, Verdict]:
    """One robot, and one after the other what may happen between two masters."""
    verdicts: dict[str, Verdict] = {}

    async def play() -> None:
        stage = Stage(home)
        await stage.start()
        try:
            for deed in (*(ON_A_BUS if has_bus else ()), *EVERYWHERE):
                verdicts[deed.__doc__ or ""] = await deed(stage)
        finally:
            await stage.end()

    with as_micropython():
        run_virtual(play())
    return verdicts
