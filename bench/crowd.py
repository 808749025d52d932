"""A robot with many parts on one simulated CAN bus, in virtual time: master, inventory, database and parts are real.

The robot is the thesis' ring made longer: part 1 speaks to part 2, part 2 to part 3, ..., the last to the first. Each
part has a port that publishes and one that subscribes, as the sample parts have; nothing is published.
"""

from __future__ import annotations

import asyncio
import statistics
import time
from collections import Counter
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

from bench.buses import CODEC, Rates
from msbot.config import Blueprint, load_blueprint, load_library
from msbot.master import Master
from msbot.part import Part
from msbot.pnp import PartEvent, PartState
from msbot.registry import Registry, open_registry
from msbot_agent.link.can import CanMasterLink, CanPartLink, Codec
from msbot_agent.link.can.protocol import CanIds, Frame
from msbot_agent.link.can.protocol.ids import NOBODY, read_assign
from msbot_agent.link.can.sim import SimBusDriver

PART_NUMBER = "ABCD"
"""Of all parts: the thesis' light sensor."""
ROBOT = "MSBOT_MASTER"
QUIET_S = 2.1
"""How long the master has been there when the parts are switched on."""
PAUSE_S = 0.5
"""How long there is no master when it is started anew."""
SETTLED_S = 3.0
"""From the last part's `active` until the load at rest is measured."""
LONGEST_S = 120.0
"""A robot that is not complete by then never will be."""

_ROBOT = f"""\
[robot]
name = "{ROBOT}"
version = "MSBOT_V1"
serial_number = "X100Y100Z100"
released = "8-4-2021"
manufacturer = "MASSEY_ENGINEERING_DEP"
"""
_SLOT = '[[slot]]\nname = "P{0:03}"\npart = "{1}"\n'
_BINDING = '[[binding]]\ntopic = "ring_{0:03}"\ntype = "HelloWorld"\nfrom = "P{0:03}.out"\nto = {1}\n'


