"""Many parts in one process, with real hardware or simulated, and a file that says which: `msbot host parts.toml`.

The file is checked once a second. New parts are started, removed ones are ended, and changed ones are restarted; all
others keep running undisturbed. A file with a mistake changes nothing, and the mistake is reported.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Protocol

from msbot.config import Library, PartType
from msbot.hardware.bus_worker import BusWorkers
from msbot.hardware.driver import Driver, Mount, Values, bus_of, driver_class
from msbot.hardware.hardware_part import HardwarePart
from msbot.hardware.machine import Machine
from msbot.hardware.output_guard import OutputGuard
from msbot.hardware.wiring import HostedPart, PartWiring, read_parts
from msbot.part import Part
from msbot.sim import make_simulator
from msbot.sim.arena.world_connection import WorldConnection
from msbot_agent.link import Link
from msbot_xrce.errors import ConfigError, MsbotError
from msbot_xrce.lazy import dataclass

LOOK_S = 1.0
"""Time between two checks of the file."""
RESTART_S = 5.0
"""Time after which a part that ended with an error is started again."""

_log = logging.getLogger("msbot.part")


class Runnable(Protocol):
    """A part that runs until it is told to end."""

    part: Part

    async def run(self, connect: Callable[[], Link]) -> None:
        """Run until `end`."""

    def end(self) -> None:
        """End cleanly."""


class _Simulated:
    """A simulated part that is run like a real one."""

    def __init__(self, hosted: HostedPart, door: WorldConnection | None) -> None:
        self._simulated = make_simulator(hosted.part_type, local_name=hosted.name)
        self._slot = hosted.name
        self._door = door
        self.part = self._simulated.part

    async def run(self, connect: Callable[[], Link]) -> None:
        """Run until `end`."""
        if self._door is not None:
            self._door.enter(self._slot, self._simulated)
        try:
            await self.part.run_async(connect())
        finally:
            if self._door is not None:
                self._door.leave(self._slot)

    def end(self) -> None:
        """End cleanly."""
        self.part.end()


class HardwareParts:
    """Makes parts with hardware on one computer; owns the threads of its buses and the keeper of the outputs."""

    def __init__(self, machine: Machine | None = None) -> None:
        self.machine = machine or Machine()
        self._threads = BusWorkers()
        self._keeper = OutputGuard(self.machine.keeper)

    def make(
        self, part_type: PartType, wiring: PartWiring, *, number: str | None = None, name: str | None = None
    ) -> HardwarePart:
        """A part with hardware, ready to run.

        Raises:
            ConfigError: its type has no driver.
        """
        made = driver_class(part_type)
        key = name or part_type.number

        def make_driver(changed: Callable[[Values], None]) -> Driver:
            return made(Mount(part_type, wiring, self.machine, changed))

        part = HardwarePart(
            part_type, make_driver, self._threads.of(bus_of(part_type, wiring, key)), number=number, local_name=name
        )
        if made.drives:
            part.on_open(lambda: self._keeper.hold(key, part_type, wiring), lambda: self._keeper.free(key))
        return part

    def end(self) -> None:
        """End the threads and the keeper, after every part has ended."""
        self._keeper.end()
        self._threads.end()


@dataclass(slots=True)
class _Running:
    hosted: HostedPart
    unit: Runnable
    task: asyncio.Task[None]


class PartsHost:
    """Runs the parts of a file.

    Args:
        path: the file.
        library: where part numbers are looked up.
        connect: makes a link for a part.
        prepare: gives a part its UID and key before it runs.
        bench: makes the parts.
        door: the way into a world for those that are simulated; their names are the slots in it.
    """

    def __init__(
        self,
        path: Path,
        library: Library,
        connect: Callable[[Part], Link],
        *,
        prepare: Callable[[Part, HostedPart], None] = lambda _part, _hosted: None,
        bench: HardwareParts | None = None,
        door: WorldConnection | None = None,
    ) -> None:
        self._path = path
        self._library = library
        self._connect = connect
        self._prepare = prepare
        self._bench = bench or HardwareParts()
        self._door = door
        self._running: dict[str, _Running] = {}
        self._wanted: list[HostedPart] = []
        self._seen: tuple[int, int] | None = None
        self._ended = asyncio.Event()

    @property
    def parts(self) -> Sequence[Part]:
        """The parts that are running now."""
        return [one.unit.part for one in self._running.values()]

    def end(self) -> None:
        """End all parts cleanly."""
        self._ended.set()

    async def run(self) -> None:
        """Run until `end`.

        Raises:
            ConfigError: the file has mistakes at the start.
        """
        self._seen = await asyncio.to_thread(self._stamp)
        self._wanted = await asyncio.to_thread(read_parts, self._path, self._library)
        in_world = None if self._door is None else asyncio.create_task(self._stay_in_world(self._door))
        try:
            while not self._ended.is_set():
                await self._make_it_so()
                try:
                    async with asyncio.timeout(LOOK_S):
                        await self._ended.wait()
                except TimeoutError:
                    await self._look()
        finally:
            await self._stop(list(self._running))
            if in_world is not None:
                in_world.cancel()
            await asyncio.to_thread(self._bench.end)

    async def _stay_in_world(self, door: WorldConnection) -> None:
        try:
            await door.run()
        except ConfigError as error:
            _log.error("%s\nthe parts run on without a world", error)

    async def _look(self) -> None:
        stamp = await asyncio.to_thread(self._stamp)
        if stamp == self._seen:
            return
        self._seen = stamp
        try:
            self._wanted = await asyncio.to_thread(read_parts, self._path, self._library)
        except ConfigError as error:
            _log.error("%s\nall parts run on as they are", error)

    def _stamp(self) -> tuple[int, int] | None:
        try:
            status = self._path.stat()
        except OSError:
            return None
        return status.st_mtime_ns, status.st_size

    async def _make_it_so(self) -> None:
        wanted = {hosted.name: hosted for hosted in self._wanted}
        await self._stop([name for name, one in self._running.items() if wanted.get(name) != one.hosted])
        for name, hosted in wanted.items():
            if name not in self._running:
                self._start(hosted)

    def _start(self, hosted: HostedPart) -> None:
        unit: Runnable
        if hosted.wiring is None:
            unit = _Simulated(hosted, self._door)
            words = "simulated"
        else:
            unit = self._bench.make(hosted.part_type, hosted.wiring, number=hosted.number, name=hosted.name)
            words = hosted.wiring.describe() or "this computer"
        _log.info("%s: %s, %s", hosted.name, hosted.part_type.name, words)
        self._prepare(unit.part, hosted)
        self._running[hosted.name] = _Running(hosted, unit, asyncio.create_task(self._run(hosted, unit)))

    async def _run(self, hosted: HostedPart, unit: Runnable) -> None:
        """Run one part; a mistake in it is reported and does not affect the others."""
        try:
            await unit.run(lambda: self._connect(unit.part))
        except MsbotError as error:
            _log.error("%s: %s; tried again in %g s", hosted.name, error, RESTART_S)
            await asyncio.sleep(RESTART_S)
            self._running.pop(hosted.name, None)

    async def _stop(self, names: Sequence[str]) -> None:
        stopped = [self._running.pop(name) for name in names]
        for one in stopped:
            one.unit.end()
        _, late = await asyncio.wait([one.task for one in stopped], timeout=RESTART_S) if stopped else (None, set())
        for task in late:
            task.cancel()
        results = await asyncio.gather(*(one.task for one in stopped), return_exceptions=True)
        for one, result in zip(stopped, results, strict=True):
            if isinstance(result, Exception):
                _log.error("%s: %s", one.hosted.name, result)
