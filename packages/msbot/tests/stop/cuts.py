"""STOP with every kind of part behind an agent or a relay whose cable to the master is cut. In virtual time.

The part that is tried is at an agent that a master elsewhere feeds, or behind a relay. Its partner is at the master; on
a bus it is beside the part instead if that is wished, and then samples go from one to the other while the cable is cut.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping, Sequence
from random import Random

from msbot import Level
from msbot.master import Master
from msbot.master.remote_agent import RemoteAgent
from msbot.part import JoinState, Part
from msbot_agent.link import InprocHub, Link, LinkInfo, LossyLink
from msbot_agent.link.can import CanMasterLink
from msbot_agent.link.can.protocol.frames import Frame
from msbot_agent.link.relay import PartsRelay
from tests.homes.runners import as_micropython
from tests.homes.world import CODEC, PARTNER_UID, Home, World, run_virtual
from tests.stop.gap import STOP_IDENTIFIER
from tests.stop.kinds import EVERY_S, PROGRAM, ROBOT, Heard
from tests.stop.oracle import POWER, Oracle, Verdict, until_all_confirm

SOME_S = 1.0
SHORT_S, LONG_S = 1.0, 30.0
"""How long a cable is cut: before and after anybody takes the parts for lost."""
AGENT, RELAY = "an agent", "a relay"
BUS, LINE, PAGE = "bus", "line", "page"
LINKS = {"micropython-serial": LINE, "browser": PAGE}
"""How a kind of part comes in, where it is not by the bus."""


class FarWorld(World):
    """A robot whose parts come in behind a cable that can be cut.

    Args:
        way: what is at the other end of the cable.
        link: how the program's part comes in there.
        near: whether the partner is on the same bus; else it is at the master.
        home: where the program runs.
    """

    def __init__(self, way: str, link: str, home: Home, *, near: bool) -> None:
        self.oracle = Oracle()
        self.near = near
        self._way, self._link = way, link
        super().__init__(ROBOT, home, PROGRAM, "program.py")
        self.log = Heard(self.oracle)
        self.oracle.watch(self.master.agent)
        self.far = self._far_end()

    def start_master(self) -> None:
        """See `World`."""
        super().start_master()
        self._tasks["far end"] = self.spawn(self.far.run())

    def plug_partner(self, *program: Callable[[Part], None]) -> Part:
        """See `World`."""
        if self.near:
            return super().plug_partner(*program)
        part = Part("PARTNER", uid=PARTNER_UID, random=Random(2))
        for tell in program:
            tell(part)
        self._tasks["partner"] = self.spawn(part.run_async(self._desk.connect(), epoch_ns=lambda: 0))
        self.partner = part
        return part

    def cut(self) -> None:
        """Cut the cable."""
        self._cable.disturbance.drop = 1.0

    def heal(self) -> None:
        """Mend it."""
        self._cable.disturbance.drop = 0.0

    def _add_links(self, master: Master) -> None:
        cable, self._desk = InprocHub(), InprocHub()
        for hub, name in ((cable, "cable"), (self._desk, "desk")):
            hub.server.info = LinkInfo(name, 1400)
            master.add_link(hub.server)
        self._cable = LossyLink(cable.connect(), random=Random(5))

    def _far_end(self) -> RemoteAgent | PartsRelay:
        self._controller = self.driver.attach("far end")
        if self._way == RELAY:
            return PartsRelay(self._open_parts, self._cable, name="pi", say=lambda _: None)
        agent = RemoteAgent(self._open_parts, self._cable, name="pi", say=lambda _: None)
        self.oracle.watch(agent.agent)
        return agent

    def _open_parts(self, profile_hash: int) -> Link:
        if self._link == LINE:
            return self.lines
        if self._link == PAGE:
            return self.page
        return CanMasterLink(self._controller, profile_hash=profile_hash, random=self.random, codec=CODEC)


class Stage:
    """The robot at work, and what has been heard."""

    def __init__(self, world: FarWorld) -> None:
        self.world, self.oracle = world, world.oracle
        self._at: dict[str, int] = {}
        self._sent = 0

    async def start(self) -> None:
        """Until each of the two hears the other one."""
        world = self.world
        self.oracle.expect("the part", "the partner")
        world.start_master()
        await world.master.ready.wait()
        self._speaking = world.spawn(self._speak())
        world.plug_partner(lambda part: _tells(part, self.oracle))
        world.plug()
        await self.works()

    async def end(self) -> None:
        """It is over."""
        self._speaking.cancel()
        await self.world.close()

    def say_stop(self) -> None:
        """At the master."""
        self.world.master.say_stop("ann")

    async def confirm(self) -> float:
        """Until all have confirmed, ms; nothing may be heard from now on."""
        took_ms = await until_all_confirm(self.world.master, 2, 90.0)
        self.mark()
        return took_ms

    async def until_master_knows(self) -> None:
        """Until the master has learned of a STOP that others said."""
        async with asyncio.timeout(90.0):
            while not self.world.master.stop.stopped:  # noqa: ASYNC110 - virtual time
                await asyncio.sleep(0.001)

    def mark(self, *names: str) -> None:
        """From now on they may hear nothing, unless that held already; all of them if no names are given."""
        if not self._at:
            self._sent = self.oracle.on_the_way
        for name in names or self.oracle.counts:
            self._at.setdefault(name, self.oracle.counts[name])

    async def cut(self, seconds: float, meanwhile: Callable[[], object] = lambda: None) -> None:
        """Cut the cable for so long; halfway something happens."""
        self.world.cut()
        await asyncio.sleep(seconds / 2)
        meanwhile()
        await asyncio.sleep(seconds / 2)
        self.world.heal()

    def bus_stop(self) -> None:
        """Somebody says STOP on the bus."""
        self.world.spawn(self._bus_stop())

    async def _bus_stop(self) -> None:
        self.world.driver.attach("stranger").send(Frame(STOP_IDENTIFIER, b"\x01"))
        await asyncio.sleep(EVERY_S)
        self.world.driver.detach("stranger")
        self.mark("the part", *(("the partner",) if self.world.near else ()))

    async def works(self) -> dict[str, int]:
        """Wait until each hears the other one; then what is heard in a while."""
        at = dict(self.oracle.counts)
        async with asyncio.timeout(90.0):
            while not all(self.oracle.since(at).values()):  # noqa: ASYNC110 - virtual time
                await asyncio.sleep(EVERY_S)
        at = dict(self.oracle.counts)
        await asyncio.sleep(SOME_S)
        return self.oracle.since(at)

    async def story(self, deed: Deed) -> Verdict:
        """The deed; all confirm; a while; GO."""
        verdict = Verdict(before=await self.works())
        self._at = {}
        await deed(self)
        verdict.confirmed_ms = await self.confirm()
        await asyncio.sleep(2 * SOME_S)
        await until_all_confirm(self.world.master, 2, 90.0)
        verdict.after, verdict.on_the_way = self.oracle.since(self._at), self.oracle.on_the_way - self._sent
        self.world.master.say_go("ann")
        verdict.again = await self.works()
        return verdict

    async def _speak(self) -> None:
        while True:
            partner = self.world.partner
            if partner is not None and partner.state is JoinState.ACTIVE:
                partner.publish("power", Level(percent=POWER))
            await asyncio.sleep(EVERY_S)


def _tells(part: Part, oracle: Oracle) -> None:
    part.on("speed", Level)(lambda _: oracle.heard("the partner"))


Deed = Callable[[Stage], Awaitable[None]]


async def cut_first(stage: Stage) -> None:
    """the cable is cut, STOP at the master, it is mended"""
    await stage.cut(SHORT_S, stage.say_stop)
    assert stage.world.master.stop.silent, "a part that nobody could reach has not confirmed"


async def cut_for_long(stage: Stage) -> None:
    """the cable is cut for long, STOP at the master, it is mended"""
    await stage.cut(LONG_S, stage.say_stop)


async def cut_at_that_moment(stage: Stage) -> None:
    """STOP at the master in the moment of the cut, it is mended"""
    stage.say_stop()
    await stage.cut(SHORT_S)


async def stopped_first(stage: Stage) -> None:
    """STOP, the cable is cut and mended"""
    stage.say_stop()
    await stage.confirm()
    await stage.cut(SHORT_S)


async def stopped_before_long(stage: Stage) -> None:
    """STOP, the cable is cut for long and mended"""
    stage.say_stop()
    await stage.confirm()
    await stage.cut(LONG_S)


async def on_the_bus(stage: Stage) -> None:
    """the cable is cut, STOP on the bus behind it, it is mended"""
    await stage.cut(SHORT_S, stage.bus_stop)
    await stage.until_master_knows()


async def on_the_bus_for_long(stage: Stage) -> None:
    """the cable is cut for long, STOP on the bus behind it, it is mended"""
    await stage.cut(LONG_S, stage.bus_stop)
    await stage.until_master_knows()


EVERYWHERE: tuple[Deed, ...] = (cut_first, cut_at_that_moment, stopped_first)
ON_A_BUS: tuple[Deed, ...] = (on_the_bus,)
FOR_LONG: tuple[Deed, ...] = (cut_for_long, stopped_before_long)
FOR_LONG_ON_A_BUS: tuple[Deed, ...] = (on_the_bus_for_long,)


def deeds_for(kind: str, *, also_long: bool = False) -> Sequence[Deed]:
    """What may happen to a part of that kind; cuts that are long need many steps, and are for the bench."""
    has_bus = kind not in LINKS
    long = (*FOR_LONG, *(FOR_LONG_ON_A_BUS if has_bus else ())) if also_long else ()
    return (*EVERYWHERE, *(ON_A_BUS if has_bus else ()), *long)


def cut_stories(home: Home, kind: str, way: str, deeds: Sequence[Deed], *, near: bool = False) -> Mapping[str, Verdict]:
    """One robot, and one cut after the other."""
    verdicts: dict[str, Verdict] = {}

    async def play() -> None:
        stage = Stage(FarWorld(way, LINKS.get(kind, BUS), home, near=near))
        await stage.start()
        try:
            for deed in deeds:
                verdicts[deed.__doc__ or ""] = await stage.story(deed)
        finally:
            await stage.end()

    with as_micropython():
        run_virtual(play())
    return verdicts
