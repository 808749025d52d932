"""A robot with many parts on one simulated CAN bus, in virtual time: master, inventory, database and parts are real.

The robot is the thesis' ring made longer: part 1 speaks to part 2, part 2 to part 3, ..., the last to the first. Each
part has a port that publishes and one that subscribes, as the sample parts have; nothing is published.
"""

from __future__ import annotations

import asyncio
import statistics
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

from bench.buses import CODEC, Rates
from msbot.config import Blueprint, load_blueprint, load_library
from msbot.link import CanMasterLink, CanPartLink, Frame, SimBusDriver
from msbot.link.can_ids import CanIds, read_join
from msbot.master import Master
from msbot.part import Part
from msbot.pnp import PartEvent, PartState
from msbot.registry import open_registry

PART_NUMBER = "ABCD"
"""Of all parts: the thesis' light sensor."""
ROBOT = "MSBOT_MASTER"
QUIET_S = 2.1
"""How long the master has been there when the parts are switched on."""
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
    loop = asyncio.get_running_loop()
    random = Random(seed)
    blueprint = ring(folder, size)
    database = folder / f"{rates.nominal}-{rates.data}-{size}-{compression}-{seed}.db"
    with open_registry(database, epoch_ns=lambda: 0) as registry:
        driver = SimBusDriver(rates.bus())
        # A bus needs two nodes before any frame is acknowledged.
        driver.attach("monitor")
        master = Master(
            blueprint,
            registry.store_for(registry.apply_blueprint(blueprint, load_library())),
            random=random,
            epoch_ns=lambda: 0,
        )
        codec = CODEC if compression else None
        links: list[CanMasterLink | CanPartLink] = [
            CanMasterLink(
                driver.attach("master"),
                profile_hash=master.profile.profile_hash(),
                random=random,
                fd=rates.fd,
                codec=codec,
            )
        ]
        master.add_link(links[0])
        crowd = _Crowd(Outcome(rates, size))
        master.inventory.on_event(crowd.changed)
        async with asyncio.TaskGroup() as tasks:
            running = [tasks.create_task(master.run())]
            await master.ready.wait()
            await asyncio.sleep(QUIET_S)
            driver.tap = crowd.heard
            crowd.start = loop.time()
            for slot in blueprint.slots:
                part = Part(
                    PART_NUMBER,
                    local_name=slot.name,
                    robot=ROBOT,
                    uid=random.randbytes(8),
                    random=Random(random.getrandbits(64)),
                )
                part.on_join(crowd.served)
                end = CanPartLink(driver.attach(slot.name), uid=part.uid or b"", random=random, codec=codec)
                links.append(end)
                running.append(tasks.create_task(part.run_async(end, epoch_ns=lambda: 0)))
            async with asyncio.timeout(LONGEST_S):
                await crowd.complete.wait()
            if rest_s:
                await asyncio.sleep(SETTLED_S)
                before = driver.counters.busy_s
                await asyncio.sleep(rest_s)
                crowd.outcome.load = (driver.counters.busy_s - before) / rest_s
            for link in links:
                crowd.outcome.dropped.update(link.counters.dropped)
            for task in running:
                task.cancel()
    return crowd.outcome


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
                kind = "JOIN" if read_join(frame, ids) else "ASSIGN"
            else:
                kind = "BEACON" if frame.can_id == ids.beacon else "message"
            outcome.frames[kind] += 1
        outcome.busy_s = outcome.rates.seconds(self._window)
