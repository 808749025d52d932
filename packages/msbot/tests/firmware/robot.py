"""A robot of the master, the firmware's part and parts of MsBOT on one simulated bus, in virtual time."""

from __future__ import annotations

import asyncio
import shutil
from collections.abc import Awaitable, Callable, Coroutine
from pathlib import Path
from random import Random

from tests.firmware.building import SOURCES
from tests.firmware.c_part import CPart
from tests.firmware.msbot_side import (
    Blueprint,
    CanMasterLink,
    CanPartLink,
    Codec,
    Library,
    Master,
    Part,
    Registry,
    RobotRecord,
    SimBus,
    SimBusDriver,
    SimCanBus,
    compact,
    load_blueprint,
    load_library,
    open_registry,
    run_virtual,
)
from tests.registry.hand import Hand

EXAMPLES = SOURCES / "examples"


class Robot:
    """The robot of the firmware's examples."""

    def __init__(
        self,
        blueprint: Blueprint,
        registry: Registry,
        record: RobotRecord,
        library: Library,
        *,
        bitrate: int,
        fd: bool,
        codec: bool,
        seed: int,
    ) -> None:
        self.registry = registry
        self.record = record
        self.library = library
        self.random = Random(seed)
        self.nodes: dict[str, int] = {}
        """Controllers by name."""
        self.blueprint = blueprint
        self.codec = Codec(compact.compress, compact.decompress) if codec else None
        bus = SimBus(bitrate, data_bitrate=2_000_000 if fd else None, fd=fd, random=Random(seed))
        self.driver = SimBusDriver(bus)
        self.driver.attach("monitor")
        self.fd = fd
        self.master, self.master_link = self._new_master("master")
        self._serving: asyncio.Task[None] | None = None
        self._tasks: list[asyncio.Task[None]] = []

    def _new_master(self, name: str) -> tuple[Master, CanMasterLink]:
        store = self.registry.runs.begin(self.record)
        master = Master(self.blueprint, store, library=self.library, random=self.random, epoch_ns=lambda: 0)
        link = CanMasterLink(
            self.attach(name),
            profile_hash=master.profile.profile_hash(),
            random=self.random,
            fd=self.fd,
            codec=self.codec,
        )
        master.add_link(link)
        return master, link

    def attach(self, name: str, *, fd: bool | None = None) -> SimCanBus:
        controller = self.driver.attach(name, fd=fd)
        self.nodes[name] = controller.node
        return controller

    async def start(self) -> None:
        self._serving = asyncio.get_running_loop().create_task(self.master.run())
        await self.master.ready.wait()

    async def kill_master(self) -> None:
        assert self._serving is not None
        self._serving.cancel()
        await asyncio.gather(self._serving, return_exceptions=True)

    async def new_master(self) -> None:
        self.master, self.master_link = self._new_master("another master")
        await self.start()

    async def end(self) -> None:
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        await self.kill_master()

    def plug(self, part: CPart, name: str = "board") -> CPart:
        part.plug(self.attach(name, fd=part.described.fd if self.fd else None))
        return part

    def pull(self, part: CPart, name: str = "board") -> None:
        part.pull()
        self.driver.detach(name)

    def plug_python(self, part: Part, name: str) -> Part:
        part.uid = self.random.randbytes(8)
        link = CanPartLink(self.attach(name), uid=part.uid, random=self.random, codec=self.codec)
        self._tasks.append(asyncio.get_running_loop().create_task(part.run_async(link)))
        return part

    def state(self, local_name: str = "board") -> str:
        """How the inventory sees a part."""
        now = asyncio.get_running_loop().time()
        states = [info.state.value for info in self.master.inventory.view(now) if info.local_name == local_name]
        return states[-1] if states else "unknown"

    def nature(self, local_name: str = "board") -> str:
        """What is behind a part's ports, as it has told the inventory."""
        now = asyncio.get_running_loop().time()
        return next(info.nature.label for info in self.master.inventory.view(now) if info.local_name == local_name)

    def versions(self, local_name: str = "board") -> tuple[str, str, str]:
        """Where a part runs, the version of MsBOT there, and that of its program, as it has told the inventory."""
        now = asyncio.get_running_loop().time()
        told = next(info for info in self.master.inventory.view(now) if info.local_name == local_name)
        return told.home, told.msbot, told.software

    def beats(self, local_name: str = "board") -> int:
        """Beats of a part that the inventory has heard."""
        now = asyncio.get_running_loop().time()
        return sum(info.beats for info in self.master.inventory.view(now) if info.local_name == local_name)

    def plug_in_to_active_ms(self, local_name: str = "board") -> float:
        """What the inventory has measured."""
        now = asyncio.get_running_loop().time()
        (took_ms,) = [
            info.plug_in_to_active_ms for info in self.master.inventory.view(now) if info.local_name == local_name
        ]
        assert took_ms is not None
        return took_ms

    def set(self, slot: str, name: str, value: bool | float) -> None:
        """A person changes a setting."""
        Hand(self.registry).set_value(self.record, slot, name, value, "test")
        self.master.inventory.configuration_changed(slot)


def play(
    folder: Path,
    scene: Callable[[Robot], Awaitable[None]],
    *,
    bitrate: int = 500_000,
    fd: bool = False,
    codec: bool = True,
    seed: int = 3,
    changes: tuple[tuple[str, str], ...] = (),
    run: Callable[[Coroutine[object, object, None]], None] = run_virtual,
) -> None:
    """Run the robot through a scene, in virtual time if nothing else is said."""
    text = (EXAMPLES / "robot.toml").read_text()
    for before, after in changes:
        assert before in text
        text = text.replace(before, after)
    (folder / "robot.toml").write_text(text)
    shutil.copytree(EXAMPLES / "parts", folder / "parts")
    library: Library = load_library(EXAMPLES / "parts")
    blueprint = load_blueprint(folder / "robot.toml", library)

    async def main() -> None:
        with open_registry(folder / "robot.db") as registry:
            record = registry.robots.apply_blueprint(blueprint, library)
            robot = Robot(blueprint, registry, record, library, bitrate=bitrate, fd=fd, codec=codec, seed=seed)
            await robot.start()
            try:
                await scene(robot)
            finally:
                await robot.end()

    run(main())