@dataclass
class Outcome:
    """What happened to parts that were switched on together."""

    rates: Rates
    size: int
    active_s: list[float] = field(default_factory=list)
    """From power-up to `active`, in the order in which they came."""
    served_s: float = 0.0
    """From power-up until the last part had its configuration and its ports."""
    frames: Counter[str] = field(default_factory=Counter)
    """Frames until the last was active, by kind."""
    bits: int = 0
    """Of these frames."""
    busy_s: float = 0.0
    """Bus time of these frames."""
    lost: int = 0
    """Active parts that were given up although they live."""
    late: int = 0
    """Active parts that had to be waited for."""
    dropped: Counter[str] = field(default_factory=Counter)
    """Messages and frames that did not arrive, by reason."""
    load: float = 0.0
    """Busy part of the time at rest."""
    rest_frames: int = 0
    rest_cpu_s: float = 0.0
    """Processor time of all together (bus, master, parts) for the frames at rest; it depends on the machine."""

    @property
    def last_s(self) -> float:
        """When the last was active."""
        return self.active_s[-1]

    @property
    def median_s(self) -> float:
        """When half of them were."""
        return statistics.median(self.active_s)

    @property
    def p95_s(self) -> float:
        """When 95 % of them were."""
        return self.active_s[max(0, -(-95 * len(self.active_s) // 100) - 1)]

    @property
    def ratio(self) -> float:
        """Time to the bus time of the same frames."""
        return self.last_s / self.busy_s


def ring(folder: Path, size: int, *, bound: bool = True) -> Blueprint:
    """The blueprint of a robot with so many parts; without bindings they only beat."""
    text = _ROBOT + "".join(_SLOT.format(number, PART_NUMBER) for number in range(1, size + 1))
    for number in range(1, size + 1) if bound else ():
        target = f'["P{number % size + 1:03}.in"]' if size > 1 else "[]"
        text += _BINDING.format(number, target)
    path = folder / f"ring{size}{'' if bound else '-at-rest'}.toml"
    path.write_text(text)
    return load_blueprint(path, load_library())


async def switch_on(
    rates: Rates, size: int, folder: Path, *, compression: bool = True, rest_s: float = 0.0, seed: int = 1
) -> Outcome:
    """Switch parts on in the same instant, on a bus whose master is there, and see how they come in.

    Args:
        rates: the bus.
        size: parts, 1 to 120.
        folder: for blueprint and database.
        compression: with header compression.
        rest_s: how long the load at rest is measured afterwards.
        seed: of everything that is drawn.
    """
    async with _robot(rates, size, folder, compression=compression, seed=seed) as robot:
        await robot.start_master()
        await asyncio.sleep(QUIET_S)
        crowd = robot.watch()
        robot.switch_parts_on()
        await crowd.until_complete()
        if rest_s:
            await asyncio.sleep(SETTLED_S)
            counters, used_s = robot.driver.counters, time.process_time()
            busy_s, frames = counters.busy_s, counters.frames
            await asyncio.sleep(rest_s)
            crowd.outcome.rest_cpu_s = time.process_time() - used_s
            crowd.outcome.rest_frames = counters.frames - frames
            crowd.outcome.load = (counters.busy_s - busy_s) / rest_s
        robot.count_drops(crowd.outcome)
    return crowd.outcome


async def start_anew(rates: Rates, size: int, folder: Path, *, seed: int = 1) -> Outcome:
    """Start the master anew under parts that are all active, and see how they come in again."""
    async with _robot(rates, size, folder, compression=True, seed=seed) as robot:
        await robot.start_master()
        await asyncio.sleep(QUIET_S)
        crowd = robot.watch()
        robot.switch_parts_on()
        await crowd.until_complete()
        await robot.stop_master()
        await asyncio.sleep(PAUSE_S)
        again = robot.watch()
        await robot.start_master()
        await again.until_complete()
        robot.count_drops(again.outcome)
    return again.outcome


@asynccontextmanager
async def _robot(rates: Rates, size: int, folder: Path, *, compression: bool, seed: int) -> AsyncIterator[_Robot]:
    blueprint = ring(folder, size)
    database = folder / f"{rates.nominal}-{rates.data}-{size}-{compression}-{seed}.db"
    with open_registry(database, epoch_ns=lambda: 0) as registry:
        async with asyncio.TaskGroup() as tasks:
            robot = _Robot(rates, blueprint, registry, tasks, codec=CODEC if compression else None, seed=seed)
            yield robot
            robot.end()


class _Robot:
    """The bus with its master, which can be started anew, and its parts."""

    def __init__(
        self,
        rates: Rates,
        blueprint: Blueprint,
        registry: Registry,
        tasks: asyncio.TaskGroup,
        *,
        codec: Codec | None,
        seed: int,
    ) -> None:
        self.driver = SimBusDriver(rates.bus())
        # A bus needs two nodes before any frame is acknowledged.
        self.driver.attach("monitor")
        self._rates = rates
        self._blueprint = blueprint
        self._store = registry.runs.begin(registry.robots.apply_blueprint(blueprint, load_library()))
        self._tasks = tasks
        self._codec = codec
        self._random = Random(seed)
        self._links: list[CanMasterLink | CanPartLink] = []
        self._running: list[asyncio.Task[None]] = []
        self._master: asyncio.Task[None] | None = None
        self._masters = 0
        self._crowd = _Crowd(Outcome(rates, len(blueprint.slots)))

    def watch(self) -> _Crowd:
        """Watch the parts come in, from now on."""
        self._crowd = _Crowd(Outcome(self._rates, len(self._blueprint.slots)))
        self._crowd.start = asyncio.get_running_loop().time()
        self.driver.tap = self._crowd.heard
        return self._crowd

    async def start_master(self) -> None:
        """Start a master, and wait until it serves."""
        self._masters += 1
        master = Master(self._blueprint, self._store, random=self._random, epoch_ns=lambda: 0)
        link = CanMasterLink(
            self.driver.attach(f"master {self._masters}"),
            profile_hash=master.profile.profile_hash(),
            random=self._random,
            fd=self._rates.fd,
            codec=self._codec,
        )
        self._links.append(link)
        master.add_link(link)
        master.inventory.on_event(self._changed)
        self._master = self._tasks.create_task(master.run())
        await master.ready.wait()

    async def stop_master(self) -> None:
        """Take the master away without a word to anybody."""
        assert self._master is not None
        self._master.cancel()
        await asyncio.gather(self._master, return_exceptions=True)

    def switch_parts_on(self) -> None:
        """All in this instant."""
        for slot in self._blueprint.slots:
            part = Part(
                PART_NUMBER,
                local_name=slot.name,
                robot=ROBOT,
                uid=self._random.randbytes(8),
                random=Random(self._random.getrandbits(64)),
            )
            part.on_join(self._served)
            link = CanPartLink(
                self.driver.attach(slot.name), uid=part.uid or b"", random=self._random, codec=self._codec
            )
            self._links.append(link)
            self._running.append(self._tasks.create_task(part.run_async(link, epoch_ns=lambda: 0)))

    def _changed(self, event: PartEvent) -> None:
        self._crowd.changed(event)

    def _served(self) -> None:
        self._crowd.served()

    def count_drops(self, outcome: Outcome) -> None:
        """What the links have dropped."""
        for link in self._links:
            outcome.dropped.update(link.counters.dropped)

    def end(self) -> None:
        """Switch everything off."""
        for task in (*self._running, self._master):
            if task is not None:
                task.cancel()


class _Crowd:
    """Watches the parts come in."""

    def __init__(self, outcome: Outcome) -> None:
        self.outcome = outcome
        self.complete = asyncio.Event()
        self.start = 0.0
        self._ids = CanIds()
        self._active: set[str] = set()
        self._served = 0
        self._window: list[Frame] = []

    async def until_complete(self) -> None:
        """Wait until the last part is at work."""
        async with asyncio.timeout(LONGEST_S):
            await self.complete.wait()

    def changed(self, event: PartEvent) -> None:
        """The inventory has changed a part's state."""
        outcome = self.outcome
        was_in = event.from_state in (PartState.ACTIVE, PartState.LATE)
        if event.to_state is PartState.ACTIVE and event.slot is not None and event.slot not in self._active:
            self._active.add(event.slot)
            outcome.active_s.append(event.at - self.start)
            if len(self._active) == outcome.size:
                self._close()
        elif event.to_state is PartState.LATE:
            outcome.late += 1
        elif was_in and event.to_state is not PartState.ACTIVE and not self.complete.is_set():
            outcome.lost += 1

    def served(self) -> None:
        """A part has its configuration."""
        self._served += 1
        if self._served == self.outcome.size:
            self.outcome.served_s = asyncio.get_running_loop().time() - self.start
            self.complete.set()

    def heard(self, _at: float, _name: str, frame: Frame) -> None:
        """A frame was on the bus."""
        if len(self._active) < self.outcome.size:
            self._window.append(frame)

    def _close(self) -> None:
        outcome, ids = self.outcome, self._ids
        for frame in self._window:
            if frame.extended:
                assign = read_assign(frame, ids)
                kind = "JOIN" if assign is None else "TAKEN BACK" if assign.uid == NOBODY else "ASSIGN"
            else:
                kind = "BEACON" if frame.can_id == ids.beacon else "message"
            outcome.frames[kind] += 1
        outcome.busy_s = outcome.rates.seconds(self._window)
